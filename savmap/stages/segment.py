"""Pixels to classes: a network in an ONNX file, and what it detects (paper, "Segmentation").

Which files are taken, and how each is read: `savmap.stages.networks`, docs/networks.md.
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from savmap.stages.networks.adapter import Sight
from savmap.stages.networks.choose import adapter_for, labels_of
from savmap.stages.networks.semantic import network_input
from savmap.stages.networks.session import opened
from savmap.stages.regions import Probabilities, detections, regions
from savmap.types import Detection

__all__ = ["Probabilities", "Segmenter", "detections", "network_input", "regions"]


class Segmenter:
    """A network ready to run, whatever its kind.

    class_names: what its classes (names, or numbers from 0) are called here; wanted: classes that are asked for, all if None;
    providers: execution providers by their short names, none for the automatic choice. Raises ModelError for a file
    that is missing, is no ONNX model, is of no kind that is taken, or breaks its kind's contract.
    """

    def __init__(
        self,
        path: Path,
        threads: int = 2,
        class_names: Mapping[str, str] | None = None,
        wanted: Collection[str] | None = None,
        providers: Sequence[str] = (),
    ) -> None:
        network = opened(path, threads, providers)
        self._adapter = adapter_for(network)
        self._labels = labels_of(self._adapter.names, class_names or {}, wanted, str(path))
        self.path, self.file = path, network.path
        self.kind, self.provider, self.note = self._adapter.kind, network.provider, network.note
        self.names = self._adapter.names
        self.classes = tuple(dict.fromkeys(label for label in self._labels if label is not None))
        self.version = network.face.metadata.get("savmap.version", "unknown")
        self.input_size = self._adapter.input_size

    def see(self, image: NDArray[np.uint8]) -> Sight:
        """What the network sees in a picture (H, W, 3) uint8 RGB of any size."""
        return self._adapter.see(image, self._labels, self.classes)

    def probabilities(self, image: NDArray[np.uint8]) -> Probabilities:
        """Picture (H, W, 3) uint8 RGB of any size -> (1 + classes, H, W) float32 in 0..1, background first."""
        return self.see(image).maps

    def detections(self, image: NDArray[np.uint8], threshold: float, min_pixels: int) -> list[Detection]:
        """Connected regions of `min_pixels` or more of each class where its probability is above `threshold`, instance by instance
        where the network tells them apart."""
        return self.see(image).detections(threshold, min_pixels)

    def __str__(self) -> str:
        size = "any size" if self.input_size is None else "x".join(map(str, self.input_size))
        return f"{self.file.name}: {self.kind}, {size}, on {self.provider}"
