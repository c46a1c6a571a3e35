"""What training minimises: cross entropy, heavier near edges, and the overlap of each class."""

import torch
from torch import Tensor
from torch.nn import functional

from savmap.train.dataset import IGNORE

EDGE_WEIGHT = 3.0
DICE_SHARE = 0.4


def edge_weights(labels: Tensor, reach: int = 2) -> Tensor:
    """(N, H, W) float: `1 + EDGE_WEIGHT` within `reach` px of an edge between classes, on both sides alike, else 1.

    Alike on both sides, because a heavier class or side would push the edge away from its true place.
    """
    values = labels.float()[:, None]
    size = 2 * reach + 1
    highest = functional.max_pool2d(values, size, 1, reach)
    lowest = -functional.max_pool2d(-values, size, 1, reach)
    return 1 + EDGE_WEIGHT * (highest != lowest).float()[:, 0]


def dice(probabilities: Tensor, labels: Tensor, judged: Tensor) -> Tensor:
    """One minus the soft overlap of each class but the background, averaged over the classes present in the batch."""
    losses = []
    for value in range(1, probabilities.shape[1]):
        truth = (labels == value) & judged
        if truth.any():
            share = probabilities[:, value] * judged
            overlap = (share * truth).sum()
            losses.append(1 - 2 * overlap / (share.sum() + truth.sum()))
    return torch.stack(losses).mean() if losses else probabilities.sum() * 0


def segmentation_loss(logits: Tensor, labels: Tensor) -> Tensor:
    """Scalar loss of logits (N, C, H, W) for labels (N, H, W) int64 with IGNORE where nothing is known."""
    judged = labels != IGNORE
    weights = edge_weights(labels) * judged
    entropy = functional.cross_entropy(logits, labels, ignore_index=IGNORE, reduction="none")
    mean = (entropy * weights).sum() / weights.sum().clamp(min=1)
    return mean + DICE_SHARE * dice(torch.softmax(logits, dim=1), labels, judged)
