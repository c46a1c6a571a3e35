"""What every adapter is to the rest of savmap: a network that sees classes in a picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from savmap.stages.regions import Probabilities, detections, parts
from savmap.types import Detection


@dataclass(frozen=True)
class Sight:
    """What a network saw in a picture: `maps` (1 + classes, H, W) float32, background first, and, of a network that tells
    instances apart, whose each pixel is, `owners` (classes, H, W): the instance's number in its class, from 1; 0 nobody's."""

    classes: tuple[str, ...]
    maps: Probabilities
    owners: NDArray[np.int16] | None = None

    def detections(self, threshold: float, min_pixels: int) -> list[Detection]:
        """Connected regions of `min_pixels` or more where a class's probability is above `threshold`, instance by instance where
        the network tells them apart. All of a class share its probability over the whole picture."""
        if self.owners is None:
            return detections(self.maps, self.classes, threshold, min_pixels)
        return [
            found
            for label, probability, owner in zip(self.classes, self.maps[1:], self.owners, strict=True)
            for number in range(1, int(owner.max()) + 1)
            for found in parts(
                label, ((owner == number) & (probability > threshold)).astype(np.uint8), probability, min_pixels
            )
        ]


class Adapter(Protocol):
    """A kind of network file, opened. `names` are the network's own classes in its own order."""

    kind: str
    names: tuple[str, ...]

    @property
    def input_size(self) -> tuple[int, int] | None:
        """Width and height of the input, None where the file leaves them open."""
        ...

    def see(self, image: NDArray[np.uint8], labels: Sequence[str | None], classes: tuple[str, ...]) -> Sight:
        """What it sees in a picture (H, W, 3) uint8 RGB of any size. `labels`: for each of `names` the class that it counts as,
        None where it is not asked for; `classes`: those that are, in order."""
        ...
