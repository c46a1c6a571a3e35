"""Covers: for each place on a face, the share of a post's or level's length along which the evidence stands out there."""

import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter

from savmap.types import Floats
from savmap_shelves.evidence.search.strength import Singles, seen_mean


def cover_of(evidence: Singles, weight: Singles, size: float, around: float, limit: float) -> Floats:
    """The cover (n,) of each row of `evidence` (n, m), for objects `size` rows thick; `around` and `limit` as in `standing_out`."""
    return seen_mean(standing_out(evidence, weight, size, around, limit), weight, 1)


def standing_out(evidence: Singles, weight: Singles, size: float, around: float, limit: float) -> Singles:
    """The excess (n, m), from 0 to 1 at the limit, of each cell of `evidence` over the median of the rows around, for objects `size` rows thick."""
    smooth = gaussian_filter1d(evidence, size / 4, axis=0)
    usual = median_filter(seen_mean(smooth, weight, 1), max(3, round(0.7 * around)))
    return np.asarray(np.clip((smooth - usual[:, None]) / limit, 0.0, 1.0), np.float32)


def greatest(cover: Floats, places: Floats, intervals: Floats) -> Floats:
    """The greatest cover (k,) within intervals (k, 2) of places, or beside them by half their length."""
    margin = np.diff(intervals, axis=1) / 2
    inside = (places > intervals[:, :1] - margin) & (places < intervals[:, 1:] + margin)
    return np.asarray(np.where(inside, cover, 0.0).max(axis=1, initial=0.0))


def peaks(cover: Floats, least: float) -> list[int]:
    """The indices of the smoothed cover's local maxima where the cover is at least `least`, the greatest first."""
    rounded = np.round(gaussian_filter1d(cover, 1.0), 6)
    inner = (rounded[1:-1] >= rounded[:-2]) & (rounded[1:-1] > rounded[2:])
    found = np.flatnonzero(inner & (cover[1:-1] >= least)) + 1
    return [int(k) for k in found[np.argsort(-rounded[found], kind="stable")]]
