"""One network in training: loss (cross entropy, heavier near edges, and the overlap of each class), optimiser, averaged
weights."""

import copy
import math
import os
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from savmap.lab.train.data.augment import ANY_PLACE, ONE_SITE, Batch, Crop
from savmap.lab.train.data.dataset import IGNORE
from savmap.lab.train.measure import Predictor
from savmap.lab.train.network import FIXED_BLOCKS, SegmentationNetwork


@dataclass(frozen=True)
class Hyperparameters:
    """What is chosen about training beside its data. Rates are the largest of AdamW's; they rise, then fall as a
    cosine.

    `frozen_blocks`: how many of the encoder's blocks keep their weights; `frozen_statistics`: normalisations keep
    theirs; `validations`: how often the network is measured on the validation pictures; the best one is taken (0: the
    last one). `variation`: the key of `augment.VARIATIONS`.
    """

    batch: int = 6
    encoder_rate: float = 4e-4
    decoder_rate: float = 2e-3
    weight_decay: float = 1e-4
    warm_up: float = 0.03
    average_decay: float = 0.998
    checkpoint_s: float = 90.0
    validation_limit: int = 120
    crop: Crop = field(default_factory=Crop)
    frozen_blocks: int = FIXED_BLOCKS
    frozen_statistics: bool = False
    validations: int = 0
    variation: str = ANY_PLACE


FINE_TUNING = Hyperparameters(
    encoder_rate=1e-4,
    decoder_rate=4e-4,
    average_decay=0.99,
    checkpoint_s=30.0,
    validation_limit=40,
    frozen_blocks=5,
    frozen_statistics=True,
    validations=5,
)
"""For a network that knows its classes and a few hundred pictures of another style: small steps, the early blocks left
alone."""


ONE_SITE_ALONE = replace(FINE_TUNING, variation=ONE_SITE)
"""For a network that one site teaches, for itself."""


TRAINING_ON = Hyperparameters(encoder_rate=2e-4, decoder_rate=1e-3, frozen_statistics=True)
"""For a network from an ONNX file and thousands of pictures: all layers, at half the rates of a network from
nothing."""


EDGE_WEIGHT = 3.0
MOST_THREADS = 8
DICE_SHARE = 0.4


def edge_weights(labels: Tensor, reach: int = 2) -> Tensor:
    """(N, H, W) float: `1 + EDGE_WEIGHT` within `reach` px of an edge between classes, on both sides alike, else 1.

    Alike on both sides, because a heavier class or side would push the edge away from its true place. Where labels end
    is no edge: only one of its sides would be heavier.
    """
    values = labels.to(torch.int16).cpu().numpy()
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    edges = [cv2.dilate(np.where(v == IGNORE, -1, v), kernel) > cv2.erode(v, kernel) for v in values]
    return 1 + EDGE_WEIGHT * torch.from_numpy(np.stack(edges)).to(labels.device).float()


def dice(probabilities: Tensor, labels: Tensor, valid: Tensor) -> Tensor:
    """One minus the soft overlap of each class but the background, averaged over the classes present in the batch."""
    losses = []
    for value, probability in enumerate(probabilities.unbind(1)[1:], start=1):
        truth = (labels == value) & valid
        if truth.any():
            share = probability * valid
            overlap = (share * truth).sum()
            losses.append(1 - 2 * overlap / (share.sum() + truth.sum()))
    return torch.stack(losses).mean() if losses else probabilities.sum() * 0


def segmentation_loss(logits: Tensor, labels: Tensor) -> Tensor:
    """Scalar loss of logits (N, C, H, W) for labels (N, H, W) int64 with IGNORE where nothing is known."""
    valid = labels != IGNORE
    weights = edge_weights(labels) * valid
    logarithms = torch.log_softmax(logits, dim=1)
    entropy = functional.nll_loss(logarithms, labels, ignore_index=IGNORE, reduction="none")
    mean = (entropy * weights).sum() / weights.sum().clamp(min=1)
    return mean + DICE_SHARE * dice(logarithms.exp(), labels, valid)


def learning_rate_factor(done: float, warm_up: float) -> float:
    """Factor 0..1 when the share `done` of the budget is spent."""
    if done < warm_up:
        return done / warm_up + 0.01
    return 0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * (done - warm_up) / (1 - warm_up)))


