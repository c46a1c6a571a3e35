"""YOLO segmentation networks as ultralytics exports them (YOLOv8, YOLO11 and others with the same outputs).

Input: one letterboxed picture, (1, 3, h, w), RGB 0..1, float32 or float16. Outputs, in any order: rows of
boxes (centre, width, height in pixels of the input), class scores 0..1 and m mask coefficients, (1, 4 + classes + m,
n); and m mask prototypes, (1, m, h/4, w/4). Exports that leave out double boxes themselves (`nms=True`, `end2end`) give
(1, n, 6 + m) instead: corners, score, number of the class, coefficients. Metadata: `names`, and `task` and `imgsz`
where they are there. An instance's mask is the logistic function of its coefficients times the prototypes, inside its
box (Bolya et al., YOLACT, 2019).
"""

import ast
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.vision.networks.adapter import Segmentation
from savmap.vision.networks.instances import Instance, merged
from savmap.vision.networks.letterbox import WHITE, letterboxed, planes
from savmap.vision.networks.session import Run
from savmap.vision.networks.signature import OnnxSignature, Tensor

KIND = "YOLO-seg"
LAYOUT = "YOLO-seg (output0 (1, 4 + classes + m, n), output1 (1, m, h/4, w/4))"
LEAST_SCORE, MOST_OVERLAP, MOST_FOUND = 0.25, 0.7, 300
"""As ultralytics predicts unless told otherwise."""
USUAL_SIZE = (640, 640)

Singles = NDArray[np.float32]


class Yolo:
    """A network of this kind. Raises ModelError for one whose outputs and names do not fit together."""

    kind = KIND

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

    def predict(self, image: NDArray[np.uint8], labels: Sequence[str | None], classes: tuple[str, ...]) -> Segmentation:
        """The instances of the classes, merged."""
        picture, fit = letterboxed(image, self.input_size)
        outputs = self._run(planes(picture) / WHITE)
        rows, prototypes = (outputs[number][0].astype(np.float32) for number in self._numbers)
        boxes, scores, kinds, coefficients = _ends(rows) if self._complete else self._suppressed(rows)
        sure = np.flatnonzero(scores >= LEAST_SCORE)
        self._require_named(kinds[sure])
        chosen = [box for box in sure.tolist() if labels[kinds[box]] is not None][:MOST_FOUND]
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

    def _suppressed(self, rows: Singles) -> tuple[Singles, Singles, NDArray[np.int64], Singles]:
        """Boxes by their corners (k, 4), scores, numbers of classes and coefficients, the surest first, after
        non-maximum suppression by class."""
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


def accepts(signature: OnnxSignature) -> bool:
    """Whether a file has the inputs and outputs of this kind, and says nothing else of its task."""
    if (
        not signature.takes_picture
        or len(signature.outputs) != 2
        or signature.metadata.get("task", "segment") != "segment"
    ):
        return False
    if len(signature.of_rank(3)) != 1 or len(signature.of_rank(4)) != 1:
        return False
    rows, prototypes = _outputs(signature)
    channels = prototypes.shape[1]
    if channels is None or rows.shape[1] is None or _is_complete(rows, channels, signature.names):
        return "names" in signature.metadata
    return rows.shape[1] > 4 + channels


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
    """Width and height that a network without a fixed size was made for: `imgsz`, [height, width] or one number for
    both."""
    try:
        given = ast.literal_eval(signature.metadata["imgsz"])
        height, width = (given, given) if isinstance(given, int) else map(int, given)
    except (KeyError, ValueError, SyntaxError, TypeError):
        return USUAL_SIZE
    return (width, height) if width > 0 and height > 0 else USUAL_SIZE


def _ends(rows: Singles) -> tuple[Singles, Singles, NDArray[np.int64], Singles]:
    """The same of a network that leaves out double boxes itself."""
    return rows[:, :4], rows[:, 4], rows[:, 5].astype(np.int64), rows[:, 6:]
