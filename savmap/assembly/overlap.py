"""Rows that were seen from one camera path: the same pictures have a pose in either row's frame, which ties the two."""

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation, Slerp

from savmap.graph.site_poses import RelativePosePrior
from savmap.types import Floats, Placement, RowMap

LEAST_FRAMES = 3
LONGEST_GAP_S = 0.5
SAME_S = 1e-4
UNKNOWN_SIGMA_M = 0.02
TURN_SIGMA_RAD = float(np.radians(0.2))
MEDIAN_SQUARE = 0.4549

Bools = NDArray[np.bool_]
Recordings = Mapping[str, Mapping[str, Hashable]]


@dataclass(frozen=True)
class Overlap:
    """Two rows' common path: b's frame in a's, how many pictures, their mean place (3,) m in either row's frame, and the standard
    deviation (3,) m of what is between the two along a's axes."""

    tie: RelativePosePrior
    count: int
    in_a: Floats
    in_b: Floats
    sigma_m: Floats


@dataclass(frozen=True)
class Path:
    """A row's poses (n, 4, 4) in one recording, with times (n,) s in order and standard deviations (n, 3) m of places."""

    stamps_s: Floats
    poses: Floats
    sigma_m: Floats

    def at(self, stamps_s: Floats) -> "tuple[Bools, Path]":
        """Which of the times (m,) lie between located frames no further apart than `LONGEST_GAP_S`, as a mask, and the path there."""
        after = np.clip(np.searchsorted(self.stamps_s, stamps_s - SAME_S), 0, len(self.stamps_s) - 1)
        before = np.maximum(after - 1, 0)
        exact = np.abs(self.stamps_s[after] - stamps_s) <= SAME_S
        inside = (self.stamps_s[before] < stamps_s) & (stamps_s < self.stamps_s[after])
        near = inside & (self.stamps_s[after] - self.stamps_s[before] <= LONGEST_GAP_S)
        asked = np.clip(stamps_s, self.stamps_s[0], self.stamps_s[-1])[exact | near]
        poses = np.tile(np.eye(4), (len(asked), 1, 1))
        if len(asked):
            poses[:, :3, :3] = Slerp(self.stamps_s, Rotation.from_matrix(self.poses[:, :3, :3]))(asked).as_matrix()
            poses[:, :3, 3] = _columns(asked, self.stamps_s, self.poses[:, :3, 3])
        return exact | near, Path(asked, poses, _columns(asked, self.stamps_s, self.sigma_m))


def overlaps(rows: Mapping[str, RowMap], recordings: Recordings) -> Iterator[Overlap]:
    """Every two rows with poses for the same pictures: recordings[row][pass] tells in which recording a pass's times are."""
    paths = {name: paths_of(row, recordings.get(name, {})) for name, row in rows.items()}
    for a, b in combinations(paths, 2):
        pairs = [_common(own, paths[b][video]) for video, own in paths[a].items() if video in paths[b]]
        if sum(len(one.stamps_s) for one, _ in pairs) >= LEAST_FRAMES:
            yield overlap(a, b, _joined([one for one, _ in pairs]), _joined([other for _, other in pairs]))


def paths_of(row: RowMap, recordings: Mapping[str, Hashable]) -> dict[Hashable, Path]:
    """A row's located frames by recording."""
    sigma = row.trajectory.sigma_m
    sigmas = np.full((len(row.trajectory.frames), 3), UNKNOWN_SIGMA_M) if sigma is None else sigma
    videos = [recordings.get(row.frames.passes[frame]) for frame in row.trajectory.frames.tolist()]
    stamps = row.frames.stamps_s[row.trajectory.frames]
    found: dict[Hashable, Path] = {}
    for video in dict.fromkeys(one for one in videos if one is not None):
        own = np.flatnonzero([one == video for one in videos])
        own = own[np.unique(stamps[own], return_index=True)[1]]
        if len(own) >= LEAST_FRAMES:
            found[video] = Path(stamps[own], row.trajectory.world_from_rig[own], sigmas[own])
    return found


def overlap(a: str, b: str, one: Path, other: Path) -> Overlap:
    """b's frame in a's from poses of the same pictures: places on the floor agree, and headings.

    A row's errors are common to its whole path (where its face is, how long it is), so that many frames tell a shift no better than
    one does, and a turn no better than the two ends of the path; what the two paths differ by more than they should is added.
    """
    places_a, places_b = one.poses[:, :3, 3], other.poses[:, :3, 3]
    spread = np.sqrt(one.sigma_m**2 + other.sigma_m**2)
    sigma = np.sqrt(np.mean(spread**2, axis=0))
    turns = one.poses[:, :3, :3] @ np.swapaxes(other.poses[:, :3, :3], 1, 2)
    heading = _heading(Rotation.from_matrix(turns).mean().as_matrix())
    centre_a, centre_b = places_a.mean(axis=0), places_b.mean(axis=0)

    def left(unknown: Floats) -> Floats:
        moved = _turned(places_b - centre_b, unknown[2]) + unknown[[0, 0, 1]] * [1, 0, 1] + centre_a
        off = ((moved - places_a) / spread)[:, [0, 2]]
        return np.append(off.ravel(), np.sqrt(len(spread)) * (unknown[2] - heading) / TURN_SIGMA_RAD)

    found = least_squares(left, [0.0, 0.0, heading], loss="huber").x
    length = float(np.ptp(places_b[:, [0, 2]] @ _along(places_b[:, [0, 2]])))
    by_ends = 2 * float(np.max(sigma[[0, 2]])) / max(length, 1e-3)
    turn_sigma = (by_ends**-2 + TURN_SIGMA_RAD**-2) ** -0.5
    misfit = max(1.0, float(np.median(left(found)[:-1] ** 2)) / MEDIAN_SQUARE)
    shift = centre_a + found[[0, 0, 1]] * [1, 0, 1] - _turned(centre_b[None], found[2])[0]
    own = misfit * np.diag([*sigma[[0, 2]] ** 2, np.degrees(turn_sigma) ** 2])
    arm = np.radians(_turned(centre_b[None], found[2])[0])
    slope = np.array([[1, 0, -arm[2]], [0, 1, arm[0]], [0, 0, 1]])
    place = Placement(float(shift[0]), float(shift[2]), float(np.degrees(found[2])), slope @ own @ slope.T)
    return Overlap(RelativePosePrior(a, b, place), len(spread), centre_a, centre_b, np.sqrt(misfit) * sigma)


def _common(one: Path, other: Path) -> tuple[Path, Path]:
    """Both paths at the times of the first for which the other knows a pose."""
    shared, seen = other.at(one.stamps_s)
    return Path(one.stamps_s[shared], one.poses[shared], one.sigma_m[shared]), seen


def _joined(paths: list[Path]) -> Path:
    return Path(*(np.concatenate([getattr(own, name) for own in paths]) for name in ("stamps_s", "poses", "sigma_m")))


def _columns(wanted: Floats, known: Floats, values: Floats) -> Floats:
    return np.stack([np.interp(wanted, known, column) for column in values.T], axis=1)


def _heading(turn: Floats) -> float:
    """Angle about y of a rotation (3, 3) that is one about y, or nearly."""
    return float(np.arctan2(turn[0, 2] - turn[2, 0], turn[0, 0] + turn[2, 2]))


def _turned(points: Floats, heading_rad: float) -> Floats:
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    turned: Floats = points @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T
    return turned


def _along(places: Floats) -> Floats:
    """The unit vector (2,) along which places (n, 2) spread most."""
    axis: Floats = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)[2][0]
    return axis
