"""Connected regions of masks, 8-neighbourhood, numbered from 1 in scan order."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Ints, array_record

Labels = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
@array_record
class Regions:
    """Regions 0..n of a mask, of which 0 is what is not set: the number at each pixel `labels` (H, W), their `boxes` (n + 1, 4),
    left, top, width and height, and `areas` (n + 1,) in pixels."""

    labels: Labels
    boxes: Ints
    areas: Ints


def connected_regions(mask: NDArray[np.uint8]) -> Regions:
    """The regions of the pixels that are not 0 in a mask (H, W)."""
    _, labels, stats, _ = cv2.connectedComponentsWithStatsWithAlgorithm(mask, 8, cv2.CV_32S, cv2.CCL_GRANA)
    columns = np.asarray(stats, np.int64)
    return Regions(np.asarray(labels, np.int32), columns[:, : cv2.CC_STAT_AREA], columns[:, cv2.CC_STAT_AREA])


def region_labels(mask: NDArray[np.uint8]) -> Labels:
    """The `labels` of `connected_regions` alone, which take half the time."""
    return np.asarray(cv2.connectedComponents(mask, connectivity=8)[1], np.int32)
