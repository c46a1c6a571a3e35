"""Segmentation of pictures by a network in an ONNX file (paper, "Segmentation").

docs/networks.md says which files are accepted; each kind has an adapter in this package.
"""

import difflib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.types import Detection, Thresholds
from savmap.vision.networks.adapter import Probabilities, Segmentation, regions
from savmap.vision.networks.layouts import Detr, Semantic, Yolo, network_input
from savmap.vision.networks.session import OpenNetwork, open_network

__all__ = ["Probabilities", "Segmentation", "Segmenter", "network_input", "regions"]


LAYOUTS = (Semantic, Yolo, Detr)
LEAST_SIDE, MOST_SIDE = 8, 8192
"""Of a network's picture, pixels."""


class Segmenter:
    """A network ready to run, whatever its kind.

    class_names: new names of its classes (by name, or by number from 0); wanted: classes to keep, all if None;
    providers: execution providers by their short names, none for the automatic choice. Raises ModelError for a file
    that is missing, is no ONNX model, is of no accepted kind, or breaks its kind's contract.
    """

    def __init__(
        self,
        path: Path,
        threads: int = 2,
        class_names: Mapping[str, str] | None = None,
        wanted: Collection[str] | None = None,
        providers: Sequence[str] = (),
    ) -> None:
        network = open_network(path, threads, providers)
        self._adapter = adapter_for(network)
        self._labels = labels_of(self._adapter.names, class_names or {}, wanted, str(path))
        self.path, self.file = path, network.path
        self.kind, self.provider, self.note = self._adapter.kind, network.provider, network.note
        self.names = self._adapter.names
        self.classes = tuple(dict.fromkeys(label for label in self._labels if label is not None))
        self.version = network.signature.metadata.get("savmap.version", "unknown")
        self.input_size = self._adapter.input_size

    def predict(self, image: NDArray[np.uint8]) -> Segmentation:
        """Segment a picture (H, W, 3) uint8 RGB of any size."""
        return self._adapter.predict(image, self._labels, self.classes)

    def probabilities(self, image: NDArray[np.uint8]) -> Probabilities:
        """Picture (H, W, 3) uint8 RGB of any size -> (1 + classes, H, W) float32 in 0..1, background first."""
        return self.predict(image).maps

    def detections(self, image: NDArray[np.uint8], threshold: float | Thresholds, min_pixels: int) -> list[Detection]:
        """Connected regions of `min_pixels` or more of each class where its probability is above `threshold`, by
        hysteresis where it is three of them, instance by instance where the network tells them apart."""
        return self.predict(image).detections(threshold, min_pixels)

    def __str__(self) -> str:
        size = "any size" if self.input_size is None else "x".join(map(str, self.input_size))
        return f"{self.file.name}: {self.kind}, {size}, on {self.provider}"


def adapter_for(network: OpenNetwork) -> Semantic | Yolo | Detr:
    """The adapter for a network's kind. Raises ModelError where there is none, or where the file breaks its kind's
    contract."""
    signature, run = network.signature, network.run
    size = signature.input_size if signature.takes_picture else None
    if size is not None and not all(LEAST_SIDE <= side <= MOST_SIDE for side in size):
        raise ModelError(
            f"{signature.path}: takes pictures of {size[0]}x{size[1]}; sides are {LEAST_SIDE} to {MOST_SIDE} pixels"
        )
    for kind in LAYOUTS:
        if kind.accepts(signature):
            return kind(signature, run)
    taken = ", ".join(layout.layout for layout in LAYOUTS)
    raise ModelError(
        f"{signature.path}: a network with {signature} is of no kind that is taken: {taken}; see docs/networks.md"
    )


def labels_of(
    names: Sequence[str], class_names: Mapping[str, str], wanted: Collection[str] | None, where: str
) -> tuple[str | None, ...]:
    """What each of a network's classes counts as: what `class_names` gives for its name or number, else its name; None
    where that is not `wanted`. Raises ModelError for a name in `class_names` that the network does not have."""
    numbers = {str(number): name for number, name in enumerate(names)}
    for key in class_names:
        if key not in names and key not in numbers:
            near = difflib.get_close_matches(key, names, 1)
            hint = f"did you mean `{near[0]}`?" if near else f"it has {shortened(names)}"
            raise ModelError(f"{where}: `class_names` names `{key}`, which the network does not give; {hint}")
    labels = [class_names.get(name, class_names.get(str(number), name)) for number, name in enumerate(names)]
    return tuple(label if wanted is None or label in wanted else None for label in labels)


def shortened(names: Sequence[str], most: int = 12) -> str:
    """The first of some names, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
