"""Masks: which pixels are of a class, and their connected regions."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Bools, Ints, Thresholds, array_record

Labels = NDArray[np.int32]
Probability = NDArray[np.float32]

NEAR_PX = 15
"""How wide and high the window is in which the largest probability is looked for: a faint member's width, and less than
what lies between members."""


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
