"""Relations between lamps, tested on the data: equal heights, and a line parallel to the aisle."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from scipy.special import chdtri

import savmap.plugin as door
from savmap.plugin import Floats, RowFacts, Track, Trajectory

AXES: tuple[door.Axis, ...] = ("y", "z")
ALIKE_SIGMA = 3.0
HANGS_M = 0.005
TIED_M = 0.003
MOST = 0.6
FEWEST = 3
HALVINGS = 30
SQRT_2 = 2**0.5
STATED = 4
"""The weight of the stated standard deviations in a variance, in measurements; the residuals of the rays have the other
part."""


def ties(
    tracks: Sequence[Track],
    keys: Mapping[str, Mapping[str, int]],
    facts: RowFacts,
    path: Trajectory,
    on_a_line: bool,
) -> list[door.Relation]:
    """Relations between the same parts of neighbouring lamps. With `on_a_line`, the user says that all lamps have one
    height and one line, and all relations are given. Else equal y, and equal z, are given if they hold for most lamps,
    between the lamps for which they hold."""
    if on_a_line:
        by_part = _are_across(tracks, facts, path)
        return [*_all_equal("y", keys, False), *_all_equal("z", keys, by_part)]
    return [relation for axis in AXES for relation in _tied(tracks, keys, facts, path, axis)]


def _are_across(tracks: Sequence[Track], facts: RowFacts, path: Trajectory) -> bool:
    """Whether most lamps with two ends lie across the aisle."""
    ends: dict[str, list[Floats]] = {}
    for track in tracks:
        ends.setdefault(str(track.place[track.label]), []).append(point_of(track, facts, path)[0])
    extents = [np.abs(both[1] - both[0]) for both in ends.values() if len(both) == 2]
    return bool(extents) and float(np.mean([extent[2] > extent[0] for extent in extents])) > 0.5


def _all_equal(axis: door.Axis, keys: Mapping[str, Mapping[str, int]], by_part: bool) -> Iterator[door.Relation]:
    """One coordinate for all points, or for all of one part of the lamps."""
    groups: dict[str, list[int]] = {}
    for parts in keys.values():
        for part, key in parts.items():
            groups.setdefault(part if by_part else "", []).append(key)
    for first, *others in groups.values():
        yield from (door.equal_coordinate(axis, first, other) for other in others)


def _tied(
    tracks: Sequence[Track],
    keys: Mapping[str, Mapping[str, int]],
    facts: RowFacts,
    path: Trajectory,
    axis: door.Axis,
) -> Iterator[door.Relation]:
    column = "xyz".index(axis)
    parts: dict[str, list[Track]] = {}
    for track in tracks:
        parts.setdefault("" if axis == "y" else str(track.place["part"]), []).append(track)
    for part_tracks in parts.values():
        points = [point_of(track, facts, path) for track in part_tracks]
        values = np.array([point[column] for point, _ in points])
        sigmas = np.array([np.sqrt(covariance[column, column]) for _, covariance in points])
        agree = agreeing(values, sigmas)
        chosen = [part_tracks[index] for index in np.flatnonzero(agree).tolist()]
        undetected = SQRT_2 * unnoticed(values[agree], sigmas[agree]) if axis == "y" else 0.0
        tied = max(TIED_M, undetected)
        pairs = pairwise(
            keys[f"{track.label} {track.place[track.label]}"][str(track.place["part"])] for track in chosen
        )
        yield from (door.equal_coordinate(axis, first, second, tied) for first, second in pairs)


def agreeing(values: Floats, sigmas: Floats) -> np.ndarray:
    """Whether each value (n,), with a standard deviation (n,), agrees with the weighted median. None does where most do
    not."""
    if len(values) < FEWEST:
        return np.zeros(len(values), np.bool_)
    spread = np.hypot(sigmas, HANGS_M)
    centre = _weighted_median(values, 1 / spread**2)
    agree = np.abs(values - centre) < ALIKE_SIGMA * spread
    return agree if agree.mean() >= MOST else np.zeros(len(values), np.bool_)


def unnoticed(values: Floats, sigmas: Floats) -> float:
    """The true scatter, m, of values (n,) with standard deviations (n,) that their misfit does not reveal: with this
    additional scatter, the chi square about their mean is its median. 0 where it is below the median without any."""
    if len(values) < FEWEST:
        return 0.0
    least = float(chdtri(len(values) - 1, 0.5))
    low, high = 0.0, float(np.ptp(values) * np.sqrt(len(values) / least))
    if _misfit(values, sigmas) <= least:
        return 0.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _misfit(values, np.hypot(sigmas, middle)) > least else (low, middle)
    return high


def _misfit(values: Floats, sigmas: Floats) -> float:
    """The sum of squares of values (n,), in standard deviations (n,), about their weighted mean."""
    centre = float(np.average(values, weights=1 / sigmas**2))
    return float((((values - centre) / sigmas) ** 2).sum())


def _weighted_median(values: Floats, weights: Floats) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def point_of(track: Track, facts: RowFacts, path: Trajectory) -> tuple[Floats, Floats]:
    """The point (3,) m at which the rays of a track meet, and its covariance (3, 3) m^2. The path is taken as exact."""
    origins, rays = door.sight_lines(track, facts, path)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    focal = np.array([facts.views[view].camera[0, 0] for view in track.views])
    angle = (np.sqrt(track.covariances[:, 0, 0]) / focal)[: len(origins)]
    point = np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, origins), rcond=None)[0]
    for _ in range(3):
        away = np.linalg.norm(point - origins, axis=1)
        weight = 1 / np.square(angle * away)
        normal = np.einsum("n,nij->ij", weight, across) + 1e-6 * np.eye(3)
        point = np.linalg.solve(normal, np.einsum("n,nij,nj->i", weight, across, origins))
    off = np.einsum("nij,nj->ni", across, point - origins)
    scale = float((weight * (off**2).sum(axis=1)).sum() + STATED) / (2 * len(origins) - 3 + STATED)
    return point, np.linalg.inv(normal) * scale
