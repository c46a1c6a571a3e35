"""Where one can drive: a graph along the paths that the camera was driven.

A path that comes near another one joins it there; what runs along it is not taken twice. Nothing is joined that was not
driven.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from savmap.errors import visible
from savmap.maps.exports.frames import Drive, drives, world_from_row
from savmap.maps.exports.marks import IN_BRACKETS, unique
from savmap.maps.exports.plans.stations import Station, stations
from savmap.types import Bools, Floats, SiteMap, array_record

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
    lines = [_spaced(line) for line in paths.lines]
    numbers: dict[tuple[float, float], int] = {}
    rows: list[str] = []
    edges: list[tuple[int, int]] = []
    for row, line in zip(paths.rows, lines, strict=True):
        along = []
        for x, y in np.round(line, DECIMALS).tolist():
            if (x, y) not in numbers:
                rows.append(row)
            along.append(numbers.setdefault((x, y), len(numbers)))
        edges += [(min(a, b), max(a, b)) for a, b in pairwise(along) if a != b]
    nodes = np.array(list(numbers), dtype=np.float64).reshape(-1, 2)
    ends = {drive.row: _ends(drive, world_from_row(site, drive.row), nodes) for drive in driven if len(nodes)}
    before = {name: (station, numbers[_key(stop)]) for name, (station, stop) in stops.items() if _key(stop) in numbers}
    names = list(_names(rows))
    for name, (_, number) in before.items():
        names[number] = name
    named = tuple(unique(list(map(visible, names)), form=IN_BRACKETS))
    return RouteGraph(nodes, named, tuple(map(visible, rows)), tuple(dict.fromkeys(edges)), ends, before)


class _Paths:
    """Polylines (n, 2) that do not run beside one another, and the row of each."""

    def __init__(self) -> None:
        self.lines: list[Floats] = []
        self.rows: list[str] = []

    def add(self, piece: Floats, row: str) -> None:
        """Take of a path what is not there yet, joined to what is there."""
        apart = self._distances(piece) > MEET_M
        found = []
        for first, last in _runs(apart):
            stretch = piece[first : last + 1]
            if _length(stretch) < LEAST_M and len(stretch) < len(piece):
                continue
            before = [self._join(piece[first - 1])] if first else []
            after = [self._join(piece[last + 1])] if last + 1 < len(piece) else []
            found.append(np.array([*before, *_simplified(stretch), *after]))
        self.lines += found
        self.rows += [row] * len(found)

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
    """The path (n, 2) in parts, split where it turns back along its main direction or across it: what came back beside
    the way out can then be told from it. Each part begins where the one before it ends."""
    _, _, axes = np.linalg.svd(path - path.mean(axis=0), full_matrices=False)
    parts = [path]
    for axis in axes:
        parts = [split for part in parts for split in _split(part, _turns(part @ axis))]
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


def _split(path: Floats, turns: Sequence[int]) -> list[Floats]:
    """The path's parts between the turns, which belong to both sides. What is shorter than `LEAST_M` stays with what
    follows."""
    starts = [0, *(turn for turn in turns if _length(path[: turn + 1]) >= LEAST_M)]
    return [path[first : last + 1] for first, last in pairwise([*starts, len(path) - 1])]


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


def _ends(drive: Drive, world_from_row: Floats, nodes: Floats) -> tuple[int, int]:
    """The nodes nearest to where the drive begins and ends along the row's x axis."""
    places = drive.world_from_rig[:, :2, 3]
    along = places @ world_from_row[:2, 0]
    left, right = (
        int(np.argmin(np.linalg.norm(nodes - places[number], axis=1)))
        for number in (np.argmin(along), np.argmax(along))
    )
    return left, right


def _key(place: Floats) -> tuple[float, float]:
    x, y = np.round(place, DECIMALS).tolist()
    return x, y


def _names(rows: Sequence[str]) -> Iterator[str]:
    counts: dict[str, int] = {}
    for row in rows:
        counts[row] = counts.get(row, 0) + 1
        yield f"{visible(row)} / {counts[row]}"
