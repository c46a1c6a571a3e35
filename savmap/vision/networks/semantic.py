"""Networks that give each pixel's class: what `savmap train` writes, in float32 or 8-bit integers.

The file must say what it is in its metadata: `savmap.format` = "semantic", `savmap.classes` (JSON list, background left
out) and `savmap.output` = "probabilities" or "logits" (so if it is missing). Its input is one picture, (1, 3, h, w) float32, RGB 0..255; its output
(1, 1 + classes, h, w) float32, background first.
"""

import json
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.vision.networks.adapter import Probabilities, Sight, softmax
from savmap.vision.networks.letterbox import planes, stretched
from savmap.vision.networks.session import Run
from savmap.vision.networks.signature import Face

FORMAT = "semantic"
LAYOUT = 'semantic (savmap.format = "semantic" in its metadata)'
ADVICE = "train one with `savmap train`, or point `model` at a file that it wrote"


class Semantic:
    """A network of this kind. Raises ModelError for a file that breaks the contract."""

    kind = FORMAT

    def __init__(self, face: Face, run: Run) -> None:
        self.names = _classes(face)
        self.input_size: tuple[int, int] = _input_size(face)
        self._run = run
        self._gives_logits = _gives_logits(face)
        _check_output(face, len(self.names) + 1, self.input_size)

    def see(self, image: NDArray[np.uint8], labels: Sequence[str | None], classes: tuple[str, ...]) -> Sight:
        """Maps of all classes; where several of the network's count as one class, their sum."""
        height, width = image.shape[:2]
        result: Probabilities = self._run(network_input(image, self.input_size))[0][0]
        maps = softmax(result, 0) if self._gives_logits else result
        if tuple(labels) != classes:
            maps = _summed(maps, labels, classes)
        return Sight(classes, maps if (width, height) == self.input_size else _resized(maps, width, height))


def recognises(face: Face) -> bool:
    """Whether a file says that it is of this kind."""
    return face.metadata.get("savmap.format") == FORMAT


def _classes(face: Face) -> tuple[str, ...]:
    try:
        names = json.loads(face.metadata["savmap.classes"])
    except (KeyError, ValueError) as error:
        raise ModelError(
            f"{face.path}: its metadata names no classes (savmap.classes, a JSON list); {ADVICE}"
        ) from error
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise ModelError(f"{face.path}: savmap.classes must be a JSON list of names, not {names!r}; {ADVICE}")
    return tuple(names)


def _gives_logits(face: Face) -> bool:
    given = face.metadata.get("savmap.output", "logits")
    if given not in ("logits", "probabilities"):
        raise ModelError(f"{face.path}: savmap.output must be `logits` or `probabilities`, not `{given}`; {ADVICE}")
    return given == "logits"


def _input_size(face: Face) -> tuple[int, int]:
    size = face.input_size if face.takes_picture else None
    if size is None or face.inputs[0].kind != "tensor(float)":
        shapes = [list(one.shape) for one in face.inputs]
        raise ModelError(
            f"{face.path}: its input must be one float32 tensor (1, 3, height, width), not {shapes}; {ADVICE}"
        )
    return size


def _check_output(face: Face, channels: int, size: tuple[int, int]) -> None:
    outputs, expected = face.outputs, (channels, size[1], size[0])
    if len(outputs) != 1 or outputs[0].kind != "tensor(float)" or outputs[0].shape[1:] != expected:
        found = [list(output.shape) for output in outputs]
        raise ModelError(
            f"{face.path}: its output must be one float32 tensor (1, {list(expected)}), not {found}; {ADVICE}"
        )


def _summed(maps: Probabilities, labels: Sequence[str | None], classes: Sequence[str]) -> Probabilities:
    """Maps of `classes`: what is asked for of the network's, and as background all the rest."""
    own = [maps[1:][[label == one for label in labels]].sum(axis=0) for one in classes]
    rest = maps[0] + maps[1:][[label is None for label in labels]].sum(axis=0)
    return np.stack([rest, *own])


def _resized(maps: Probabilities, width: int, height: int) -> Probabilities:
    return np.stack([cv2.resize(plane, (width, height), interpolation=cv2.INTER_LINEAR) for plane in maps])


def network_input(image: NDArray[np.uint8], size: tuple[int, int]) -> Probabilities:
    """Picture (H, W, 3) uint8 RGB of any size -> (1, 3, h, w) float32 0..255 of `size` (w, h)."""
    return planes(stretched(image, size)[0])
