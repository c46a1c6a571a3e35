"""Where one can drive: a graph along the paths that the camera was driven.

A path that comes near another one joins it there; what runs along it is not taken twice. Nothing is joined that was not
driven.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from savmap.errors import visible
from savmap.maps.exports.frames import Drive, Element, drives, elements, world_from_row
from savmap.maps.exports.marks import IN_BRACKETS, unique
from savmap.types import Bools, Floats, SiteMap, array_record

BAY, TEXT = "bay", "text"
"""Attributes: structures with the same number as their `bay` are one bay; what is written on structures that hang there
(`bay`, `text`) is its title."""
MEET_M = 0.5
"""Paths nearer to one another than this are one."""
LEAST_M = 1.0
"""Of a path that is shorter than this beside another one nothing is made."""
GAP_M = 2.0
"""A path whose next place is further away is interrupted."""
STEP_M = 0.25
STRAIGHT_M = 0.1
"""How far a path may be from the straight lines between its nodes."""
SPACING_M = 3.0
"""The longest way from node to node: about a bay."""
REACH_M = 5.0
"""How far the path before a bay may be from it."""
NEAR_M = 0.25
"""A node so near to where a vehicle would stop is where it stops, such as for the bay across the aisle: half of what
makes two paths one."""
DECIMALS = 4


@dataclass(frozen=True, eq=False)
@array_record
class Station:
    """A bay of a row: the middle of its face (2,) m in the world from above, its name, and what is written there."""

    name: str
    row: str
    place: Floats
    title: str


@dataclass(frozen=True, eq=False)
@array_record
class RouteGraph:
    """Nodes (n, 2) m in the world, a name for each (that of the bay before which it is) and the row by which it was
    driven first; edges as pairs of nodes, the lower number first, each once, to be driven both ways; for each row the
    nodes at its left and its right end, as one faces it; and the nodes before bays by the bays' names."""

    nodes: Floats
    names: tuple[str, ...]
    rows: tuple[str, ...]
    edges: tuple[tuple[int, int], ...]
    ends: Mapping[str, tuple[int, int]]
    stops: Mapping[str, tuple[Station, int]]


def route_graph(site: SiteMap) -> RouteGraph:
    """The graph of all rows' paths, with a node before each bay that a path comes near. Raises OutputError where rows
    have no common frame."""
    paths = _Paths()
    driven = [drive for drive in drives(site) if len(drive.frames)]
    for drive in driven:
        for piece in _pieces(drive):
            for part in _one_way(piece):
                paths.add(part, drive.row)
    stops = {station.name: (station, stop) for station in stations(site) if (stop := paths.stop(station)) is not None}
    numbers: dict[tuple[float, float], int] = {}
    names, rows = list[str](), list[str]()
    edges: list[tuple[int, int]] = []
    for row, line in zip(paths.rows, map(_spaced, paths.lines), strict=True):
        along = []
        for place in line:
            number = numbers.setdefault(_key(place), len(numbers))
            along.append(number)
            if number == len(rows):
                rows.append(row)
                names.append(f"{visible(row)} / {rows.count(row)}")
        edges += [(min(a, b), max(a, b)) for a, b in pairwise(along) if a != b]
    nodes = np.array(list(numbers), dtype=np.float64).reshape(-1, 2)
    ends = {}
    for drive in driven if len(nodes) else ():
        places = drive.world_from_rig[:, :2, 3]
        along_x = places @ world_from_row(site, drive.row)[:2, 0]
        left, right = (places[number] for number in (np.argmin(along_x), np.argmax(along_x)))
        ends[drive.row] = _nearest_node(nodes, left), _nearest_node(nodes, right)
    before = {name: (station, numbers[_key(stop)]) for name, (station, stop) in stops.items() if _key(stop) in numbers}
    for name, (_, number) in before.items():
        names[number] = name
    unique_names = tuple(unique(list(map(visible, names)), form=IN_BRACKETS))
    return RouteGraph(nodes, unique_names, tuple(map(visible, rows)), tuple(dict.fromkeys(edges)), ends, before)


def _nearest_node(nodes: Floats, place: Floats) -> int:
    return int(np.argmin(np.linalg.norm(nodes - place, axis=1)))


def stations(site: SiteMap) -> list[Station]:
    """All bays, row by row, in the order of their numbers. Raises OutputError where rows have no common frame."""
    bays: dict[tuple[int, int], list[Element]] = {}
    titles: dict[tuple[str, str], list[str]] = {}
    rows = list(site.rows)
    for element in elements(site):
        bay, text = (element.structure.attributes.get(name) for name in (BAY, TEXT))
        if isinstance(bay, int) and len(element.structure.vertices):
            bays.setdefault((rows.index(element.row), bay), []).append(element)
        if isinstance(bay, str) and text:
            titles.setdefault((element.row, bay), []).append(visible(str(text)))
    return [
        Station(
            f"{visible(rows[row])} / {BAY} {number}",
            rows[row],
            np.mean([element.structure.vertices[:, :2].mean(axis=0) for element in parts], axis=0),
            ", ".join(titles.get((rows[row], f"{BAY} {number}"), [])),
        )
        for (row, number), parts in sorted(bays.items(), key=lambda item: item[0])
    ]


