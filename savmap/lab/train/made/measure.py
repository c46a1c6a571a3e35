"""How good a network is on pictures held out, and how its scores are to be read."""

import json
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from torch import Tensor

from savmap.lab.train.data.dataset import IGNORE
from savmap.lab.train.made.learn import fast_arithmetic, full_size
from savmap.lab.train.made.network import TwoScaleNetwork

Bytes = NDArray[np.uint8]
EDGES = tuple(float(edge) for edge in np.linspace(-7, 7, 15))
"""Between the 16 bins of a class's logit against all others."""
EVERY_PX = 9


class HeldOut:
    """Pictures (3, 480, 640) and masks of a kind that only measure."""

    def __init__(self) -> None:
        self.images: list[Bytes] = []
        self.masks: list[Bytes] = []

    def add(self, image: Bytes, mask: Bytes) -> None:
        self.images.append(np.ascontiguousarray(np.asarray(image).transpose(2, 0, 1)))
        self.masks.append(np.asarray(mask))

    def logits(self, network: TwoScaleNetwork, device: torch.device, size: int = 16) -> list[Tensor]:
        """(C, h, w) of each picture."""
        result: list[Tensor] = []
        with torch.inference_mode(), fast_arithmetic(device):
            for first in range(0, len(self.images), size):
                images = torch.from_numpy(np.stack(self.images[first : first + size])).to(device).float()
                result += list(network(images.contiguous(memory_format=torch.channels_last)).float())
        return result


def ious(
    logits: Sequence[Tensor], masks: Sequence[Bytes], accepted: NDArray[np.float32], names: Sequence[str]
) -> dict[str, float]:
    """Intersection over union of each class that is labelled, over all pictures; what a label accepts beside itself is
    right there."""
    counts = np.zeros((len(names) + 1, 2))
    table = torch.from_numpy(accepted)
    for logit, mask in zip(logits, masks, strict=True):
        seen = full_size(logit[None])[0].argmax(dim=0)
        truth = torch.from_numpy(mask).to(seen.device).long()
        valid = truth != IGNORE
        targets = torch.where(valid, truth, 0)
        seen = torch.where(table.to(seen.device)[targets, seen] > 0, targets, seen)
        for value in range(1, len(names) + 1):
            a, b = (seen == value) & valid, (targets == value) & valid
            counts[value] += float((a & b).sum()), float((a | b).sum())
    labelled = {int(value) for mask in masks for value in np.unique(mask)}
    return {
        name: round(counts[value, 0] / counts[value, 1], 4)
        for value, name in enumerate(names, start=1)
        if value in labelled and counts[value, 1]
    }


def pixels(logits: Sequence[Tensor], masks: Sequence[Bytes], accepted: NDArray[np.float32]) -> tuple[Tensor, Tensor]:
    """Some pixels' logits (n, 1 + C), the background's 0, and labels (n,), those that the network's own choice is
    accepted for counted as it."""
    columns, labels = [], []
    for logit, mask in zip(logits, masks, strict=True):
        whole = torch.nn.functional.interpolate(logit[None], mask.shape, mode="bilinear", align_corners=False)[0]
        some = whole[:, ::EVERY_PX, ::EVERY_PX].flatten(1).T.cpu()
        truth = torch.from_numpy(mask[::EVERY_PX, ::EVERY_PX].reshape(-1).copy()).long()
        valid = truth != IGNORE
        columns.append(torch.cat([torch.zeros(int(valid.sum()), 1), some[valid]], dim=1))
        labels.append(truth[valid])
    both, truth = torch.cat(columns), torch.cat(labels)
    chosen = both.argmax(dim=1)
    return both, torch.where(torch.from_numpy(accepted)[truth, chosen] > 0, chosen, truth)


def temperature(logits: Tensor, labels: Tensor) -> float:
    """What logits are to be divided by so that probabilities are frequencies (Guo et al., On Calibration of Modern
    Neural Networks, 2017)."""

    def loss(log: float) -> float:
        return float(torch.nn.functional.cross_entropy(logits / float(np.exp(log)), labels))

    return float(np.exp(minimize_scalar(loss, bounds=(np.log(0.25), np.log(4.0)), method="bounded").x))


def tables(logits: Tensor, labels: Tensor, names: Sequence[str]) -> dict[str, object]:
    """For each class how often its logit against all others lies in each bin, where the class is and where it is
    not."""
    log_all = torch.log_softmax(logits, dim=1)
    result: dict[str, object] = {}
    for value, name in enumerate(names, start=1):
        others = torch.logsumexp(torch.cat([log_all[:, :value], log_all[:, value + 1 :]], dim=1), dim=1)
        bins = torch.bucketize(log_all[:, value] - others, torch.tensor(EDGES)).numpy()
        inside = (labels == value).numpy()
        if inside.any():
            result[name] = {
                "class": [int(n) for n in np.bincount(bins[inside], minlength=len(EDGES) + 1)],
                "none": [int(n) for n in np.bincount(bins[~inside], minlength=len(EDGES) + 1)],
            }
    return result


def calibration(sets: Mapping[str, tuple[Tensor, Tensor]], names: Sequence[str], divided_by: float) -> str:
    """The metadata `savmap.calibration`: counts of pixels by bins of a class's logit, for each set."""
    content = {
        "temperature": round(divided_by, 3),
        "logit edges": EDGES,
        "pixels": {kind: tables(logits / divided_by, labels, names) for kind, (logits, labels) in sets.items()},
    }
    return json.dumps(content)
