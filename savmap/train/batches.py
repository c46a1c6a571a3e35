"""Endless augmented batches, prepared by a thread while the network computes."""

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from queue import Full, Queue

import numpy as np
from numpy.typing import NDArray

from savmap.train.augment import Crop, augment
from savmap.train.dataset import Sample

Batch = tuple[NDArray[np.uint8], NDArray[np.uint8]]
"""Pictures (n, h, w, 3) and masks (n, h, w)."""


@dataclass(frozen=True)
class BatchSource:
    """What is drawn from: samples with their probabilities (n,), the network's number of classes, sizes and seed. A run that goes
    on after `start` batches draws others than it began with."""

    samples: Sequence[Sample]
    weights: NDArray[np.float64]
    classes: int
    size: int
    seed: int
    crop: Crop = field(default_factory=Crop)
    start: int = 0

    def __iter__(self) -> Iterator[Batch]:
        rng = np.random.default_rng([self.seed, self.start] if self.start else self.seed)
        while True:
            drawn = rng.choice(len(self.samples), self.size, p=self.weights)
            variants = []
            for index in drawn:
                image, mask = self.samples[index].load()
                variants.append(augment(rng, image, mask, self.crop, self.classes))
            yield np.stack([image for image, _ in variants]), np.stack([mask for _, mask in variants])


def prefetched(source: BatchSource, stop: threading.Event, depth: int = 4) -> Iterator[Batch]:
    """The batches of `source` in order, made ahead by a thread until `stop` is set; its errors are raised here."""
    queue: Queue[Batch | Exception] = Queue(depth)

    def put(item: Batch | Exception) -> None:
        while not stop.is_set():
            try:
                return queue.put(item, timeout=0.2)
            except Full:
                continue

    def work() -> None:
        try:
            for batch in source:
                put(batch)
                if stop.is_set():
                    return
        except Exception as error:
            put(error)

    threading.Thread(target=work, daemon=True).start()
    while True:
        item = queue.get()
        if isinstance(item, Exception):
            raise item
        yield item
