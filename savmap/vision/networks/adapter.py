"""What every kind of network gives of a picture, and what the layouts share: pictures fitted into the input, and
instances with coarse masks merged to maps of classes."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Bools, Detection, Thresholds, array_record
from savmap.types.common import read_only
from savmap.vision.masks import connected_regions, hysteresis, likely

Probabilities = NDArray[np.float32]

LARGEST = 60.0
"""Beyond this a logistic function is 0 or 1 in float32, and its exponential soon too large."""
GREY = 114
WHITE = np.float32(255)
MOST_SHARED = 0.5
"""An instance is a duplicate if more than this share of its mask belongs to surer instances of its class."""


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
        detections: list[Detection] = []
        for index, (label, probability) in enumerate(zip(self.classes, self.maps[1:], strict=True)):
            if self.owners is None:
                detections += regions(label, np.ascontiguousarray(probability), threshold, min_pixels)
            else:
                above, owner = hysteresis(probability, _thresholds(threshold)), self.owners[index]
                for number in range(1, int(owner.max()) + 1):
                    detections += _detections(label, (owner == number) & above, probability, min_pixels)
        return detections


def regions(label: str, probability: Probabilities, threshold: float | Thresholds, min_pixels: int) -> list[Detection]:
    """Connected regions (8-neighbourhood) where the class's probability (H, W) is above `threshold`, by hysteresis
    where it is three of them, in scan order.

    Regions of fewer than `min_pixels` are left out. The score is the mean probability over the region.
    """
    thresholds = _thresholds(threshold)
    return _detections(label, likely(probability, thresholds), probability, min_pixels, thresholds.seed)


def _thresholds(threshold: float | Thresholds) -> Thresholds:
    return threshold if isinstance(threshold, Thresholds) else Thresholds.of(threshold)


def _detections(
    label: str, above: Bools, probability: Probabilities, min_pixels: int, seed: float = 0.0
) -> list[Detection]:
    """The connected regions of what is above a threshold that have so many pixels and exceed `seed` somewhere."""
    x, y, width, height = cv2.boundingRect(above.view(np.uint8))
    if not width:
        return []
    right, bottom, x, y = x + width, y + height, x & ~1, y & ~1  # regions are numbered by blocks of two by two
    connected = connected_regions(np.ascontiguousarray(above[y:bottom, x:right]).view(np.uint8))
    shared = read_only(probability)
    detections = []
    for number in np.flatnonzero(connected.areas[1:] >= min_pixels) + 1:
        left, top, width, height = connected.boxes[number].tolist()
        inside = connected.labels[top : top + height, left : left + width] == number
        place = slice(y + top, y + top + height), slice(x + left, x + left + width)
        values = probability[place][inside]
        if values.max() > seed:
            mask = np.zeros(above.shape, dtype=np.bool_)
            mask[place] = inside
            detections.append(Detection(label, float(values.mean(dtype=np.float64)), mask, shared))
    return detections


def logistic(logits: Probabilities) -> Probabilities:
    """The logistic function of each logit, in 0..1."""
    return np.asarray(1 / (1 + np.exp(-np.clip(logits, -LARGEST, LARGEST))), np.float32)


@dataclass(frozen=True)
class Fit:
    """A picture of `width` x `height` pixels in an input of `size` (w, h): scaled by `across` and `down`, its upper
    left corner at (left, top) of the input. Pixel centres are at integer coordinates."""

    width: int
    height: int
    size: tuple[int, int]
    across: float
    down: float
    left: int = 0
    top: int = 0

    def on_grid(self, columns: int, rows: int) -> tuple[tuple[float, float], tuple[float, float]]:
        """For a grid of masks over the input: scale and offset that take the picture's u to the grid's, and its v."""
        u, v = columns / self.size[0], rows / self.size[1]
        return (
            (self.across * u, (self.across / 2 + self.left) * u - 0.5),
            (self.down * v, (self.down / 2 + self.top) * v - 0.5),
        )

    def window(self, boxes: NDArray[np.float64], margin: float) -> NDArray[np.int64]:
        """Boxes (n, 4) of the input (x0, y0, x1, y1 between pixels' borders), grown by `margin` of its pixels, as the
        picture's first and last + 1 columns and rows (n, 4)."""
        corner = np.array([self.left, self.top])
        scale = np.array([self.across, self.down])
        first = np.floor((boxes[:, :2] - margin - corner) / scale)
        last = np.ceil((boxes[:, 2:] + margin - corner) / scale)
        limits = np.array([self.width, self.height])
        return np.hstack([np.clip(first, 0, limits), np.clip(last, 0, limits)]).astype(np.int64)


def letterboxed(image: NDArray[np.uint8], size: tuple[int, int]) -> tuple[NDArray[np.uint8], Fit]:
    """A picture (H, W, 3) scaled to fit into `size` (w, h), in the middle of a grey canvas, as ultralytics' LetterBox
    does."""
    height, width = image.shape[:2]
    ratio = min(size[0] / width, size[1] / height)
    inner = round(width * ratio), round(height * ratio)
    left, top = (round((size[axis] - inner[axis]) / 2 - 0.1) for axis in (0, 1))
    canvas = np.full((size[1], size[0], 3), GREY, np.uint8)
    canvas[top : top + inner[1], left : left + inner[0]] = _resized(image, inner)
    return canvas, Fit(width, height, size, inner[0] / width, inner[1] / height, left, top)


def stretched(image: NDArray[np.uint8], size: tuple[int, int]) -> tuple[NDArray[np.uint8], Fit]:
    """A picture (H, W, 3) scaled to `size` (w, h), its aspect ratio not kept."""
    height, width = image.shape[:2]
    return _resized(image, size), Fit(width, height, size, size[0] / width, size[1] / height)


def planes(picture: NDArray[np.uint8]) -> Probabilities:
    """(H, W, 3) uint8 -> (1, 3, H, W) float32 in 0..255 (`WHITE`)."""
    return np.stack(cv2.split(picture)).astype(np.float32)[None]


def _resized(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    if (image.shape[1], image.shape[0]) == size:
        return image
    interpolation = cv2.INTER_AREA if image.shape[1] > size[0] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=interpolation), np.uint8)


