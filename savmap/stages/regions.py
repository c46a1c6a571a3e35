"""The connected regions of a class in what a network saw (paper, "Segmentation")."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Detection

Probabilities = NDArray[np.float32]


def regions(label: str, probability: Probabilities, threshold: float, min_pixels: int) -> list[Detection]:
    """Connected regions (8-neighbourhood) where the class's probability (H, W) is above `threshold`, in scan order.

    Regions of fewer than `min_pixels` are left out. The score is the mean probability over the region.
    """
    return parts(label, (probability > threshold).astype(np.uint8), probability, min_pixels)


def parts(label: str, above: NDArray[np.uint8], probability: Probabilities, min_pixels: int) -> list[Detection]:
    """Connected regions of the pixels that are not 0 in `above` (H, W), as `regions` gives them."""
    count, numbers, stats, _ = cv2.connectedComponentsWithStatsWithAlgorithm(above, 8, cv2.CV_32S, cv2.CCL_GRANA)
    kept = [number for number in range(1, count) if stats[number, cv2.CC_STAT_AREA] >= min_pixels]
    found = []
    for number in kept:
        left, top, width, height = stats[number, :4]
        place = slice(top, top + height), slice(left, left + width)
        inside = numbers[place] == number
        mask = np.zeros(numbers.shape, dtype=np.bool_)
        mask[place] = inside
        found.append(Detection(label, float(probability[place][inside].mean(dtype=np.float64)), mask, probability))
    return found


def detections(maps: Probabilities, classes: Sequence[str], threshold: float, min_pixels: int) -> list[Detection]:
    """Regions of every class in maps (1 + classes, H, W), background first, class by class."""
    return [
        detection
        for label, probability in zip(classes, maps[1:], strict=True)
        for detection in regions(label, np.ascontiguousarray(probability), threshold, min_pixels)
    ]
