"""Straight lines through many points at once, and where they cross.

A line here is v = offset + slope (u - centre). `u` runs along the structure (columns if it is level, rows if it is
upright), `v` across it. All functions work on many lines together: `group` is the number of a point's line.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.geometry.arrays import Bools, Floats, Ints, array_record


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