@dataclass(frozen=True, eq=False)
@array_record
class Instance:
    """One detected object: its class, its score, its mask's logits on a coarse grid over the network's input, and its
    window (4,) in the picture: first column and row, last column and row + 1."""

    label: str
    score: float
    logits: Probabilities
    window: NDArray[np.int64]


def merged(instances: Sequence[Instance], classes: tuple[str, ...], fit: Fit) -> Segmentation:
    """Maps of the classes: at each pixel the highest of the instances' mask probabilities, and the rest as background.

    The surest instances come first; duplicates are left out.
    """
    maps = np.zeros((1 + len(classes), fit.height, fit.width), np.float32)
    owners = np.zeros((len(classes), fit.height, fit.width), np.int16)
    count = dict.fromkeys(classes, 0)
    for instance in sorted(instances, key=lambda instance: -instance.score):
        number = classes.index(instance.label)
        first_column, first_row, last_column, last_row = instance.window.tolist()
        place = slice(first_row, last_row), slice(first_column, last_column)
        probability = logistic(_sampled(instance.logits, fit, instance.window))
        inside = probability > 0.5
        taken = inside & (maps[1 + number][place] > 0.5)
        if not inside.any() or taken.sum() > MOST_SHARED * inside.sum():
            continue
        count[instance.label] += 1
        better = probability > maps[1 + number][place]
        maps[1 + number][place][better] = probability[better]
        owners[number][place][better] = count[instance.label]
    maps[0] = 1 - maps[1:].max(axis=0, initial=0)
    return Segmentation(classes, maps, owners)


def _sampled(mask: Probabilities, fit: Fit, window: NDArray[np.int64]) -> Probabilities:
    """A mask (rows, columns) over the network's input, interpolated at the picture's pixels in a window (4,)."""
    (across, right), (down, below) = fit.on_grid(mask.shape[1], mask.shape[0])
    columns = np.arange(window[0], window[2]) * across + right
    rows = np.arange(window[1], window[3]) * down + below
    between: Probabilities = _between(_between(mask, rows).T, columns).T
    return between


def _between(mask: Probabilities, at: NDArray[np.float64]) -> Probabilities:
    """Rows of a mask at fractional numbers `at`; beyond the first and last one these go on."""
    inside = np.clip(at, 0, len(mask) - 1)
    lower = np.minimum(inside.astype(np.int64), max(len(mask) - 2, 0))
    weight = (inside - lower).astype(np.float32)[:, None]
    upper = np.minimum(lower + 1, len(mask) - 1)
    between: Probabilities = mask[lower] * (1 - weight) + mask[upper] * weight
    return between
