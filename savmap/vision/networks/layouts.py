"""Adapters of the layouts of networks that are taken, each with what its file must give."""

import ast
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from savmap.errors import ModelError
from savmap.vision.networks.adapter import (
    WHITE,
    Instance,
    Probabilities,
    Segmentation,
    letterboxed,
    logistic,
    merged,
    planes,
    stretched,
)
from savmap.vision.networks.session import OnnxSignature, Run, Tensor

ADVICE = "train one with `savmap train`, or point `model` at a file that it wrote"
LEAST_SCORE, MOST_OVERLAP, MOST_INSTANCES = 0.25, 0.7, 300
"""Of YOLO's, as ultralytics predicts unless told otherwise."""
USUAL_SIZE = (640, 640)
LOGISTIC, SOFTMAX = ("labels",), ("class_queries_logits", "logits", "pred_logits")
"""Names of the outputs with the queries' scores, by what makes probabilities of them."""
LEAST_QUERY_SCORE = 0.5
COARSE = (1, 2, 4, 8)
"""How many pixels of the input a semantic output's may stand for, along either side."""
STEP = 32
MEAN = np.array([0.485, 0.456, 0.406], np.float32)[:, None, None]
DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)[:, None, None]

Image = NDArray[np.uint8]
Labels = Sequence[str | None]
Boxes = tuple[Probabilities, Probabilities, NDArray[np.int64], Probabilities]
"""Boxes by their corners (k, 4), scores (k,), numbers of classes (k,) and mask coefficients (k, m)."""


class Semantic:
    """A network that gives each pixel's class, as `savmap train` writes them, in float32 or 8-bit integers.

    The file must say what it is in its metadata: `savmap.format` = "semantic", `savmap.classes` (JSON list, background
    left out) and `savmap.output` = "probabilities" or "logits" (so if it is missing). Its input is one picture, (1, 3,
    h, w) float32, RGB 0..255; its output (1, 1 + classes, h', w') float32, background first, of the same shape or up to
    eight times as coarse. Raises ModelError for a file that breaks this contract.
    """

    kind = "semantic"
    layout = 'semantic (savmap.format = "semantic" in its metadata)'

    def __init__(self, signature: OnnxSignature, run: Run) -> None:
        if signature.names is None:
            raise ModelError(f"{signature.path}: its metadata names no classes (savmap.classes, a JSON list); {ADVICE}")
        self.names = signature.names
        self.input_size = _fixed_size(signature)
        self._run = run
        self._gives_logits = _gives_logits(signature)
        _check_output(signature, len(self.names) + 1, self.input_size)

    @classmethod
    def accepts(cls, signature: OnnxSignature) -> bool:
        """Whether a file says that it is of this kind."""
        return signature.metadata.get("savmap.format") == cls.kind

    def predict(self, image: Image, labels: Labels, classes: tuple[str, ...]) -> Segmentation:
        """Maps of all classes; where several of the network's classes count as one, their sum."""
        size = image.shape[1::-1]
        result: Probabilities = self._run(network_input(image, self.input_size))[0][0]
        maps = softmax(result, axis=0) if self._gives_logits else result
        if tuple(labels) != classes:
            maps = _summed(maps, labels, classes)
        if maps.shape[:0:-1] != size:
            resized = [cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR) for plane in maps]
            maps = np.stack(resized).astype(np.float32, copy=False)
        return Segmentation(classes, maps)


def _gives_logits(signature: OnnxSignature) -> bool:
    given = signature.metadata.get("savmap.output", "logits")
    if given not in ("logits", "probabilities"):
        raise ModelError(
            f"{signature.path}: savmap.output must be `logits` or `probabilities`, not `{given}`; {ADVICE}"
        )
    return given == "logits"


def _fixed_size(signature: OnnxSignature) -> tuple[int, int]:
    size = signature.input_size if signature.takes_picture else None
    if size is None or signature.inputs[0].kind != "tensor(float)":
        shapes = [list(tensor.shape) for tensor in signature.inputs]
        raise ModelError(
            f"{signature.path}: its input must be one float32 tensor (1, 3, height, width), not {shapes}; {ADVICE}"
        )
    return size