class _Paths:
    """Polylines (n, 2) that do not run beside one another, and the row of each."""

    def __init__(self) -> None:
        self.lines: list[Floats] = []
        self.rows: list[str] = []

    def add(self, piece: Floats, row: str) -> None:
        """Take of a path what is not there yet, joined to what is there."""
        stretches = []
        for first, last in _runs(self._distances(piece) > MEET_M):
            stretch = piece[first : last + 1]
            if _length(stretch) < LEAST_M and len(stretch) < len(piece):
                continue
            before = [self._join(piece[first - 1])] if first else []
            after = [self._join(piece[last + 1])] if last + 1 < len(piece) else []
            stretches.append(np.array([*before, *_simplified(stretch), *after]))
        self.lines += stretches
        self.rows += [row] * len(stretches)

    def stop(self, station: Station) -> Floats | None:
        """The place on a path nearest to a bay, which becomes a node; None where no path comes near."""
        if not self.lines:
            return None
        _, _, place = self._nearest(station.place)
        return self._join(place, NEAR_M) if np.linalg.norm(place - station.place) < REACH_M else None

    def _distances(self, points: Floats) -> Floats:
        """How far points (n, 2) are from the nearest line; infinite where there is none."""
        if not self.lines:
            return np.full(len(points), np.inf)
        starts = np.vstack([line[:-1] for line in self.lines])
        ends = np.vstack([line[1:] for line in self.lines])
        away: Floats = np.linalg.norm(_onto(starts, ends, points[:, None]) - points[:, None], axis=2).min(axis=1)
        return away

    def _nearest(self, point: Floats) -> tuple[int, int, Floats]:
        """The nearest place on any line: the line's number, its segment's, and the place."""
        places = [_onto(line[:-1], line[1:], point) for line in self.lines]
        away = [np.linalg.norm(on_line - point, axis=1) for on_line in places]
        number = int(np.argmin([distances.min() for distances in away]))
        segment = int(np.argmin(away[number]))
        return number, segment, places[number][segment]

    def _join(self, point: Floats, near_m: float = MEET_M) -> Floats:
        """The nearest place on a line, which becomes a node of it, or the node near it."""
        number, segment, place = self._nearest(point)
        line = self.lines[number]
        at = int(np.argmin(np.linalg.norm(line - place, axis=1)))
        if np.linalg.norm(line[at] - place) < near_m:
            near: Floats = line[at]
            return near
        self.lines[number] = np.insert(line, segment + 1, place, axis=0)
        return place


def _pieces(drive: Drive) -> Iterator[Floats]:
    """Uninterrupted paths (n, 2) of a drive, pass by pass, with a place every `STEP_M`."""
    places = drive.world_from_rig[:, :2, 3]
    passes = np.array(drive.passes)
    for name in dict.fromkeys(drive.passes):
        path = places[passes == name]
        breaks = np.flatnonzero(np.linalg.norm(np.diff(path, axis=0), axis=1) > GAP_M) + 1
        for part in np.split(path, breaks):
            if _length(part) > STEP_M:
                yield _resampled(part)


def _one_way(path: Floats) -> list[Floats]:
    """The path (n, 2) in parts, split where it turns back along its main direction or across it: what came back along
    the way out can then be told from it. Each part begins where the one before it ends; what is shorter than `LEAST_M`
    stays with what follows."""
    _, _, axes = np.linalg.svd(path - path.mean(axis=0), full_matrices=False)
    parts = [path]
    for axis in axes:
        whole, parts = parts, []
        for part in whole:
            turns = [turn for turn in _turns(part @ axis) if _length(part[: turn + 1]) >= LEAST_M]
            parts += [part[first : last + 1] for first, last in pairwise([0, *turns, len(part) - 1])]
    return parts


def _turns(along: Floats) -> list[int]:
    """Where a coordinate (n) turns back by `LEAST_M` or more."""
    turns: list[int] = []
    low = high = way = 0
    for number, here in enumerate(along.tolist()):
        low = low if along[low] <= here else number
        high = high if along[high] >= here else number
        if way >= 0 and along[high] - here >= LEAST_M:
            turns.append(high)
            way, low = -1, number
        elif way <= 0 and here - along[low] >= LEAST_M:
            turns.append(low)
            way, high = 1, number
    return turns


def _resampled(path: Floats) -> Floats:
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / STEP_M)) + 1))
    return np.column_stack([np.interp(at, along, path[:, axis]) for axis in range(2)])


def _runs(flags: Bools) -> Iterator[tuple[int, int]]:
    """First and last number of each run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    for first, after in edges.reshape(-1, 2).tolist():
        yield first, after - 1


def _simplified(path: Floats) -> Floats:
    """The path with as few places as leave it no further than `STRAIGHT_M` from where it was."""
    if len(path) < 3:
        return path
    away = np.linalg.norm(_onto(path[:1], path[-1:], path) - path, axis=1)
    worst = int(np.argmax(away))
    if away[worst] <= STRAIGHT_M:
        ends: Floats = path[[0, -1]]
        return ends
    whole: Floats = np.vstack([_simplified(path[: worst + 1])[:-1], _simplified(path[worst:])])
    return whole


def _spaced(line: Floats) -> Floats:
    """The line with further nodes, so that no way between two is longer than `SPACING_M`."""
    parts = [line[:1]]
    for start, end in pairwise(line):
        count = max(1, int(np.ceil(np.linalg.norm(end - start) / SPACING_M)))
        parts.append(start + np.linspace(0.0, 1.0, count + 1)[1:, None] * (end - start))
    spaced: Floats = np.vstack(parts)
    return spaced


def _onto(starts: Floats, ends: Floats, point: Floats) -> Floats:
    """The nearest place (n, 2) to a point on each of the segments from starts (n, 2) to ends (n, 2); of points (m, 1,
    2), (m, n, 2)."""
    steps = ends - starts
    squares = np.maximum((steps**2).sum(axis=-1), 1e-18)
    share = np.clip(((point - starts) * steps).sum(axis=-1) / squares, 0.0, 1.0)
    places: Floats = starts + share[..., None] * steps
    return places


def _length(path: Floats) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _key(place: Floats) -> tuple[float, float]:
    x, y = np.round(place, DECIMALS).tolist()
    return x, y
