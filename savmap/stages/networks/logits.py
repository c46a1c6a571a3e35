"""From a network's logits to probabilities."""

import numpy as np

from savmap.stages.regions import Probabilities

LARGEST = 60.0
"""Beyond this a logistic function is 0 or 1 in float32, and its exponential soon too large."""


def logistic(logits: Probabilities) -> Probabilities:
    """Of each by itself, in 0..1."""
    return np.asarray(1 / (1 + np.exp(-np.clip(logits, -LARGEST, LARGEST))), np.float32)


def softmax(logits: Probabilities, axis: int) -> Probabilities:
    """Of those along an axis, which then sum to 1."""
    exponentials = np.exp(logits - logits.max(axis=axis, keepdims=True))
    return np.asarray(exponentials / exponentials.sum(axis=axis, keepdims=True), np.float32)