def _check_output(signature: OnnxSignature, channels: int, size: tuple[int, int]) -> None:
    outputs, (width, height) = signature.outputs, size
    expected = [(channels, height // coarse, width // coarse) for coarse in COARSE]
    if len(outputs) != 1 or outputs[0].kind != "tensor(float)" or outputs[0].shape[1:] not in expected:
        shapes = [list(output.shape) for output in outputs]
        raise ModelError(
            f"{signature.path}: its output must be one float32 tensor (1, {channels}, {height}, {width}), or 2, 4 or 8 "
            f"times as coarse, not {shapes}; {ADVICE}"
        )


def _summed(maps: Probabilities, labels: Labels, classes: Sequence[str]) -> Probabilities:
    """Maps of `classes`: sums of the network's classes that count as each, and all the rest as background."""
    sums = [maps[1:][[label == name for label in labels]].sum(axis=0) for name in classes]
    rest = maps[0] + maps[1:][[label is None for label in labels]].sum(axis=0)
    return np.stack([rest, *sums])


def network_input(image: Image, size: tuple[int, int]) -> Probabilities:
    """Picture (H, W, 3) uint8 RGB of any size -> (1, 3, h, w) float32 0..255 of `size` (w, h)."""
    return planes(stretched(image, size)[0])


class Yolo:
    """A YOLO segmentation network as ultralytics exports it (YOLOv8, YOLO11 and others with the same outputs).

    Input: one letterboxed picture, (1, 3, h, w), RGB 0..1, float32 or float16. Outputs, in any order: rows of boxes
    (centre, width, height in pixels of the input), class scores 0..1 and m mask coefficients, (1, 4 + classes + m, n);
    and m mask prototypes, (1, m, h/4, w/4). Exports that leave out double boxes themselves (`nms=True`, `end2end`) give
    (1, n, 6 + m) instead: corners, score, number of the class, coefficients. Metadata: `names`, and `task` and `imgsz`
    if given. An instance's mask is the logistic function of its coefficients times the prototypes, inside its box
    (Bolya et al., YOLACT, 2019). Raises ModelError where outputs and names do not fit together.
    """

    kind = "YOLO-seg"
    layout = "YOLO-seg (output0 (1, 4 + classes + m, n), output1 (1, m, h/4, w/4))"

    def __init__(self, signature: OnnxSignature, run: Run) -> None:
        rows, prototypes = _outputs(signature)
        self._path, self._run = signature.path, run
        self._numbers = signature.outputs.index(rows), signature.outputs.index(prototypes)
        self._masks = prototypes.shape[1] or 32
        self._complete = _is_complete(rows, self._masks, signature.names)
        self.names = signature.names or _numbered(signature, rows, self._masks)
        self.input_size = signature.input_size or _size_in_metadata(signature)
        channels = 6 + self._masks if self._complete else 4 + len(self.names) + self._masks
        given = rows.shape[2 if self._complete else 1]
        if given not in (None, channels):
            raise ModelError(
                f"{signature.path}: {len(self.names)} classes and {self._masks} masks make {channels} numbers a box, "
                f"but {rows} has {given}; export the network again"
            )

    @staticmethod
    def accepts(signature: OnnxSignature) -> bool:
        """Whether a file has the inputs and outputs of this kind, and says nothing else of its task."""
        segments = signature.takes_picture and signature.metadata.get("task", "segment") == "segment"
        ranks = sorted(len(output.shape) for output in signature.outputs)
        if not segments or ranks != [3, 4]:
            return False
        rows, prototypes = _outputs(signature)
        channels = prototypes.shape[1]
        if channels is None or rows.shape[1] is None or _is_complete(rows, channels, signature.names):
            return "names" in signature.metadata
        return rows.shape[1] > 4 + channels

    def predict(self, image: Image, labels: Labels, classes: tuple[str, ...]) -> Segmentation:
        """The instances of the classes, merged."""
        picture, fit = letterboxed(image, self.input_size)
        outputs = self._run(planes(picture) / WHITE)
        rows, prototypes = (outputs[number][0].astype(np.float32) for number in self._numbers)
        boxes, scores, kinds, coefficients = _ends(rows) if self._complete else self._suppressed(rows)
        sure = np.flatnonzero(scores >= LEAST_SCORE)
        self._require_named(kinds[sure])
        chosen = [box for box in sure.tolist() if labels[kinds[box]] is not None][:MOST_INSTANCES]
        cell = self.input_size[0] / prototypes.shape[2]
        windows = fit.window(boxes[chosen].astype(np.float64), cell)
        logits = np.tensordot(coefficients[chosen], prototypes, 1)
        instances = [
            Instance(str(labels[kinds[box]]), float(scores[box]), logit, window)
            for box, logit, window in zip(chosen, logits, windows, strict=True)
        ]
        return merged(instances, classes, fit)

    def _require_named(self, kinds: NDArray[np.int64]) -> None:
        """Raise ModelError for numbers of classes that the metadata does not name."""
        unknown = kinds[(kinds < 0) | (kinds >= len(self.names))]
        if unknown.size:
            raise ModelError(f"{self._path}: gives class {unknown[0]}, but its metadata names {len(self.names)} from 0")

    def _suppressed(self, rows: Probabilities) -> Boxes:
        """The surest boxes first, after non-maximum suppression by class."""
        count = len(self.names)
        columns = rows.T
        kinds = columns[:, 4 : 4 + count].argmax(axis=1)
        scores = columns[:, 4 : 4 + count].max(axis=1)
        likely = np.flatnonzero(scores >= LEAST_SCORE)
        centres, sizes = columns[likely, :2], columns[likely, 2:4]
        corners = centres - sizes / 2
        kept = cv2.dnn.NMSBoxesBatched(
            np.hstack([corners, sizes]).tolist(),
            scores[likely].tolist(),
            kinds[likely].tolist(),
            LEAST_SCORE,
            MOST_OVERLAP,
        )
        chosen = np.asarray(kept, np.int64).reshape(-1)
        boxes = np.asarray(np.hstack([corners, corners + sizes])[chosen], np.float32)
        rows_kept = likely[chosen]
        return boxes, scores[rows_kept], kinds[rows_kept], columns[rows_kept, 4 + count :]


def _outputs(signature: OnnxSignature) -> tuple[Tensor, Tensor]:
    return signature.of_rank(3)[0], signature.of_rank(4)[0]


def _is_complete(rows: Tensor, masks: int, names: Sequence[str] | None) -> bool:
    """Whether double boxes are left out already: boxes are rows, not columns."""
    return rows.shape[2] == 6 + masks and rows.shape[1] != 4 + len(names or ()) + masks


def _numbered(signature: OnnxSignature, rows: Tensor, masks: int) -> tuple[str, ...]:
    if rows.shape[1] is None:
        raise ModelError(f"{signature.path}: its metadata has no `names`; export the network again")
    return tuple(map(str, range(rows.shape[1] - 4 - masks)))


def _size_in_metadata(signature: OnnxSignature) -> tuple[int, int]:
    """Width and height of a network without a fixed size: `imgsz`, [height, width] or one number for both."""
    try:
        given = ast.literal_eval(signature.metadata["imgsz"])
        height, width = (given, given) if isinstance(given, int) else map(int, given)
    except (KeyError, ValueError, SyntaxError, TypeError):
        return USUAL_SIZE
    return (width, height) if width > 0 and height > 0 else USUAL_SIZE


def _ends(rows: Probabilities) -> Boxes:
    """The same of a network that leaves out double boxes itself."""
    return rows[:, :4], rows[:, 4], rows[:, 5].astype(np.int64), rows[:, 6:]


class Detr:
    """A network that answers queries, each with a class and a mask over the whole picture: DETR and what followed it.

    Input: one stretched picture, (1, 3, h, w), RGB 0..1 less ImageNet's mean, over its standard deviation. Outputs: a
    mask's logits for each of q queries, (1, q, h', w'), the only output with four sides, and their class logits by
    name:

    - `labels` (1, q, classes): logistic, as RF-DETR's segmentation networks give them (`dets`, `labels`, `masks`);
    - `class_queries_logits` (Mask2Former and MaskFormer of transformers), `logits` or `pred_logits` (DETR): (1, q,
      classes + 1), softmax, the last one for no object.

    Boxes are not used. Classes are named in the metadata (`savmap.classes` or `names`), or else by their numbers from
    0. Raises ModelError where outputs and names do not fit together.
    """

    kind = "DETR-like"
    layout = "DETR-like (labels, class_queries_logits, logits or pred_logits (1, q, classes), masks (1, q, h, w))"

    def __init__(self, signature: OnnxSignature, run: Run) -> None:
        scores = _scores(signature)
        self._run = run
        self._numbers = signature.outputs.index(scores), signature.outputs.index(signature.of_rank(4)[0])
        self._softmax = scores.name in SOFTMAX
        self.names = _query_names(signature, scores, int(self._softmax))
        self.input_size = signature.input_size

    @staticmethod
    def accepts(signature: OnnxSignature) -> bool:
        """Whether a file has the inputs and outputs of this kind."""
        scores = [output for output in signature.of_rank(3) if output.name in LOGISTIC + SOFTMAX]
        return signature.takes_picture and len(scores) == 1 and len(signature.of_rank(4)) == 1

    def predict(self, image: Image, labels: Labels, classes: tuple[str, ...]) -> Segmentation:
        """The queries that are sure of one of the classes, merged."""
        picture, fit = stretched(image, self.input_size or _rounded_up(image))
        outputs = self._run((planes(picture) / WHITE - MEAN) / DEVIATION)
        logits, masks = (outputs[number][0].astype(np.float32) for number in self._numbers)
        scores = softmax(logits, axis=1)[:, :-1] if self._softmax else logistic(logits)
        kinds, best = scores.argmax(axis=1), scores.max(axis=1)
        whole = np.array([0, 0, fit.width, fit.height])
        instances = [
            Instance(label, float(best[query]), masks[query], whole)
            for query in np.flatnonzero(best >= LEAST_QUERY_SCORE).tolist()
            if (label := labels[kinds[query]]) is not None
        ]
        return merged(instances, classes, fit)


def _scores(signature: OnnxSignature) -> Tensor:
    return next(output for output in signature.of_rank(3) if output.name in LOGISTIC + SOFTMAX)


def _query_names(signature: OnnxSignature, scores: Tensor, nothing: int) -> tuple[str, ...]:
    """The classes; `nothing`: how many of the scores are for no object."""
    count, names = scores.shape[2], signature.names
    if names is None and count is None:
        raise ModelError(f"{signature.path}: neither its metadata nor the shape of `{scores.name}` tells its classes")
    if names is None or count is None:
        return names or tuple(map(str, range((count or 0) - nothing)))
    if len(names) != count - nothing:
        raise ModelError(
            f"{signature.path}: its metadata names {len(names)} classes, but {scores} has {count - nothing}"
        )
    return names


def _rounded_up(image: Image) -> tuple[int, int]:
    height, width = image.shape[:2]
    return -(-width // STEP) * STEP, -(-height // STEP) * STEP
