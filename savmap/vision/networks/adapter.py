"""From a network's logits to probabilities."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Detection, array_record

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


@dataclass(frozen=True, eq=False)
@array_record
class Sight:
    """What a network saw in a picture: `maps` (1 + classes, H, W) float32, background first, and, of a network that tells
    instances apart, whose each pixel is, `owners` (classes, H, W): the instance's number in its class, from 1; 0 nobody's."""

    classes: tuple[str, ...]
    maps: Probabilities
    owners: NDArray[np.int16] | None = None

    def detections(self, threshold: float, min_pixels: int) -> list[Detection]:
        """Connected regions of `min_pixels` or more where a class's probability is above `threshold`, instance by instance where
        the network tells them apart. All of a class share its probability over the whole picture."""
        if self.owners is None:
            return detections(self.maps, self.classes, threshold, min_pixels)
        return [
            found
            for label, probability, owner in zip(self.classes, self.maps[1:], self.owners, strict=True)
            for number in range(1, int(owner.max()) + 1)
            for found in parts(
                label, ((owner == number) & (probability > threshold)).astype(np.uint8), probability, min_pixels
            )
        ]


class Adapter(Protocol):
    """A kind of network file, opened. `names` are the network's own classes in its own order."""

    kind: str
    names: tuple[str, ...]

    @property
    def input_size(self) -> tuple[int, int] | None:
        """Width and height of the input, None where the file leaves them open."""
        ...

    def see(self, image: NDArray[np.uint8], labels: Sequence[str | None], classes: tuple[str, ...]) -> Sight:
        """What it sees in a picture (H, W, 3) uint8 RGB of any size. `labels`: for each of `names` the class that it counts as,
        None where it is not asked for; `classes`: those that are, in order."""
        ...


LARGEST = 60.0
"""Beyond this a logistic function is 0 or 1 in float32, and its exponential soon too large."""


def logistic(logits: Probabilities) -> Probabilities:
    """Of each by itself, in 0..1."""
    return np.asarray(1 / (1 + np.exp(-np.clip(logits, -LARGEST, LARGEST))), np.float32)


def softmax(logits: Probabilities, axis: int) -> Probabilities:
    """Of those along an axis, which then sum to 1."""
    exponentials = np.exp(logits - logits.max(axis=axis, keepdims=True))
    return np.asarray(exponentials / exponentials.sum(axis=axis, keepdims=True), np.float32)
