"""Rows in one frame of the site: a final solve over rows, whose poses are the variables.

Rows stand where the site file says, as exactly as it says. Rows seen from one camera path have a relative pose by it.
Landmarks that two rows mapped are matched where the rows' poses bring them together and no other reading fits nearly as
well; the matches then constrain the rows in turn, and are left out again where they do not fit.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from savmap.assembly.matches import LandmarkMatch, match_landmarks, overlap_record, worst_of_each
from savmap.assembly.misfits import drive_warnings, match_warnings, placement_warnings, with_warnings
from savmap.assembly.overlap import Overlap, Recordings, overlaps
from savmap.graph.site_poses import SitePoses, solve_site_poses
from savmap.types import CrossRowLandmark, CrossRowMatch, Floats, Placement, RowMap, SiteMap, Structure

SQUARE_DEG = 0.2
ROUNDS = 3
GAUGE_SIGMA = 1e-5
REACH_M = 10.0
REACH_SIGMA = 4.0
BACK_DEG, LEAST_DEPTH_M, MOST_UNSURE_M = 10.0, 0.2, 0.8

FindLandmarks = Callable[[str, str, Sequence[Structure]], Sequence[CrossRowLandmark]]
"""A plugin's `cross_row_landmarks` hook, by row, plugin and the plugin's structures in that row."""
Landmarks = Mapping[str, Sequence[CrossRowLandmark]]
"""A row's landmarks by plugin and kind."""


@dataclass(frozen=True)
class Assembly:
    """The site map with placements, matches and warnings about rows that do not fit one another, and notes for the
    user."""

    site_map: SiteMap
    notes: tuple[str, ...] = ()


def assembled(
    site_map: SiteMap,
    priors: Mapping[str, Placement],
    recordings: Recordings,
    find_landmarks: FindLandmarks,
    square_deg: float | None = SQUARE_DEG,
) -> Assembly:
    """The site map with its rows placed.

    `priors`: placements from the site file. `recordings`: the recording that the times of a row's pass belong to.
    `find_landmarks`: asks a plugin of one row. `square_deg`: how far rows may turn from a common grid of right angles,
    or None. A row without a prior that has nothing in common with another row is not placed. Raises PluginError for a
    plugin that fails.
    """
    rows = site_map.rows
    gauge = GAUGE_SIGMA**2 * np.eye(3)  # no prior is tighter than the solver can hold
    given = {
        name: replace(prior, covariance=prior.covariance + gauge) for name, prior in priors.items() if name in rows
    }
    common = list(overlaps(rows, recordings))
    # without any prior, the first row that overlaps with another one is the site's frame
    overlapping = {name for overlap in common for name in (overlap.prior.a, overlap.prior.b)}
    first = [name for name in rows if name in overlapping][:1]
    anchors = given or {name: Placement(0.0, 0.0, 0.0, gauge) for name in first}
    start = first_placements(rows, anchors, common)
    if not start:
        return Assembly(replace(site_map, placements={}, matches=()))
    used = [overlap for overlap in common if overlap.prior.a in start]
    solver = Solver(start, anchors, used, None if square_deg is None else float(np.radians(square_deg)))
    landmarks = {name: landmarks_of(rows[name], find_landmarks) for name in start}
    solved = solver.matched(landmarks)
    drives = [overlap_record(overlap, solved.poses) for overlap in used]
    placed = _placed(site_map, drives, solved)
    warnings = (
        placement_warnings(given, solved.poses),
        drive_warnings(used, drives),
        match_warnings(solved.left_out, solved.poses),
    )
    return Assembly(with_warnings(placed, *warnings), tuple(solved.ambiguous))


def first_placements(
    rows: Mapping[str, RowMap], anchors: Mapping[str, Placement], common: Sequence[Overlap]
) -> dict[str, Placement]:
    """Where the solve starts, in the rows' order: the anchors, and from row to row along camera paths."""
    start = dict(anchors)
    queue = list(anchors)
    for name in queue:
        for prior in (overlap.prior for overlap in common):
            step = prior.a_from_b.site_from_row
            if prior.a == name and prior.b not in start:
                start[prior.b] = _without_covariance(start[name].site_from_row @ step)
                queue.append(prior.b)
            elif prior.b == name and prior.a not in start:
                start[prior.a] = _without_covariance(start[name].site_from_row @ np.linalg.inv(step))
                queue.append(prior.a)
    return {name: start[name] for name in rows if name in start}


