"""Rows in one frame of the site: a final solve over rows, whose poses are the variables.

Rows stand where the site file says, as well as it knows. Rows seen from one camera path are tied by it; things that two rows mapped
are matched where these place them and no other reading comes near, tie the rows in turn, and are left out again where they do not fit.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from savmap.assembly.matching import match
from savmap.assembly.overlap import Overlap, Recordings, overlaps
from savmap.assembly.ties import Found, fits, path_tie, worst_of_each
from savmap.graph.site_poses import SitePoses, solve_site_poses
from savmap.types import CrossRowLandmark, Floats, Placement, RowMap, SiteMap, Structure

SQUARE_DEG = 0.2
ROUNDS = 3
GAUGE_SIGMA = 1e-5
REACH_M = 10.0
OFF_SIGMA = 4.0
BACK_DEG, LEAST_DEPTH_M, MOST_UNSURE_M = 10.0, 0.2, 0.8

Ask = Callable[[str, Sequence[Structure]], Sequence[CrossRowLandmark]]
Things = Mapping[str, Mapping[str, Sequence[CrossRowLandmark]]]


@dataclass(frozen=True)
class Assembly:
    """The site map with rows placed and their ties, and a line for each thing that the user should know."""

    site_map: SiteMap
    notes: tuple[str, ...] = ()


def assembled(
    site_map: SiteMap,
    priors: Mapping[str, Placement],
    recordings: Recordings,
    ask: Ask,
    square_deg: float | None = SQUARE_DEG,
) -> Assembly:
    """The site map with its rows placed.

    `priors`: where rows are said to stand. `recordings`: in which recording the times of a row's passes are. `ask`: a plugin's
    `shared` hook, by the plugin's name. `square_deg`: how far rows may turn from a common grid of right angles, or None. A row that is
    tied to no other and has no place of its own stays without. Raises PluginError for a plugin that fails.
    """
    rows = site_map.rows
    known = {name: _no_better(place) for name, place in priors.items() if name in rows}
    found = list(overlaps(rows, recordings))
    anchors = known or gauge_of(rows, found)
    start = reached(rows, anchors, found)
    if not start:
        return Assembly(replace(site_map, placed={}, ties=()))
    used = [one for one in found if one.tie.a in start]
    solver = Solver(start, anchors, used, None if square_deg is None else float(np.radians(square_deg)))
    things = {name: things_of(rows[name], ask) for name in start}
    return _told(site_map, solver, *solver.settled(things), known)


def gauge_of(rows: Mapping[str, RowMap], found: Sequence[Overlap]) -> dict[str, Placement]:
    """Where nothing is said of any row's place, the first row that hangs together with another is the site's frame."""
    tied = {name for one in found for name in (one.tie.a, one.tie.b)}
    first = next((name for name in rows if name in tied), None)
    return {} if first is None else {first: Placement(0.0, 0.0, 0.0, GAUGE_SIGMA**2 * np.eye(3))}


def reached(
    rows: Mapping[str, RowMap], anchors: Mapping[str, Placement], found: Sequence[Overlap]
) -> dict[str, Placement]:
    """First places, in the rows' order: the anchors', and from row to row along camera paths."""
    places = dict(anchors)
    queue = list(anchors)
    for name in queue:
        for one in found:
            step = one.tie.a_from_b
            if one.tie.a == name and one.tie.b not in places:
                places[one.tie.b] = _chained(places[name].site_from_row @ step.site_from_row)
                queue.append(one.tie.b)
            elif one.tie.b == name and one.tie.a not in places:
                places[one.tie.a] = _chained(places[name].site_from_row @ np.linalg.inv(step.site_from_row))
                queue.append(one.tie.a)
    return {name: places[name] for name in rows if name in places}


def things_of(row: RowMap, ask: Ask) -> dict[str, list[CrossRowLandmark]]:
    """What a row shares with others, by plugin and kind."""
    things: dict[str, list[CrossRowLandmark]] = {}
    for plugin, structures in row.structures.items():
        for thing in ask(plugin, structures):
            things.setdefault(f"{plugin} {thing.kind}", []).append(thing)
    return things


@dataclass(frozen=True)
class Solver:
    """What is known of the rows' places beside the things they share."""

    start: Mapping[str, Placement]
    anchors: Mapping[str, Placement]
    overlaps: Sequence[Overlap]
    square_rad: float | None

    def solve(self, found: Sequence[Found] = ()) -> SitePoses:
        """SitePoses with these matches; those of rows on one camera path are told by it already."""
        together = self.together
        counts = Counter((own.rows, own.kind) for own in found)
        points = [own.tie(counts[own.rows, own.kind]) for own in found if own.rows not in together]
        return solve_site_poses(self.start, self.anchors, [one.tie for one in self.overlaps], points, self.square_rad)

    @property
    def together(self) -> set[tuple[str, str]]:
        """Rows on one camera path."""
        return {(one.tie.a, one.tie.b) for one in self.overlaps}

    def settled(self, things: Things) -> tuple[SitePoses, list[Found], list[str]]:
        """Matches of things are looked for until there are no more, and those that do not fit are left out one after the other."""
        places, found, notes = self.solve(), list[Found](), list[str]()
        for _ in range(ROUNDS):
            tried = {(own.rows, own.kind) for own in found}
            new, doubtful = _matches(things, places, tried)
            places, found, rejected = self._fitting([*found, *new])
            notes += rejected
            if not new:
                break
        return places, found, [*notes, *doubtful]

    def _fitting(self, found: list[Found]) -> tuple[SitePoses, list[Found], list[str]]:
        places, notes = self.solve(found), list[str]()
        while wrong := worst_of_each([own for own in found if not fits(own, places)], places):
            notes += [f"{own} is left out: it is {own.told(places)} off" for own in wrong]
            found = [own for own in found if own not in wrong]
            places = self.solve(found)
        return places, found, notes


