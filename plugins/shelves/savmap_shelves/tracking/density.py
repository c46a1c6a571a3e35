"""Clusters on a line by kernel density estimation (paper, III.D)."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from savmap.types import Floats, Ints

CELLS = 5
FAR = 3000.0


def modes(values: Floats, bandwidth: float) -> Floats:
    """The peaks (k,) of the Gaussian kernel density of values (n,), in rising order; outliers are left out."""
    values = values[np.abs(values - np.median(values)) < FAR * bandwidth] if len(values) else values
    if not len(values):
        return np.zeros(0)
    cell = bandwidth / CELLS
    start = values.min() - 5 * bandwidth
    place = np.round((values - start) / cell).astype(np.int64)
    density = gaussian_filter1d(np.bincount(place, minlength=place.max() + 5 * CELLS).astype(float), CELLS)
    inner = density[1:-1]
    peaks = np.flatnonzero((inner > density[:-2]) & (inner >= density[2:]) & (inner > 1e-6)) + 1
    return np.asarray(start + peaks * cell, dtype=np.float64)


def nearest(values: Floats, centres: Floats, reach: float) -> Ints:
    """For each value (n,) the index of the nearest of centres (k,), or -1 where none is within `reach` (nan: -1)."""
    if not len(centres):
        return np.full(len(values), -1)
    distance = np.abs(np.where(np.isfinite(values), values, np.inf)[:, None] - centres)
    index = distance.argmin(axis=1)
    return np.where(distance.min(axis=1) <= reach, index, -1)


def cheapest_in_group(group: Ints, target: Ints, cost: Floats) -> Ints:
    """Leave every target (n,) at most once in every group (n,): the cheapest; the others, and infinite costs, become -1."""
    kept = np.full(len(target), -1)
    valid = np.flatnonzero((target >= 0) & np.isfinite(cost))
    order = valid[np.lexsort((cost[valid], target[valid], group[valid]))]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (np.diff(group[order]) != 0) | (np.diff(target[order]) != 0)
    kept[order[first]] = target[order[first]]
    return kept


def medians(values: Floats, which: Ints, count: int) -> Floats:
    """The median (count, ...) of the values (n, ...) in each cluster, by the cluster of each value (n,); nan where it has none."""
    middle = [
        np.median(values[which == k], axis=0) if (which == k).any() else np.full(values.shape[1:], np.nan)
        for k in range(count)
    ]
    return np.array(middle, dtype=np.float64).reshape(count, *values.shape[1:])
