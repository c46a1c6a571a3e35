"""Masks: their connected regions, and sub-pixel points on the two borders of long thin objects.

All functions on borders expect objects that lie, from column to column: for objects that stand, give transposed arrays.
The "upper" and the "lower" border are those at the smaller and the larger row.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Bools, Floats, Ints, Thresholds, array_record

Labels = NDArray[np.int32]
Probability = NDArray[np.float32]

NEAR_PX = 15
"""How wide and high the window is in which the largest probability is looked for: a faint member's width, and less than
what lies between members."""
Bytes = NDArray[np.uint8]
Numbers = NDArray[np.uint16]
LEVEL = 0.5
REACH_PX = 3


@dataclass(frozen=True, eq=False)
@array_record
class Regions:
    """Regions 0..n of a mask, of which 0 is what is not set: the number at each pixel `labels` (H, W), their `boxes` (n
    + 1, 4), left, top, width and height, and `areas` (n + 1,) in pixels."""

    labels: Labels
    boxes: Ints
    areas: Ints


def connected_regions(mask: NDArray[np.uint8]) -> Regions:
    """The regions of the pixels that are not 0 in a mask (H, W)."""
    _, labels, stats, _ = cv2.connectedComponentsWithStatsWithAlgorithm(mask, 8, cv2.CV_32S, cv2.CCL_GRANA)
    columns = np.asarray(stats, np.int64)
    return Regions(np.asarray(labels, np.int32), columns[:, : cv2.CC_STAT_AREA], columns[:, cv2.CC_STAT_AREA])


def hysteresis(probability: Probability, thresholds: Thresholds) -> Bools:
    """The pixels (H, W) that count as a class of this probability (H, W): those that are `likely`, in connected regions
    that somewhere exceed the threshold of seeds.

    Hysteresis: Canny, A Computational Approach to Edge Detection, 1986.
    """
    above = likely(probability, thresholds)
    labels = region_labels(above.view(np.uint8))
    kept = np.zeros(int(labels.max()) + 1, np.bool_)
    kept[labels[above & (probability > thresholds.seed)]] = True
    return np.asarray(kept[labels])


def likely(probability: Probability, thresholds: Thresholds) -> Bools:
    """The pixels (H, W) above the threshold, or where the probability stays below it, above half of the largest nearby,
    and above the weak threshold.

    Where a network is sure the mask ends at the threshold, where it is not at half of its height, so that a faint
    member is as thick as a plain one.
    """
    above = probability > thresholds.weak
    if thresholds.weak >= thresholds.pixel:
        return np.asarray(above)
    half = cv2.dilate(probability, np.ones((NEAR_PX, NEAR_PX), np.uint8)) / 2
    return np.asarray(above & ((probability > half) | (probability > thresholds.pixel)))


def region_labels(mask: NDArray[np.uint8]) -> Labels:
    """The `labels` of `connected_regions` alone, which take half the time."""
    return np.asarray(cv2.connectedComponents(mask, connectivity=8)[1], np.int32)


@dataclass(frozen=True, eq=False)
@array_record
class Runs:
    """Runs of set pixels down the columns of a mask, by column and then row: column, first and last row (n,)."""

    column: Ints
    first: Ints
    last: Ints

    def __getitem__(self, index: NDArray[np.intp] | Bools) -> "Runs":
        return Runs(self.column[index], self.first[index], self.last[index])

    @property
    def middle(self) -> Floats:
        """Row in the middle of each run (n,)."""
        return (self.first + self.last) / 2

    @property
    def thickness(self) -> Ints:
        """Pixels in each run (n,)."""
        return self.last - self.first + 1


def runs_of(mask: Bytes) -> Runs:
    """The runs down the columns of a mask (h, w) of 0 and non-0."""
    height, width = mask.shape
    padded = np.zeros((width, height + 2), dtype=np.bool_)
    padded[:, 1:-1] = cv2.transpose(mask)
    flat = padded.ravel()
    change = np.flatnonzero(flat[1:] != flat[:-1])
    column, first = np.divmod(change[::2], height + 2)
    return Runs(column, first, change[1::2] % (height + 2) - 1)


def numbers_of_longest(masks: Sequence[Bools], share: float, dimension: int) -> Numbers:
    """At each pixel (h, w) the number of the mask that it belongs to, from 1, the longest one; 0 where there is none.
    Masks that share more than `share` of their area with longer ones are left out.

    Length is measured from column to column (`dimension` 0) or from row to row (1). Overlapping masks of one object are
    the second of the published mask errors (paper, section III-C).
    """
    numbers: Numbers = np.zeros(masks[0].shape, np.uint16)
    areas = [int(np.count_nonzero(mask)) for mask in masks]
    lengths = [cv2.boundingRect(mask.view(np.uint8))[2 + dimension] for mask in masks]
    for index in sorted(range(len(masks)), key=lambda i: (-lengths[i], -areas[i], i)):
        free = masks[index] & (numbers == 0)
        if areas[index] - np.count_nonzero(free) <= share * areas[index]:
            numbers[free] = index + 1
    return numbers


def numbered_runs(numbers: Numbers, least_px: int, most_thick: float) -> tuple[Runs, Ints]:
    """The runs down the columns of masks (h, w), and the number (n,) of the mask that the middle of each belongs to.

    What goes on for fewer than `least_px` columns is left out, and so are runs that bridge objects: those more than
    `most_thick` times as thick as their mask's median.
    """
    mask = (numbers > 0).astype(np.uint8)
    runs = runs_of(np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((1, least_px), np.uint8)), np.uint8))
    number = numbers[(runs.first + runs.last) // 2, runs.column].astype(np.int64)
    thin = runs.thickness <= most_thick * _medians(number, runs.thickness)[number] + 2
    return runs[thin], number[thin]


def _medians(group: Ints, values: Ints) -> Ints:
    """The median of the values (n,) of each group 0..; 0 for groups without any."""
    order = np.lexsort((values, group))
    sizes = np.bincount(group)
    middle = np.cumsum(sizes) - sizes + sizes // 2
    return np.where(sizes > 0, values[order][np.minimum(middle, max(len(values) - 1, 0))], 0) if len(values) else sizes


def enveloped(runs: Runs, part: Ints) -> tuple[Runs, Ints]:
    """One run a column and part, from the first to the last row of all (holes are bridged so), and its part (n,)."""
    if not len(part):
        return runs, part
    key = part * (int(runs.column.max()) + 1) + runs.column
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    first = np.minimum.reduceat(runs.first[order], starts)
    last = np.maximum.reduceat(runs.last[order], starts)
    return Runs(runs.column[order][starts], first, last), part[order][starts]


def border_points(runs: Runs, probability: Probability) -> tuple[Floats, Floats]:
    """Rows (n,) of the upper and of the lower border of each run.

    A border is where the probability (h, w) passes 0.5, by linear interpolation, nearest to the mask's border; the
    mask's own border if that does not happen within a few pixels; nan where the picture's border cuts the run.
    """
    height = probability.shape[0]
    upper = np.where(runs.first > 0, _passes(runs.column, runs.first, -1, probability), np.nan)
    lower = np.where(runs.last < height - 1, _passes(runs.column, runs.last, 1, probability), np.nan)
    return upper, lower


def _passes(column: Ints, border: Ints, outward: int, probability: Probability) -> Floats:
    """Rows (n,) where the probability falls below 0.5 going `outward` (-1 up, 1 down) near the mask's `border` rows."""
    rows: Floats = border.astype(np.float64) + 0.5 * outward
    left = np.arange(len(column))
    for step in sorted(range(-REACH_PX, REACH_PX + 1), key=abs):
        inner = border[left] + outward * step
        outer = inner + outward
        valid = (np.minimum(inner, outer) >= 0) & (np.maximum(inner, outer) < probability.shape[0])
        inside = probability[np.where(valid, inner, 0), column[left]].astype(np.float64)
        outside = probability[np.where(valid, outer, 0), column[left]].astype(np.float64)
        hit = valid & (inside >= LEVEL) & (outside < LEVEL)
        rows[left[hit]] = inner[hit] + outward * (inside[hit] - LEVEL) / (inside[hit] - outside[hit])
        left = left[~hit]
        if not len(left):
            break
    return rows