def _matches(
    things: Things, places: SitePoses, tried: set[tuple[tuple[str, str], str]]
) -> tuple[list[Found], list[str]]:
    found, doubtful = list[Found](), list[str]()
    for a, b in combinations(things, 2):
        kinds = [kind for kind in things[a] if kind in things[b] and ((a, b), kind) not in tried]
        if not kinds or not _near(things[a], things[b], places.rows[a], places.rows[b]):
            continue
        a_from_b = places.relative(a, b)
        for kind in kinds:
            own_a, own_b = things[a][kind], things[b][kind]
            if not _can_share(own_a[0], own_b[0], a_from_b):
                continue
            result = match(own_a, own_b, a_from_b)
            found += [Found(a, b, kind, own_a[i], own_b[j], a_from_b) for i, j in result.pairs]
            if result.ambiguous:
                doubtful.append(f"rows {a} and {b}: which {own_a[0].kind} is which is not clear; none ties them")
    return found, doubtful


def _near(
    things_a: Mapping[str, Sequence[CrossRowLandmark]],
    things_b: Mapping[str, Sequence[CrossRowLandmark]],
    a: Placement,
    b: Placement,
) -> bool:
    """Whether two rows' things come near enough on the floor to be worth a look."""
    low_a, high_a = _extent(things_a, a)
    low_b, high_b = _extent(things_b, b)
    unsure = OFF_SIGMA * np.sqrt(max(np.trace(own.covariance[:2, :2]) for own in (a, b)))
    return bool((np.maximum(low_a, low_b) <= np.minimum(high_a, high_b) + REACH_M + unsure).all())


def _extent(things: Mapping[str, Sequence[CrossRowLandmark]], place: Placement) -> tuple[Floats, Floats]:
    points = place.points(np.array([thing.place for own in things.values() for thing in own]))[:, [0, 2]]
    return points.min(axis=0), points.max(axis=0)


def _can_share(one: CrossRowLandmark, other: CrossRowLandmark, a_from_b: Placement) -> bool:
    """Whether rows that stand so can have things of this kind in common."""
    off = (a_from_b.heading_deg + 90) % 180 - 90
    if not {"x", "z"} <= set(one.axes) & set(other.axes) and abs(off) > BACK_DEG:
        return False
    deepest = min((own.behind_m for own in (one, other) if own.behind_m is not None), default=None)
    if deepest is None:
        return True
    depth = -a_from_b.points(other.place[None])[0, 2]
    unsure = min(2 * float(np.sqrt(a_from_b.covariance[1, 1])), MOST_UNSURE_M)
    return abs(a_from_b.heading_deg) > 180 - BACK_DEG and LEAST_DEPTH_M - unsure < depth < deepest + unsure


def _no_better(place: Placement) -> Placement:
    """A place that is not known better than anything can be."""
    return replace(place, covariance=place.covariance + GAUGE_SIGMA**2 * np.eye(3))


def _chained(site_from_row: Floats) -> Placement:
    heading = float(np.degrees(np.arctan2(site_from_row[0, 2], site_from_row[0, 0])))
    return Placement(float(site_from_row[0, 3]), float(site_from_row[2, 3]), heading, np.eye(3))


def _told(
    site_map: SiteMap,
    solver: Solver,
    places: SitePoses,
    found: Sequence[Found],
    notes: Sequence[str],
    known: Mapping[str, Placement],
) -> Assembly:
    ties = [path_tie(one, places) for one in solver.overlaps] + [own.shown(places) for own in found]
    order = {name: number for number, name in enumerate(site_map.rows)}
    ties.sort(key=lambda tie: (order[tie.row_a], order[tie.row_b]))
    off = [line for name, prior in known.items() if (line := _off_prior(name, prior, places.rows[name]))]
    return Assembly(replace(site_map, placed=dict(places.rows), ties=tuple(ties)), (*notes, *off))


def _off_prior(name: str, prior: Placement, place: Placement) -> str:
    """A line where a row does not stand where it is said to."""
    heading = (place.heading_deg - prior.heading_deg + 180) % 360 - 180
    off = np.array([place.x_m - prior.x_m, place.z_m - prior.z_m, heading])
    if off @ np.linalg.solve(prior.covariance, off) < OFF_SIGMA**2:
        return ""
    return (
        f"row {name} stands {np.hypot(*off[:2]):.2f} m and {abs(heading):.2f} degrees from the place it was given, by what ties it to "
        "other rows"
    )
