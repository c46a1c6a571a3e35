"""Pixels to classes: a network in an ONNX file, and what it detects (paper, "Segmentation").

Which files are taken, and how each is read: `savmap.vision.networks`, docs/networks.md.
"""

import difflib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.types import Detection
from savmap.vision.networks import detr, semantic, yolo
from savmap.vision.networks.adapter import Adapter, Probabilities, Sight, detections, regions
from savmap.vision.networks.semantic import network_input
from savmap.vision.networks.session import Opened, opened


def adapter_for(opened: Opened) -> Adapter:
    """The adapter of an opened file. Raises ModelError where it is of no kind that is taken, or breaks its kind's contract."""
    face, run = opened.face, opened.run
    if semantic.recognises(face):
        return semantic.Semantic(face, run)
    if yolo.recognises(face):
        return yolo.Yolo(face, run)
    if detr.recognises(face):
        return detr.Detr(face, run)
    taken = ", ".join((semantic.LAYOUT, yolo.LAYOUT, detr.LAYOUT))
    raise ModelError(f"{face.path}: a network with {face} is of no kind that is taken: {taken}; see docs/networks.md")


def labels_of(
    names: Sequence[str], class_names: Mapping[str, str], wanted: Collection[str] | None, where: str
) -> tuple[str | None, ...]:
    """For each of a network's classes what it counts as: the name that `class_names` gives for it or for its number, else its own; None
    where that is not among those `wanted`, if any are named. Raises ModelError for a name in `class_names` that the network has not."""
    numbers = {str(number): name for number, name in enumerate(names)}
    for key in class_names:
        if key not in names and key not in numbers:
            near = difflib.get_close_matches(key, names, 1)
            hint = f"did you mean `{near[0]}`?" if near else f"it has {few(names)}"
            raise ModelError(f"{where}: `class_names` names `{key}`, which the network does not give; {hint}")
    found = [class_names.get(name, class_names.get(str(number), name)) for number, name in enumerate(names)]
    return tuple(label if wanted is None or label in wanted else None for label in found)


def few(names: Sequence[str], most: int = 12) -> str:
    """The first of some names, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


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