class Average:
    """Exponential moving average of a network's weights; it settles faster at the beginning."""

    def __init__(self, network: SegmentationNetwork, decay: float) -> None:
        self.network = copy.deepcopy(network).eval()
        self._decay = decay
        self.updates = 0

    def update(self, network: nn.Module) -> None:
        """Move towards the weights of `network`."""
        self.updates += 1
        decay = min(self._decay, (1 + self.updates) / (10 + self.updates))
        with torch.no_grad():
            for mine, theirs in zip(self.network.state_dict().values(), network.state_dict().values(), strict=True):
                if mine.dtype.is_floating_point:
                    mine.lerp_(theirs, 1 - decay)
                else:
                    mine.copy_(theirs)


class Trainer:
    """A network in training, moved to where torch computes: `step` improves it by one batch."""

    def __init__(self, network: SegmentationNetwork, settings: Hyperparameters) -> None:
        self.device = compute_device()
        self.network = network.to(self.device, memory_format=torch.channels_last).train()
        network.encoder.blocks[: settings.frozen_blocks].requires_grad_(False)
        if settings.frozen_statistics:
            for module in network.modules():
                if isinstance(module, nn.BatchNorm2d):
                    module.eval()
        self.average = Average(network, settings.average_decay)
        self.settings = settings
        encoder = [weight for weight in network.encoder.parameters() if weight.requires_grad]
        decoder = [weight for name, weight in network.named_parameters() if not name.startswith("encoder.")]
        groups = [
            {"params": encoder, "lr": settings.encoder_rate, "most": settings.encoder_rate},
            {"params": decoder, "lr": settings.decoder_rate, "most": settings.decoder_rate},
        ]
        self._optimizer = torch.optim.AdamW(groups, weight_decay=settings.weight_decay)

    def state(self) -> dict[str, Any]:
        """All that `restore` needs to go on."""
        return {
            "network": self.network.state_dict(),
            "average": self.average.network.state_dict(),
            "updates": self.average.updates,
            "optimizer": self._optimizer.state_dict(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state. Raises KeyError, ValueError or RuntimeError for one of another network."""
        self.network.load_state_dict(state["network"])
        self.average.network.load_state_dict(state["average"])
        self.average.updates = state["updates"]
        self._optimizer.load_state_dict(state["optimizer"])

    def step(self, batch: Batch, factor: float) -> float:
        """One update at this share, 0..1, of the largest rate; returns the loss."""
        for group in self._optimizer.param_groups:
            group["lr"] = group["most"] * factor
        images, labels = (tensor.to(self.device) for tensor in as_tensors(batch))
        with fast_arithmetic(self.device):
            logits = self.network(images)
        loss = segmentation_loss(logits.float(), labels)
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 2.0)
        self._optimizer.step()
        self.average.update(self.network)
        return float(loss.detach())


def as_tensors(batch: Batch) -> tuple[Tensor, Tensor]:
    """Pictures as float (n, 3, h, w), channels last in memory, and labels as int64 (n, h, w)."""
    images = torch.from_numpy(batch[0]).permute(0, 3, 1, 2).float()
    return images, torch.from_numpy(batch[1]).long()


def predictor(network: SegmentationNetwork) -> Predictor:
    """The network, where its weights are, as a function from a picture (H, W, 3) uint8 to probabilities (C, H, W)."""
    device = device_of(network)

    def predict(image: NDArray[np.uint8]) -> NDArray[np.float32]:
        images, _ = as_tensors((image[None], np.zeros((1, 1, 1), np.uint8)))
        with torch.inference_mode():
            return np.asarray(torch.softmax(network.eval()(images.to(device)), dim=1)[0].cpu().numpy(), np.float32)

    return predict


def compute_device() -> torch.device:
    """The first CUDA device that torch can use, else the processor; `CUDA_VISIBLE_DEVICES=` (empty) hides devices."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def device_of(module: torch.nn.Module) -> torch.device:
    """Where a network's weights are."""
    return next(module.parameters()).device


def threads_beside(device: torch.device) -> int:
    """How many threads prepare pictures while a device computes: one beside a processor, which computes with its cores
    itself."""
    return 1 if device.type == "cpu" else min(os.cpu_count() or 1, MOST_THREADS)


def fast_arithmetic(device: torch.device) -> AbstractContextManager[object]:
    """bfloat16 where a device computes with it, else nothing."""
    if device.type == "cpu":
        capable = torch.cpu.get_capabilities()
        fast = bool(capable.get("avx512_bf16") or capable.get("amx_bf16"))
    else:
        fast = torch.cuda.is_bf16_supported(including_emulation=False)
    if not fast:
        return nullcontext()
    context: AbstractContextManager[object] = torch.autocast(device.type, dtype=torch.bfloat16)
    return context
