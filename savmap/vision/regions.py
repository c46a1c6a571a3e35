"""Connected regions of masks, 8-neighbourhood, numbered from 1 in scan order."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Ints, Thresholds, array_record

Labels = NDArray[np.int32]
Probabilities = NDArray[np.float32]

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


def hysteresis(probability: Probabilities, thresholds: Thresholds) -> NDArray[np.bool_]:
    """The pixels (H, W) that count as a class of this probability (H, W): those above the threshold, or where the
    probability stays below it, above half of the largest nearby, and above the weak threshold; in connected regions
    that somewhere exceed that of seeds.

    Where a network is sure the mask ends at the threshold, where it is not at half of its height, so that a faint
    member is as thick as a plain one. Hysteresis: Canny, A Computational Approach to Edge Detection, 1986.
    """
    above = probability > (thresholds.pixel if thresholds.weak >= thresholds.pixel else _local(probability, thresholds))
    if thresholds.seed <= thresholds.weak:
        return np.asarray(above)
    labels = region_labels(above.view(np.uint8))
    kept = np.zeros(int(labels.max()) + 1, np.bool_)
    kept[labels[above & (probability > thresholds.seed)]] = True
    return np.asarray(kept[labels])


def _local(probability: Probabilities, thresholds: Thresholds) -> Probabilities:
    """The threshold (H, W) at each pixel: half of the largest probability nearby, between the weak threshold and the
    pixel's."""
    near = cv2.dilate(probability, np.ones((NEAR_PX, NEAR_PX), np.uint8))
    return np.asarray(np.clip(near / 2, thresholds.weak, thresholds.pixel), np.float32)


def region_labels(mask: NDArray[np.uint8]) -> Labels:
    """The `labels` of `connected_regions` alone, which take half the time."""
    return np.asarray(cv2.connectedComponents(mask, connectivity=8)[1], np.int32)
