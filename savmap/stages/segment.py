"""Pixels to classes: a segmentation network in an ONNX file, and the connected regions it sees (paper, "Segmentation").

The file must say what it is in its metadata: `savmap.format` = "semantic", `savmap.classes` (JSON list, background left
out) and `savmap.output` = "probabilities" or "logits". Its input is `image`, (1, 3, h, w) float32, RGB 0..255; its output
(1, 1 + classes, h, w) float32, background first.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.types import Detection

FORMAT = "semantic"
ADVICE = "train one with `savmap train`, or point `model` at a file that it wrote"

Probabilities = NDArray[np.float32]


def _session(path: Path, threads: int) -> onnxruntime.InferenceSession:
    if not path.is_file():
        raise ModelError(f"{path}: no such model file; {ADVICE}")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own exceptions share no base class but Exception
        raise ModelError(f"{path}: not a usable ONNX model; {ADVICE}") from error


def _classes(path: Path, metadata: Mapping[str, str]) -> tuple[str, ...]:
    if metadata.get("savmap.format") != FORMAT:
        raise ModelError(f"{path}: its metadata does not say savmap.format = {FORMAT}; {ADVICE}")
    try:
        names = json.loads(metadata["savmap.classes"])
    except (KeyError, ValueError) as error:
        raise ModelError(f"{path}: its metadata names no classes (savmap.classes, a JSON list); {ADVICE}") from error
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise ModelError(f"{path}: savmap.classes must be a JSON list of names, not {names!r}; {ADVICE}")
    return tuple(names)


def _input_size(path: Path, session: onnxruntime.InferenceSession) -> tuple[int, int]:
    inputs = session.get_inputs()
    shape = inputs[0].shape if len(inputs) == 1 else []
    fixed = len(shape) == 4 and shape[1] == 3 and all(isinstance(side, int) for side in shape[2:])
    if not fixed or inputs[0].type != "tensor(float)":
        raise ModelError(f"{path}: its input must be one float32 tensor (1, 3, height, width), not {shape}; {ADVICE}")
    return int(shape[3]), int(shape[2])


def _check_output(path: Path, session: onnxruntime.InferenceSession, channels: int, size: tuple[int, int]) -> None:
    outputs = session.get_outputs()
    expected = [channels, size[1], size[0]]
    if len(outputs) != 1 or outputs[0].type != "tensor(float)" or list(outputs[0].shape[1:]) != expected:
        found = [list(output.shape) for output in outputs]
        raise ModelError(f"{path}: its output must be one float32 tensor (1, {expected}), not {found}; {ADVICE}")


def _softmax(logits: Probabilities) -> Probabilities:
    exponentials = np.exp(logits - logits.max(axis=0))
    return np.asarray(exponentials / exponentials.sum(axis=0), np.float32)


def _resized(maps: Probabilities, width: int, height: int) -> Probabilities:
    return np.stack([cv2.resize(plane, (width, height), interpolation=cv2.INTER_LINEAR) for plane in maps])


def network_input(image: NDArray[np.uint8], size: tuple[int, int]) -> Probabilities:
    """Picture (H, W, 3) uint8 RGB of any size -> (1, 3, h, w) float32 0..255 of `size` (w, h)."""
    width, height = image.shape[1], image.shape[0]
    how = cv2.INTER_AREA if width > size[0] else cv2.INTER_LINEAR
    picture = image if (width, height) == size else cv2.resize(image, size, interpolation=how)
    return np.stack(cv2.split(picture)).astype(np.float32)[None]


class Segmenter:
    """A network ready to run. Raises ModelError for a file that is missing, is no ONNX model, or breaks the contract."""

    def __init__(self, path: Path, threads: int = 2) -> None:
        self._session = _session(path, threads)
        metadata = self._session.get_modelmeta().custom_metadata_map
        self.path = path
        self.classes = _classes(path, metadata)
        self.version = metadata.get("savmap.version", "unknown")
        self.input_size = _input_size(path, self._session)
        self._gives_logits = metadata.get("savmap.output", "logits") == "logits"
        self._input_name = self._session.get_inputs()[0].name
        _check_output(path, self._session, len(self.classes) + 1, self.input_size)

    def probabilities(self, image: NDArray[np.uint8]) -> Probabilities:
        """Picture (H, W, 3) uint8 RGB of any size -> (1 + classes, H, W) float32 in 0..1, background first."""
        height, width = image.shape[:2]
        planes = network_input(image, self.input_size)
        result: Probabilities = self._session.run(None, {self._input_name: planes})[0][0]
        maps = _softmax(result) if self._gives_logits else result
        return maps if (width, height) == self.input_size else _resized(maps, width, height)


def regions(label: str, probability: Probabilities, threshold: float, min_pixels: int) -> list[Detection]:
    """Connected regions (8-neighbourhood) where the class's probability (H, W) is above `threshold`, in scan order.

    Regions of fewer than `min_pixels` are left out. The score is the mean probability over the region.
    """
    above = (probability > threshold).astype(np.uint8)
    count, numbers, stats, _ = cv2.connectedComponentsWithStatsWithAlgorithm(above, 8, cv2.CV_32S, cv2.CCL_GRANA)
    kept = [number for number in range(1, count) if stats[number, cv2.CC_STAT_AREA] >= min_pixels]
    found = []
    for number in kept:
        left, top, width, height = stats[number, :4]
        place = slice(top, top + height), slice(left, left + width)
        inside = numbers[place] == number
        mask = np.zeros(numbers.shape, dtype=np.bool_)
        mask[place] = inside
        found.append(Detection(label, float(probability[place][inside].mean(dtype=np.float64)), mask, probability))
    return found


def detections(maps: Probabilities, classes: Sequence[str], threshold: float, min_pixels: int) -> list[Detection]:
    """Regions of every class in maps (1 + classes, H, W), background first, class by class."""
    return [
        detection
        for label, probability in zip(classes, maps[1:], strict=True)
        for detection in regions(label, np.ascontiguousarray(probability), threshold, min_pixels)
    ]
