"""Confidence that can be believed: one temperature for all logits, fitted to pictures that were not trained on.

Guo et al., On Calibration of Modern Neural Networks, 2017. It changes no decision between classes, only how sure they are.
"""

import copy
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from torch import Tensor
from torch.nn import functional

from savmap.train.dataset import IGNORE, Sample
from savmap.train.network import SegmentationNetwork

EVERY_PX = 5
LEAST, MOST = 0.25, 4.0


def logits_of(network: SegmentationNetwork, samples: Sequence[Sample]) -> tuple[Tensor, Tensor]:
    """Logits (n, classes) and labels (n,) of every fifth pixel in both directions that is judged."""
    logits, labels = [], []
    for sample in samples:
        image, truth = sample.load()
        with torch.inference_mode():
            maps = network.eval()(torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1))[None]).float())[0]
        chosen = truth[::EVERY_PX, ::EVERY_PX]
        judged = torch.from_numpy(chosen != IGNORE)
        logits.append(maps[:, ::EVERY_PX, ::EVERY_PX].permute(1, 2, 0)[judged])
        labels.append(torch.from_numpy(chosen.astype(np.int64))[judged])
    return torch.cat(logits), torch.cat(labels)


def temperature_for(logits: Tensor, labels: Tensor) -> float:
    """The temperature under which the labels (n,) are most likely, given logits (n, classes)."""

    def cost(log_temperature: float) -> float:
        return float(functional.cross_entropy(logits / float(np.exp(log_temperature)), labels))

    found = minimize_scalar(cost, bounds=(np.log(LEAST), np.log(MOST)), method="bounded", options={"xatol": 1e-3})
    return float(np.exp(found.x))


def with_temperature(network: SegmentationNetwork, temperature: float) -> SegmentationNetwork:
    """A copy whose logits are divided by a temperature, in the weights of its last layer."""
    cooled = copy.deepcopy(network)
    with torch.no_grad():
        cooled.finish.logits.weight /= temperature
        assert cooled.finish.logits.bias is not None
        cooled.finish.logits.bias /= temperature
    return cooled


def softmax(logits: Tensor) -> NDArray[np.float32]:
    """Probabilities (classes, n) of logits (n, classes)."""
    return np.asarray(torch.softmax(logits, dim=1).T.numpy(), np.float32)
