"""What every kind of network gives of a picture, and the interface that the adapters of all kinds have."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from savmap.types import Detection, Thresholds, array_record
from savmap.types.common import read_only
from savmap.vision.regions import connected_regions, hysteresis

Probabilities = NDArray[np.float32]

LARGEST = 60.0
"""Beyond this a logistic function is 0 or 1 in float32, and its exponential soon too large."""


@dataclass(frozen=True, eq=False)
@array_record
class Segmentation:
    """A network's answer to a picture.

    `maps` (1 + classes, H, W) float32 are the classes' probabilities, background first. `owners` (classes, H, W) is the
    number of the instance that a pixel belongs to, from 1 in its class, 0 for none; None for networks that do not
    separate instances.
    """

    classes: tuple[str, ...]
    maps: Probabilities
    owners: NDArray[np.int16] | None = None

    def detections(self, threshold: float | Thresholds, min_pixels: int) -> list[Detection]:
        """Connected regions of `min_pixels` or more where a class's probability is above `threshold`, by hysteresis
        where it is three of them, by class, and by instance where the network separates them. All of a class share its
        probability over the whole picture."""
        if self.owners is None:
            return [
                detection
                for label, probability in zip(self.classes, self.maps[1:], strict=True)
                for detection in regions(label, np.ascontiguousarray(probability), threshold, min_pixels)
            ]
        return [
            detection
            for label, probability, owner in zip(self.classes, self.maps[1:], self.owners, strict=True)
            for number in range(1, int(owner.max()) + 1)
            for detection in _detections(
                label, (owner == number) & _above(probability, threshold), probability, min_pixels
            )
        ]


def regions(label: str, probability: Probabilities, threshold: float | Thresholds, min_pixels: int) -> list[Detection]:
    """Connected regions (8-neighbourhood) where the class's probability (H, W) is above `threshold`, by hysteresis
    where it is three of them, in scan order.

    Regions of fewer than `min_pixels` are left out. The score is the mean probability over the region.
    """
    return _detections(label, _above(probability, threshold), probability, min_pixels)


def _above(probability: Probabilities, threshold: float | Thresholds) -> NDArray[np.bool_]:
    if isinstance(threshold, Thresholds):
        return hysteresis(probability, threshold)
    return np.asarray(probability > threshold)


def _detections(label: str, above: NDArray[np.bool_], probability: Probabilities, min_pixels: int) -> list[Detection]:
    connected = connected_regions(above.view(np.uint8))
    shared = read_only(probability)
    detections = []
    for number in np.flatnonzero(connected.areas[1:] >= min_pixels) + 1:
        left, top, width, height = connected.boxes[number].tolist()
        place = slice(top, top + height), slice(left, left + width)
        inside = connected.labels[place] == number
        mask = np.zeros(connected.labels.shape, dtype=np.bool_)
        mask[place] = inside
        score = float(probability[place][inside].mean(dtype=np.float64))
        detections.append(Detection(label, score, mask, shared))
    return detections


class Adapter(Protocol):
    """An opened network of one kind. `names` are the network's own classes in its own order."""

    kind: str
    names: tuple[str, ...]

    @property
    def input_size(self) -> tuple[int, int] | None:
        """Width and height of the input, None where the file leaves them open."""
        ...

    def predict(self, image: NDArray[np.uint8], labels: Sequence[str | None], classes: tuple[str, ...]) -> Segmentation:
        """Segment a picture (H, W, 3) uint8 RGB of any size. `labels` gives for each of `names` the class that it
        counts as, None to leave it out; `classes` are these classes, in order."""
        ...


def logistic(logits: Probabilities) -> Probabilities:
    """The logistic function of each logit, in 0..1."""
    return np.asarray(1 / (1 + np.exp(-np.clip(logits, -LARGEST, LARGEST))), np.float32)
