"""Rows that were seen from one camera path: the same frames have a pose in either row's frame, which gives their
relative pose."""

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.geometry.poses import columns_at, poses_at
from savmap.graph.site_poses import RelativePosePrior
from savmap.types import Bools, Floats, Placement, RowMap, array_record

LEAST_FRAMES = 3
LONGEST_GAP_S = 0.5
SAME_S = 1e-4
UNKNOWN_SIGMA_M = 0.02
TURN_SIGMA_RAD = float(np.radians(0.2))
MEDIAN_SQUARE = 0.4549

Recordings = Mapping[str, Mapping[str, Hashable]]


@dataclass(frozen=True, eq=False)
@array_record
class Overlap:
    """Two rows' common path: b's frame in a's, the number of frames, their mean position (3,) m in either row's frame,
    and the standard deviation (3,) m of the difference between the two along a's axes."""

    prior: RelativePosePrior
    count: int
    in_a: Floats
    in_b: Floats
    sigma_m: Floats


@dataclass(frozen=True, eq=False)
@array_record
class Path:
    """A row's poses (n, 4, 4) in one recording, with times (n,) s in order and standard deviations (n, 3) m of
    places."""

    stamps_s: Floats
    poses: Floats
    sigma_m: Floats

    def at(self, stamps_s: Floats) -> "tuple[Bools, Path]":
        """Which of the times (m,) lie between located frames no further apart than `LONGEST_GAP_S`, as a mask, and the
        path there."""
        after = np.clip(np.searchsorted(self.stamps_s, stamps_s - SAME_S), 0, len(self.stamps_s) - 1)
        before = np.maximum(after - 1, 0)
        exact = np.abs(self.stamps_s[after] - stamps_s) <= SAME_S
        inside = (self.stamps_s[before] < stamps_s) & (stamps_s < self.stamps_s[after])
        near = inside & (self.stamps_s[after] - self.stamps_s[before] <= LONGEST_GAP_S)
        asked = np.clip(stamps_s, self.stamps_s[0], self.stamps_s[-1])[exact | near]
        poses = poses_at(asked, self.stamps_s, self.poses)
        return exact | near, Path(asked, poses, columns_at(asked, self.stamps_s, self.sigma_m))


def overlaps(rows: Mapping[str, RowMap], recordings: Recordings) -> Iterator[Overlap]:
    """Every two rows with poses of the same frames; recordings[row][pass] is the recording that a pass's times belong
    to."""
    paths = {name: paths_of(row, recordings.get(name, {})) for name, row in rows.items()}
    for a, b in combinations(paths, 2):
        pairs = [_common(path, paths[b][video]) for video, path in paths[a].items() if video in paths[b]]
        if sum(len(of_a.stamps_s) for of_a, _ in pairs) >= LEAST_FRAMES:
            yield overlap(a, b, _joined([of_a for of_a, _ in pairs]), _joined([of_b for _, of_b in pairs]))


def paths_of(row: RowMap, recordings: Mapping[str, Hashable]) -> dict[Hashable, Path]:
    """A row's located frames by recording."""
    sigma = row.trajectory.sigma_m
    sigmas = np.full((len(row.trajectory.frames), 3), UNKNOWN_SIGMA_M) if sigma is None else sigma
    videos = [recordings.get(row.frames.passes[frame]) for frame in row.trajectory.frames.tolist()]
    stamps = row.frames.stamps_s[row.trajectory.frames]
    paths: dict[Hashable, Path] = {}
    for video in dict.fromkeys(name for name in videos if name is not None):
        chosen = np.flatnonzero([name == video for name in videos])
        chosen = chosen[np.unique(stamps[chosen], return_index=True)[1]]
        if len(chosen) >= LEAST_FRAMES:
            paths[video] = Path(stamps[chosen], row.trajectory.world_from_rig[chosen], sigmas[chosen])
    return paths


def overlap(a: str, b: str, of_a: Path, of_b: Path) -> Overlap:
    """b's frame in a's from poses of the same frames, whose positions on the floor and headings agree.

    A row's errors are common to its whole path (where its face is, how long it is). Many frames therefore measure a
    shift no better than one does, and a turn no better than the two ends of the path. If the paths differ by more than
    their standard deviations allow, the covariance is enlarged.
    """
    places_a, places_b = of_a.poses[:, :3, 3], of_b.poses[:, :3, 3]
    spread = np.sqrt(of_a.sigma_m**2 + of_b.sigma_m**2)
    sigma = np.sqrt(np.mean(spread**2, axis=0))
    turns = of_a.poses[:, :3, :3] @ np.swapaxes(of_b.poses[:, :3, :3], 1, 2)
    turn = Rotation.from_matrix(turns).mean().as_matrix()
    heading = float(np.arctan2(turn[0, 2] - turn[2, 0], turn[0, 0] + turn[2, 2]))
    centre_a, centre_b = places_a.mean(axis=0), places_b.mean(axis=0)

    def left(unknown: Floats) -> Floats:
        moved = _turned(places_b - centre_b, unknown[2]) + unknown[[0, 0, 1]] * [1, 0, 1] + centre_a
        off = ((moved - places_a) / spread)[:, [0, 2]]
        return np.append(off.ravel(), np.sqrt(len(spread)) * (unknown[2] - heading) / TURN_SIGMA_RAD)

    from scipy.optimize import least_squares  # half a second, which a site of one row does not need

    solved = least_squares(left, [0.0, 0.0, heading], loss="huber").x
    on_floor = (places_b - centre_b)[:, [0, 2]]
    length = float(np.ptp(places_b[:, [0, 2]] @ np.linalg.svd(on_floor, full_matrices=False)[2][0]))
    by_ends = 2 * float(np.max(sigma[[0, 2]])) / max(length, 1e-3)
    turn_sigma = (by_ends**-2 + TURN_SIGMA_RAD**-2) ** -0.5
    misfit = max(1.0, float(np.median(left(solved)[:-1] ** 2)) / MEDIAN_SQUARE)
    shift = centre_a + solved[[0, 0, 1]] * [1, 0, 1] - _turned(centre_b[None], solved[2])[0]
    covariance = misfit * np.diag([*sigma[[0, 2]] ** 2, np.degrees(turn_sigma) ** 2])
    arm = np.radians(_turned(centre_b[None], solved[2])[0])
    slope = np.array([[1, 0, -arm[2]], [0, 1, arm[0]], [0, 0, 1]])
    place = Placement(float(shift[0]), float(shift[2]), float(np.degrees(solved[2])), slope @ covariance @ slope.T)
    return Overlap(RelativePosePrior(a, b, place), len(spread), centre_a, centre_b, np.sqrt(misfit) * sigma)


def _common(of_a: Path, of_b: Path) -> tuple[Path, Path]:
    """Both paths at the times of a's at which b has a pose."""
    shared, at_these = of_b.at(of_a.stamps_s)
    return Path(of_a.stamps_s[shared], of_a.poses[shared], of_a.sigma_m[shared]), at_these


def _joined(paths: list[Path]) -> Path:
    return Path(*(np.concatenate([getattr(path, name) for path in paths]) for name in ("stamps_s", "poses", "sigma_m")))


def _turned(points: Floats, heading_rad: float) -> Floats:
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    turned: Floats = points @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T
    return turned
