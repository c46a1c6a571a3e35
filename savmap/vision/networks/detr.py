"""Networks that answer queries, each with a class and a mask over the whole picture: DETR and what followed it.

Input: one stretched picture, (1, 3, h, w), RGB 0..1 less ImageNet's mean, over its standard deviation. Outputs: a
mask's logits for each of q queries, (1, q, h', w'), the only output with four sides, and their class logits by name:

- `labels` (1, q, classes): logistic, as RF-DETR's segmentation networks give them (`dets`, `labels`, `masks`);
- `class_queries_logits` (Mask2Former and MaskFormer of transformers), `logits` or `pred_logits` (DETR): (1, q, classes
+ 1), softmax, the last
  one for no object.

Boxes are not used. Classes are named in the metadata (`savmap.classes` or `names`), or else by their numbers from 0.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from savmap.errors import ModelError
from savmap.vision.networks.adapter import Segmentation, logistic
from savmap.vision.networks.instances import Instance, merged
from savmap.vision.networks.letterbox import WHITE, planes, stretched
from savmap.vision.networks.session import Run
from savmap.vision.networks.signature import OnnxSignature, Tensor

KIND = "DETR-like"
LAYOUT = "DETR-like (labels, class_queries_logits, logits or pred_logits (1, q, classes), masks (1, q, h, w))"
LOGISTIC, SOFTMAX = ("labels",), ("class_queries_logits", "logits", "pred_logits")
LEAST_SCORE = 0.5
STEP = 32
MEAN = np.array([0.485, 0.456, 0.406], np.float32)[:, None, None]
DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)[:, None, None]


class Detr:
    """A network of this kind. Raises ModelError for one whose outputs and names do not fit together."""

    kind = KIND

    def __init__(self, signature: OnnxSignature, run: Run) -> None:
        scores = _scores(signature)
        self._run = run
        self._numbers = signature.outputs.index(scores), signature.outputs.index(signature.of_rank(4)[0])
        self._softmax = scores.name in SOFTMAX
        self.names = _names(signature, scores, int(self._softmax))
        self.input_size = signature.input_size

    def predict(self, image: NDArray[np.uint8], labels: Sequence[str | None], classes: tuple[str, ...]) -> Segmentation:
        """The queries that are sure of one of the classes, merged."""
        picture, fit = stretched(image, self.input_size or _rounded_up(image))
        outputs = self._run((planes(picture) / WHITE - MEAN) / DEVIATION)
        logits, masks = (outputs[number][0].astype(np.float32) for number in self._numbers)
        scores = softmax(logits, axis=1)[:, :-1] if self._softmax else logistic(logits)
        kinds, best = scores.argmax(axis=1), scores.max(axis=1)
        whole = np.array([0, 0, fit.width, fit.height])
        instances = [
            Instance(label, float(best[query]), masks[query], whole)
            for query in np.flatnonzero(best >= LEAST_SCORE).tolist()
            if (label := labels[kinds[query]]) is not None
        ]
        return merged(instances, classes, fit)


def accepts(signature: OnnxSignature) -> bool:
    """Whether a file has the inputs and outputs of this kind."""
    known = [output for output in signature.of_rank(3) if output.name in LOGISTIC + SOFTMAX]
    return signature.takes_picture and len(known) == 1 and len(signature.of_rank(4)) == 1


def _scores(signature: OnnxSignature) -> Tensor:
    return next(output for output in signature.of_rank(3) if output.name in LOGISTIC + SOFTMAX)


def _names(signature: OnnxSignature, scores: Tensor, nothing: int) -> tuple[str, ...]:
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


def _rounded_up(image: NDArray[np.uint8]) -> tuple[int, int]:
    height, width = image.shape[:2]
    return -(-width // STEP) * STEP, -(-height // STEP) * STEP