def landmarks_of(row: RowMap, find_landmarks: FindLandmarks) -> dict[str, list[CrossRowLandmark]]:
    """A row's landmarks by plugin and kind."""
    landmarks: dict[str, list[CrossRowLandmark]] = {}
    for plugin, structures in row.structures.items():
        for landmark in find_landmarks(row.name, plugin, structures):
            landmarks.setdefault(f"{plugin} {landmark.kind}", []).append(landmark)
    return landmarks


@dataclass(frozen=True, eq=False)
class Solver:
    """What is known of the rows' poses without matches: where to start, anchors, overlaps and the grid of right
    angles."""

    start: Mapping[str, Placement]
    anchors: Mapping[str, Placement]
    overlaps: Sequence[Overlap]
    square_rad: float | None

    def solve(self, matches: Sequence[LandmarkMatch] = ()) -> SitePoses:
        """Poses with these matches, but for those of rows on one camera path, whose relative pose is known better from
        it."""
        on_one_path = {(overlap.prior.a, overlap.prior.b) for overlap in self.overlaps}
        counts = Counter((match.rows, match.kind) for match in matches)
        points = [
            match.constraint(counts[match.rows, match.kind]) for match in matches if match.rows not in on_one_path
        ]
        priors = [overlap.prior for overlap in self.overlaps]
        return solve_site_poses(self.start, self.anchors, priors, points, self.square_rad)

    def matched(self, landmarks: Mapping[str, Landmarks]) -> "Matched":
        """Landmarks are matched until no more are found, and matches that do not fit are left out."""
        poses, matches, left_out = self.solve(), list[LandmarkMatch](), list[LandmarkMatch]()
        for _ in range(ROUNDS):
            done = {(match.rows, match.kind) for match in matches}
            new, ambiguous = _new_matches(landmarks, poses, done)
            poses, matches, rejected = self._without_outliers([*matches, *new])
            left_out += rejected
            if not new:
                break
        return Matched(poses, matches, left_out, ambiguous)

    def _without_outliers(
        self, matches: list[LandmarkMatch]
    ) -> tuple[SitePoses, list[LandmarkMatch], list[LandmarkMatch]]:
        poses, left_out = self.solve(matches), list[LandmarkMatch]()
        while outliers := worst_of_each([match for match in matches if not match.fits(poses)], poses):
            left_out += outliers
            matches = [match for match in matches if match not in outliers]
            poses = self.solve(matches)
        return poses, matches, left_out


@dataclass(frozen=True, eq=False)
class Matched:
    """Rows' poses, the matches that constrain them, those that were left out, and a note for each pair of rows that is
    ambiguous."""

    poses: SitePoses
    matches: Sequence[LandmarkMatch]
    left_out: Sequence[LandmarkMatch]
    ambiguous: Sequence[str]


def _new_matches(
    landmarks: Mapping[str, Landmarks], poses: SitePoses, done: set[tuple[tuple[str, str], str]]
) -> tuple[list[LandmarkMatch], list[str]]:
    """Matches of pairs of rows and kinds that are not done yet, and a note for each pair that is ambiguous."""
    matches, notes = list[LandmarkMatch](), list[str]()
    for a, b in combinations(landmarks, 2):
        kinds = [kind for kind in landmarks[a] if kind in landmarks[b] and ((a, b), kind) not in done]
        if not kinds or not _are_near(landmarks[a], landmarks[b], poses.rows[a], poses.rows[b]):
            continue
        a_from_b = poses.relative(a, b)
        for kind in kinds:
            of_a, of_b = landmarks[a][kind], landmarks[b][kind]
            if not _can_share(of_a[0], of_b[0], a_from_b):
                continue
            result = match_landmarks(of_a, of_b, a_from_b)
            matches += [LandmarkMatch(a, b, kind, of_a[i], of_b[j], a_from_b) for i, j in result.pairs]
            if result.ambiguous:
                notes.append(f"rows {a} and {b}: which {of_a[0].kind} is which is ambiguous; none of them is matched")
    return matches, notes


def _are_near(of_a: Landmarks, of_b: Landmarks, a: Placement, b: Placement) -> bool:
    """Whether the landmarks of two rows come so near on the floor that they may match."""
    low_a, high_a = _extent(of_a, a)
    low_b, high_b = _extent(of_b, b)
    unsure = REACH_SIGMA * np.sqrt(max(np.trace(row.covariance[:2, :2]) for row in (a, b)))
    return bool((np.maximum(low_a, low_b) <= np.minimum(high_a, high_b) + REACH_M + unsure).all())


