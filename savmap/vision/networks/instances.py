"""Instances with coarse masks, as detectors give them, merged to maps of classes at the picture's size."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.types import array_record
from savmap.vision.networks.adapter import Probabilities, Segmentation, logistic
from savmap.vision.networks.letterbox import Fit

MOST_SHARED = 0.5
"""An instance is a duplicate if more than this share of its mask belongs to surer instances of its class."""


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
    """A mask (rows, columns) over the network's input, interpolated linearly at the picture's pixels in a window
    (4,)."""
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
