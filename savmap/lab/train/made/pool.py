"""Labelled pictures held where torch computes, by kind; batches are drawn by kinds' shares."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from savmap.lab.sim.dataset import Sample
from savmap.lab.train.data.dataset import HEIGHT, WIDTH


class Pool:
    """Up to `capacity` pictures (3, 480, 640) uint8 and masks; when it is full, the oldest that are not `kept` go."""

    def __init__(self, capacity: int, kinds: Sequence[str], device: torch.device) -> None:
        self.images = torch.empty((capacity, 3, HEIGHT, WIDTH), dtype=torch.uint8, device=device)
        self.masks = torch.empty((capacity, HEIGHT, WIDTH), dtype=torch.uint8, device=device)
        self.kinds = tuple(kinds)
        self._kind = np.full(capacity, -1)
        self._weight = np.zeros(capacity)
        self._kept = self._next = self.added = 0

    def add(self, kind: str, pictures: Sequence[Sample], weight: float = 1.0, keep: bool = False) -> None:
        """Hold pictures (480, 640, 3) of a kind with their masks; those that are kept come first of all."""
        for image, mask in pictures:
            self.images[self._next] = self._sent(image.transpose(2, 0, 1))
            self.masks[self._next] = self._sent(mask)
            self._kind[self._next], self._weight[self._next] = self.kinds.index(kind), weight
            self.added += 1
            self._next += 1
            if keep:
                self._kept = self._next
            elif self._next == len(self._kind):
                self._next = self._kept

    def _sent(self, values: NDArray[np.uint8]) -> Tensor:
        tensor = torch.from_numpy(np.ascontiguousarray(values))
        return tensor.pin_memory().to(self.images.device, non_blocking=True) if self.images.is_cuda else tensor

    def counts(self) -> dict[str, int]:
        """How many pictures of each kind there are."""
        return {kind: int((self._kind == number).sum()) for number, kind in enumerate(self.kinds)}

    def draw(
        self, size: int, shares: Mapping[str, float], rng: np.random.Generator
    ) -> tuple[Tensor, Tensor, list[str]]:
        """Pictures (n, 3, 480, 640), masks (n, 480, 640) and kinds; kinds that are not there yet give their share to
        the others."""
        present = [kind for kind, number in self.counts().items() if number and shares.get(kind)]
        chances = np.array([shares[kind] for kind in present])
        numbers = rng.multinomial(size, chances / chances.sum())
        places = np.concatenate([self._of(kind, number, rng) for kind, number in zip(present, numbers, strict=True)])
        index = torch.from_numpy(places).to(self.images.device, non_blocking=True)
        return self.images[index], self.masks[index], np.repeat(present, numbers).tolist()

    def _of(self, kind: str, number: int, rng: np.random.Generator) -> NDArray[np.int64]:
        places = np.flatnonzero(self._kind == self.kinds.index(kind))
        weights = self._weight[places]
        if weights.min() == weights.max():
            return places[rng.integers(len(places), size=number)]
        return rng.choice(places, number, p=weights / weights.sum())


def acceptance(
    kinds: Sequence[str], rows: Mapping[str, NDArray[np.float32]], classes: int, device: torch.device
) -> Tensor:
    """(n, 1 + classes, 1 + classes): how much of the probability of each class counts, where the label is one, in
    pictures of some kinds. Where nothing else is said, that of the label alone."""
    identity = np.eye(classes + 1, dtype=np.float32)
    return torch.from_numpy(np.stack([rows.get(kind, identity) for kind in kinds])).to(device, non_blocking=True)