def _extent(landmarks: Landmarks, placement: Placement) -> tuple[Floats, Floats]:
    places = np.array([landmark.place for group in landmarks.values() for landmark in group])
    points = placement.points(places)[:, [0, 2]]
    return points.min(axis=0), points.max(axis=0)


def _can_share(of_a: CrossRowLandmark, of_b: CrossRowLandmark, a_from_b: Placement) -> bool:
    """Whether rows with this relative pose can have landmarks of this kind in common."""
    off = (a_from_b.heading_deg + 90) % 180 - 90
    if not {"x", "z"} <= set(of_a.axes) & set(of_b.axes) and abs(off) > BACK_DEG:
        return False
    deepest = min((landmark.behind_m for landmark in (of_a, of_b) if landmark.behind_m is not None), default=None)
    if deepest is None:
        return True
    depth = -a_from_b.points(of_b.place[None])[0, 2]
    unsure = min(2 * float(np.sqrt(a_from_b.covariance[1, 1])), MOST_UNSURE_M)
    return abs(a_from_b.heading_deg) > 180 - BACK_DEG and LEAST_DEPTH_M - unsure < depth < deepest + unsure


def _without_covariance(site_from_row: Floats) -> Placement:
    """A first placement, of which the covariance is not used."""
    heading = float(np.degrees(np.arctan2(site_from_row[0, 2], site_from_row[0, 0])))
    return Placement(float(site_from_row[0, 3]), float(site_from_row[2, 3]), heading, np.eye(3))


def _placed(site_map: SiteMap, drives: Sequence[CrossRowMatch], solved: "Matched") -> SiteMap:
    """The site map with the rows' placements, and with drives and matches in the rows' order."""
    records = [*drives, *(match.record(solved.poses) for match in solved.matches)]
    order = {name: number for number, name in enumerate(site_map.rows)}
    records.sort(key=lambda record: (order[record.row_a], order[record.row_b]))
    return replace(site_map, placements=dict(solved.poses.rows), matches=tuple(records))


def site_lines(site: SiteMap) -> Iterator[str]:
    """Lines of rows' placements, then of the matches of every two rows by kind: how many, and how far their two places
    are apart, cm. None where no row is placed."""
    if not site.placements:
        return
    wide = 2 * max(map(len, site.placements)) + 4
    yield f"{'row':>{wide}}{'x m':>10}{'z m':>10}{'heading':>10}{'sigma: x, z cm':>16}{'deg':>7}"
    for name, placement in site.placements.items():
        x, z, turn = np.sqrt(np.diag(placement.covariance))
        pose = (placement.x_m, placement.z_m, placement.heading_deg)
        where = "".join(f"{round(value, 3) + 0.0:10.3f}" for value in pose)
        yield f"{name:>{wide}}{where}{100 * x:10.1f}{100 * z:6.1f}{turn:7.3f}"
    left = [name for name in site.rows if name not in site.placements]
    if left:
        yield f"not placed: {', '.join(left)} (they have no given place, and nothing in common with a row that has one)"
        yield "give each a `place`, or the site a `layout`: exports of several rows leave out those that have none"
    if site.matches:
        columns = f"{'n':>4}{'x':>8}{'y':>8}{'z':>8}{'largest':>9}"
        yield f"{'rows':>{wide}}  {'in common':<16}{columns}   apart, cm (rms); sigmas"
        for (a, b, kind), matches in matches_by_kind(site.matches).items():
            yield f"{a + ', ' + b:>{wide}}  {kind:<16}{len(matches):4d}{_figures(matches)}"


def matches_by_kind(matches: Sequence[CrossRowMatch]) -> dict[tuple[str, str, str], list[CrossRowMatch]]:
    """Matches by their two rows and by the kind of what these have in common."""
    groups: dict[tuple[str, str, str], list[CrossRowMatch]] = {}
    for match in matches:
        kind = " ".join(word for word in match.id_a.split() if word.isalpha())
        groups.setdefault((match.row_a, match.row_b, kind), []).append(match)
    return groups


def _figures(matches: Sequence[CrossRowMatch]) -> str:
    residuals = np.array([match.residual_m for match in matches])
    sigmas = np.abs(residuals / np.array([match.sigma_m for match in matches]))
    axes = [values[~np.isnan(values)] for values in residuals.T]
    cells = (f"{100 * float(np.sqrt(np.mean(values**2))):8.1f}" if len(values) else f"{'-':>8}" for values in axes)
    return "".join(cells) + f"{np.nanmax(sigmas):9.1f}"
