"""A network that looks at a picture and its mirror image at several sizes: thin objects are seen better than at one size.

The mean over transformed pictures labels pictures for the network itself (Radosavovic et al., Data Distillation: Towards Omni-Supervised
Learning, CVPR 2018).
"""

from collections.abc import Sequence

import cv2
import numpy as np

from savmap.train.measure import Bytes, Maps, Predictor

ZOOMS = (1.0, 1.25, 1.5)
STRIDE = 32
"""Networks are shown pictures whose sides are multiples of this."""


def magnified(predict: Predictor, zooms: Sequence[float] = ZOOMS) -> Predictor:
    """A predictor that gives the mean of the probabilities (1 + classes, H, W) of a picture and its mirror image at several magnifications.
    `predict` must take pictures of any size whose sides are multiples of `STRIDE`."""

    def mean(image: Bytes) -> Maps:
        mirrored = np.ascontiguousarray(image[:, ::-1])
        seen = [side for zoom in zooms for side in (_at(predict, image, zoom), _at(predict, mirrored, zoom)[..., ::-1])]
        return np.asarray(np.mean(seen, axis=0), np.float32)

    return mean


def _at(predict: Predictor, image: Bytes, zoom: float) -> Maps:
    """The probabilities (1 + classes, H, W) of a picture (H, W, 3) that is magnified for the network."""
    height, width = image.shape[:2]
    large = cv2.resize(image, (round(width * zoom), round(height * zoom)), interpolation=cv2.INTER_CUBIC)
    tall, wide = large.shape[:2]
    padded = cv2.copyMakeBorder(large, 0, -tall % STRIDE, 0, -wide % STRIDE, cv2.BORDER_REFLECT_101)
    maps = predict(np.asarray(padded, np.uint8))[:, :tall, :wide].transpose(1, 2, 0)
    return np.asarray(cv2.resize(maps, (width, height), interpolation=cv2.INTER_AREA).transpose(2, 0, 1), np.float32)
