"""Instances with coarse masks, as detectors give them, put together to maps of classes at the picture's size."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.types import array_record
from savmap.vision.networks.adapter import Probabilities, Sight, logistic
from savmap.vision.networks.letterbox import Fit, sampled

MOST_SHARED = 0.5
"""An instance of whose mask more than this belongs to surer ones of its class is one of them, found twice."""


@dataclass(frozen=True, eq=False)
@array_record
class Instance:
    """One thing that a network found: its class, how sure it is, its mask's logits on a coarse grid over the network's input, and the
    window (4,) of the picture that it is in: first column and row, last ones + 1."""

    label: str
    score: float
    logits: Probabilities
    window: NDArray[np.int64]


def put_together(instances: Sequence[Instance], classes: tuple[str, ...], fit: Fit) -> Sight:
    """Maps of the classes: at each pixel the highest of the instances' mask probabilities, and the background what is left.

    The surest instances come first; one that is found twice counts once.
    """
    maps = np.zeros((1 + len(classes), fit.height, fit.width), np.float32)
    owners = np.zeros((len(classes), fit.height, fit.width), np.int16)
    count = dict.fromkeys(classes, 0)
    for one in sorted(instances, key=lambda one: -one.score):
        number = classes.index(one.label)
        first_column, first_row, last_column, last_row = one.window.tolist()
        place = slice(first_row, last_row), slice(first_column, last_column)
        probability = logistic(sampled(one.logits, fit, one.window))
        inside = probability > 0.5
        taken = inside & (maps[1 + number][place] > 0.5)
        if not inside.any() or taken.sum() > MOST_SHARED * inside.sum():
            continue
        count[one.label] += 1
        better = probability > maps[1 + number][place]
        maps[1 + number][place][better] = probability[better]
        owners[number][place][better] = count[one.label]
    maps[0] = 1 - maps[1:].max(axis=0, initial=0)
    return Sight(classes, maps, owners)
