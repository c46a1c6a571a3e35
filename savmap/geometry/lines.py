"""Straight lines through many points at once: least squares, robust, with honest variances.

A line here is v = offset + slope (u - centre). `u` runs along the structure (columns if it is level, rows if it is
upright), `v` across it. All functions work on many lines together: `group` is the number of a point's line.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.geometry.arrays import Bools, Floats, Ints, array_record

SAMPLES = 32
ROUNDS = 3
BIWEIGHT = 4.685
LEAST_SIGMA_PX = 0.08
MOST_CORRELATION = 0.95
STEEPEST = 1.0


@dataclass(frozen=True, eq=False)
@array_record
class Lines:
    """g lines: centre, slope, offset (g,); variances of slope and offset at the centre (g,), px^2; the first and last u
    of their inliers (g,); how many inliers (g,). A line that could not be fitted is nan and has no inliers."""

    centre: Floats
    slope: Floats
    offset: Floats
    slope_var: Floats
    offset_var: Floats
    first: Floats
    last: Floats
    inliers: Floats

    def __len__(self) -> int:
        return len(self.slope)

    def __getitem__(self, index: slice | NDArray[np.intp] | NDArray[np.bool_]) -> "Lines":
        return Lines(*(value[index] for value in vars(self).values()))

    def joined(self, others: "Lines") -> "Lines":
        """These lines followed by others."""
        pairs = zip(vars(self).values(), vars(others).values(), strict=True)
        return Lines(*(np.concatenate(pair) for pair in pairs))

    @property
    def column(self) -> "Lines":
        """The same with shape (g, 1), for many u per line."""
        return Lines(*(value[:, None] for value in vars(self).values()))

    @property
    def at_zero(self) -> Floats:
        """v at u = 0."""
        return self.offset - self.slope * self.centre

    def at(self, u: Floats | float) -> Floats:
        """v at `u`, which broadcasts against (g,)."""
        return self.offset + self.slope * (u - self.centre)

    def variance_at(self, u: Floats | float) -> Floats:
        """Variance of v at `u`, px^2: it grows away from the points."""
        grown: Floats = self.offset_var + self.slope_var * (u - self.centre) ** 2
        return grown


def robust_lines(group: Ints, u: Floats, v: Floats, count: int, tolerance_px: float) -> Lines:
    """Lines through the points (n,) of each group 0..count-1, no steeper than `STEEPEST`, robust to any minority of
    other points; nan for a group without points.

    A vote of point pairs (most points within `tolerance_px`) starts a reweighted least-squares fit (Tukey's biweight).
    Where there are no outliers it is the least-squares line of the paper (section III.C, Fig. "Boundary detection").
    """
    if (np.diff(group) < 0).any() or (np.diff(u)[np.diff(group) == 0] < 0).any():
        order = np.lexsort((u, group))
        group, u, v = group[order], u[order], v[order]
    slope, offset = _voted(group, u, v, count, tolerance_px)
    centre, sigma = np.zeros(count), np.full(count, tolerance_px / 3)
    residual = v - offset[group] - slope[group] * u
    weight = np.ones(len(u))
    for _ in range(ROUNDS):
        weight = _biweight(residual, sigma[group])
        centre, slope, offset = weighted_lines(group, u, v, weight, count)
        residual = v - offset[group] - slope[group] * (u - centre[group])
        sigma = _sigma(group, residual, weight, count, tolerance_px / 2)
    return _summary(group, u, weight, weight * residual, (centre, slope, offset))


def weighted_lines(group: Ints, u: Floats, v: Floats, weight: Floats, count: int) -> tuple[Floats, Floats, Floats]:
    """Centre, slope and offset (count,) of each group's weighted least-squares line; nan where its points fix none."""
    total = _sums_or_nan(group, weight, count)
    centre = _sums(group, weight * u, count) / total
    offset = _sums(group, weight * v, count) / total
    du = u - centre[group]
    slope = _sums(group, weight * du * v, count) / _sums_or_nan(group, weight * du * du, count)
    return centre, slope, offset


def where(condition: Bools, lines: Lines, others: Lines) -> Lines:
    """Lines (g,) of `lines` where the condition (g,) holds, else of `others`."""
    return Lines(*(np.where(condition, a, b) for a, b in zip(vars(lines).values(), vars(others).values(), strict=True)))


def crossing(level: Lines, upright: Lines) -> Floats:
    """Points (n, 2), x and y, where `level` lines (v = y over u = x) cross `upright` lines (v = x over u = y)."""
    x = (upright.at_zero + upright.slope * level.at_zero) / (1 - upright.slope * level.slope)
    return np.stack([x, level.at(x)], axis=-1)


def crossing_covariance(level: Lines, upright: Lines, points: Floats, least_px: float) -> Floats:
    """Covariance (n, 2, 2) px^2 of the `points` (n, 2) of `crossing`; neither line is trusted below `least_px`."""
    floor = least_px**2
    across = np.maximum(level.variance_at(points[:, 0]), floor)
    along = np.maximum(upright.variance_at(points[:, 1]), floor)
    ones = np.ones(len(points))
    normals = np.stack([np.stack([-level.slope, ones], -1), np.stack([ones, -upright.slope], -1)], axis=1)
    inverse = np.linalg.inv(normals)
    noise = np.stack([across, along], axis=-1)[:, None, :]
    covariance: Floats = (inverse * noise) @ inverse.transpose(0, 2, 1)
    return covariance


def _sums(group: Ints, values: Floats, count: int) -> Floats:
    return np.bincount(group, values, count).astype(np.float64)


def _sums_or_nan(group: Ints, values: Floats, count: int) -> Floats:
    sums = _sums(group, values, count)
    return np.where(sums > 1e-9, sums, np.nan)


def _voted(group: Ints, u: Floats, v: Floats, count: int, tolerance: float) -> tuple[Floats, Floats]:
    """Slope and v at u = 0 (count,) of the line through two of `SAMPLES` points of each group that most support."""
    if not len(u):
        return np.zeros(count), np.zeros(count)
    sizes = np.bincount(group, minlength=count)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    pick = starts[:, None] + ((np.arange(SAMPLES) + 0.5) / SAMPLES * sizes[:, None]).astype(np.int64)
    pick = np.minimum(pick, len(u) - 1)
    us, vs = u[pick], v[pick]
    first, second = _pairs()
    run = us[:, second] - us[:, first]
    slope = (vs[:, second] - vs[:, first]) / np.where(run > 0, run, np.inf)
    offset = vs[:, first] - slope * us[:, first]
    residual = vs[:, None, :] - offset[..., None] - slope[..., None] * us[:, None, :]
    vote = np.square(np.maximum(0.0, 1 - np.square(residual / tolerance))).sum(axis=-1)
    best = np.argmax(np.where((np.abs(slope) <= STEEPEST) & (run > 0), vote, -1.0), axis=1)
    rows = np.arange(count)
    return slope[rows, best], offset[rows, best]


def _pairs() -> tuple[Ints, Ints]:
    first, second = np.triu_indices(SAMPLES, SAMPLES // 4)
    widest_first = np.argsort(first - second, kind="stable")[:: max(1, len(first) // 36)]
    return first[widest_first], second[widest_first]


def _biweight(residual: Floats, sigma: Floats) -> Floats:
    inside = 1 - np.square(residual / (BIWEIGHT * sigma))
    return np.asarray(np.square(np.fmax(inside, 0.0)))


def _sigma(group: Ints, residual: Floats, weight: Floats, count: int, most: float) -> Floats:
    mean = _sums(group, np.nan_to_num(weight * residual**2), count) / _sums_or_nan(group, weight, count)
    return np.clip(1.2 * np.sqrt(mean), LEAST_SIGMA_PX, most)


def _summary(group: Ints, u: Floats, weight: Floats, residual: Floats, fit: tuple[Floats, Floats, Floats]) -> Lines:
    """Lines with variances: correlated residuals (weighted) of neighbouring points count as fewer points."""
    centre, slope, offset = fit
    count = len(slope)
    residual = np.nan_to_num(residual)
    du = u - centre[group]
    total = _sums_or_nan(group, weight, count)
    square = _sums(group, residual**2, count)
    same = group[1:] == group[:-1]
    lagged = _sums(group[1:], np.where(same, residual[1:] * residual[:-1], 0.0), count)
    kept = np.clip(lagged / np.maximum(square, 1e-12), 0.0, MOST_CORRELATION)
    variance = np.maximum(square / total, LEAST_SIGMA_PX**2) * (1 + kept) / (1 - kept)
    inlier = weight > 0
    first, last = np.full((2, count), np.nan)
    np.fmin.at(first, group[inlier], u[inlier])
    np.fmax.at(last, group[inlier], u[inlier])
    spread = _sums_or_nan(group, weight * du * du, count)
    inliers = np.bincount(group[inlier], minlength=count).astype(np.float64)
    return Lines(centre, slope, offset, variance / spread, variance / total, first, last, inliers)
