"""The network in training on a device: loss, optimiser, averaged weights."""

import copy
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from savmap.lab.train.data.dataset import IGNORE
from savmap.lab.train.made.network import TwoScaleNetwork, probabilities
from savmap.lab.train.network import INPUT_SCALE
from savmap.lab.train.trainer import DICE_SHARE, edge_weights, learning_rate_factor

ENCODER_RATE, DECODER_RATE = 5e-4, 3e-3
WEIGHT_DECAY = 1e-3
AVERAGE_DECAY = 0.998
WARM_UP = 0.03
MOST_GRADIENT = 2.0


def full_size(logits: Tensor) -> Tensor:
    """Probabilities (n, 1 + C, H, W) at the picture's size, as mapping interpolates them."""
    return functional.interpolate(probabilities(logits.float()), scale_factor=2.0, mode="bilinear", align_corners=False)


def loss_of(seen: Tensor, labels: Tensor, accepted: Tensor) -> Tensor:
    """Cross entropy, heavier near edges, of probabilities (n, C, H, W) for labels (n, H, W), and the overlap of each
    class with what is labelled as it; `accepted` (n, C, C) are the classes that count where the label is one
    (`pool.acceptance`)."""
    valid = labels != IGNORE
    targets = torch.where(valid, labels, 0)
    counts = accepted[torch.arange(len(labels), device=labels.device)[:, None, None], targets].permute(0, 3, 1, 2)
    right = (counts * seen).sum(dim=1)
    weights = edge_weights(labels) * valid
    entropy = -(right.clamp(min=1e-6).log() * weights).sum() / weights.sum().clamp(min=1)
    overlaps = []
    for value in range(1, seen.shape[1]):
        truth = ((targets == value) & valid).float()
        overlap, wrong = (right * truth).sum(), (seen[:, value] * (counts[:, value] == 0) * valid).sum()
        overlaps.append((2 * overlap + 1) / (overlap + wrong + truth.sum() + 1))
    return entropy + DICE_SHARE * (1 - torch.stack(overlaps).mean())


class Learner:
    """A network in training: `step` improves it by one batch; `average` is what is measured and exported."""

    def __init__(self, network: TwoScaleNetwork, device: torch.device) -> None:
        self.device = device
        self.network = network.to(device, memory_format=torch.channels_last).train()
        self.average = copy.deepcopy(network).eval()
        self.updates = 0
        self._pairs = [(mine, network.state_dict()[name]) for name, mine in self.average.state_dict().items()]
        torch.backends.cudnn.benchmark = device.type == "cuda"  # crops have one size
        groups: dict[float, list[Any]] = {}
        for name, weight in network.named_parameters():
            rate = ENCODER_RATE if name.startswith(("blocks.", "stem.")) else DECODER_RATE
            if weight.dim() == 4 and weight.shape[1] == 3:
                rate /= INPUT_SCALE  # it reads pixels of 0..255
            groups.setdefault(rate, []).append(weight)
        self._optimizer = torch.optim.AdamW(
            [{"params": weights, "lr": rate, "most": rate} for rate, weights in groups.items()],
            weight_decay=WEIGHT_DECAY,
            fused=device.type == "cuda",
        )

    def state(self) -> dict[str, Any]:
        """All that `restore` needs to go on."""
        return {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "updates": self.updates,
            "optimizer": self._optimizer.state_dict(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.updates = state["updates"]
        if "optimizer" in state:
            self._optimizer.load_state_dict(state["optimizer"])

    def step(self, images: Tensor, labels: Tensor, accepted: Tensor, done: float) -> Tensor:
        """One update when the share `done` of the budget is spent; the loss, where torch computes."""
        factor = learning_rate_factor(done, WARM_UP)
        for group in self._optimizer.param_groups:
            group["lr"] = group["most"] * factor
        with fast_arithmetic(self.device):
            logits = self.network(images.contiguous(memory_format=torch.channels_last))
        loss = loss_of(full_size(logits), labels, accepted)
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), MOST_GRADIENT)
        self._optimizer.step()
        self._follow()
        return loss.detach()

    def _follow(self) -> None:
        self.updates += 1
        decay = min(AVERAGE_DECAY, (1 + self.updates) / (10 + self.updates))
        with torch.no_grad():
            floats = [(mine, theirs) for mine, theirs in self._pairs if mine.is_floating_point()]
            torch._foreach_lerp_([mine for mine, _ in floats], [theirs for _, theirs in floats], 1 - decay)
            for mine, theirs in self._pairs:
                if not mine.is_floating_point():
                    mine.copy_(theirs)


def fast_arithmetic(device: torch.device) -> AbstractContextManager[object]:
    """bfloat16 on CUDA devices."""
    return torch.autocast("cuda", dtype=torch.bfloat16) if device.type == "cuda" else nullcontext()
