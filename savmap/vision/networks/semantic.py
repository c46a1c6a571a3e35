"""Networks that give each pixel's class, as `savmap train` writes them, in float32 or 8-bit integers.

The file must say what it is in its metadata: `savmap.format` = "semantic", `savmap.classes` (JSON list, background left
out) and `savmap.output` = "probabilities" or "logits" (so if it is missing). Its input is one picture, (1, 3, h, w)
float32, RGB 0..255; its output (1, 1 + classes, h, w) float32, background first.
"""

import json
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from savmap.errors import ModelError
from savmap.vision.networks.adapter import Probabilities, Segmentation
from savmap.vision.networks.letterbox import planes, stretched
from savmap.vision.networks.session import Run
from savmap.vision.networks.signature import OnnxSignature

FORMAT = "semantic"
LAYOUT = 'semantic (savmap.format = "semantic" in its metadata)'
ADVICE = "train one with `savmap train`, or point `model` at a file that it wrote"


class Semantic:
    """A network of this kind. Raises ModelError for a file that breaks the contract."""

    kind = FORMAT

    def __init__(self, signature: OnnxSignature, run: Run) -> None:
        self.names = _classes(signature)
        self.input_size: tuple[int, int] = _input_size(signature)
        self._run = run
        self._gives_logits = _gives_logits(signature)
        _check_output(signature, len(self.names) + 1, self.input_size)

    def predict(self, image: NDArray[np.uint8], labels: Sequence[str | None], classes: tuple[str, ...]) -> Segmentation:
        """Maps of all classes; where several of the network's classes count as one, their sum."""
        height, width = image.shape[:2]
        result: Probabilities = self._run(network_input(image, self.input_size))[0][0]
        maps = softmax(result, axis=0) if self._gives_logits else result
        if tuple(labels) != classes:
            maps = _summed(maps, labels, classes)
        return Segmentation(classes, maps if (width, height) == self.input_size else _resized(maps, width, height))


def accepts(signature: OnnxSignature) -> bool:
    """Whether a file says that it is of this kind."""
    return signature.metadata.get("savmap.format") == FORMAT


def _classes(signature: OnnxSignature) -> tuple[str, ...]:
    try:
        names = json.loads(signature.metadata["savmap.classes"])
    except (KeyError, ValueError) as error:
        raise ModelError(
            f"{signature.path}: its metadata names no classes (savmap.classes, a JSON list); {ADVICE}"
        ) from error
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise ModelError(f"{signature.path}: savmap.classes must be a JSON list of names, not {names!r}; {ADVICE}")
    return tuple(names)


def _gives_logits(signature: OnnxSignature) -> bool:
    given = signature.metadata.get("savmap.output", "logits")
    if given not in ("logits", "probabilities"):
        raise ModelError(
            f"{signature.path}: savmap.output must be `logits` or `probabilities`, not `{given}`; {ADVICE}"
        )
    return given == "logits"


def _input_size(signature: OnnxSignature) -> tuple[int, int]:
    size = signature.input_size if signature.takes_picture else None
    if size is None or signature.inputs[0].kind != "tensor(float)":
        shapes = [list(tensor.shape) for tensor in signature.inputs]
        raise ModelError(
            f"{signature.path}: its input must be one float32 tensor (1, 3, height, width), not {shapes}; {ADVICE}"
        )
    return size


def _check_output(signature: OnnxSignature, channels: int, size: tuple[int, int]) -> None:
    outputs, expected = signature.outputs, (channels, size[1], size[0])
    if len(outputs) != 1 or outputs[0].kind != "tensor(float)" or outputs[0].shape[1:] != expected:
        shapes = [list(output.shape) for output in outputs]
        raise ModelError(
            f"{signature.path}: its output must be one float32 tensor (1, {list(expected)}), not {shapes}; {ADVICE}"
        )


def _summed(maps: Probabilities, labels: Sequence[str | None], classes: Sequence[str]) -> Probabilities:
    """Maps of `classes`: sums of the network's classes that count as each, and all the rest as background."""
    sums = [maps[1:][[label == name for label in labels]].sum(axis=0) for name in classes]
    rest = maps[0] + maps[1:][[label is None for label in labels]].sum(axis=0)
    return np.stack([rest, *sums])


def _resized(maps: Probabilities, width: int, height: int) -> Probabilities:
    return np.stack([cv2.resize(plane, (width, height), interpolation=cv2.INTER_LINEAR) for plane in maps])


def network_input(image: NDArray[np.uint8], size: tuple[int, int]) -> Probabilities:
    """Picture (H, W, 3) uint8 RGB of any size -> (1, 3, h, w) float32 0..255 of `size` (w, h)."""
    return planes(stretched(image, size)[0])
