"""Data distillation: a teacher, which is a network that the map's labels taught, completes them, and the network learns
from the result.

The map judges about half of a view's pixels. Members' ends, what goods hide in part, and what lies beside the row have
no label. The teacher labels them by the mean of what it sees in the view and in its mirror image, at several
magnifications: thin members are seen better magnified. Where the map judges, its label stays, unless the teacher sees
next to nothing of it. Source: Radosavovic et al., Data Distillation: Towards Omni-Supervised Learning (CVPR 2018).
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from savmap.lab.adapt.labels import Labelled, write_set
from savmap.lab.adapt.masks import IGNORE, Bytes
from savmap.lab.train.data.dataset import Sample
from savmap.lab.train.data.sets import read_set
from savmap.lab.train.measure import Maps, Predictor
from savmap.lab.train.plan import Progress

SURE = 0.6
"""What the map does not judge is labelled where the network gives a class such a probability."""
REFUTED = 0.05
"""A label of the map to which the network gives less is replaced."""
ZOOMS = (1.0, 1.25, 1.5)
STRIDE = 32
"""Networks are shown pictures whose sides are multiples of this."""


def distilled(network: Path, source: Path, folder: Path, classes: Sequence[str], progress: Progress) -> Path:
    """Write the pictures of a data set, with labels that a float32 network completed, as a data set in a folder, unless
    it is there. `classes`: the network's. Raises OutputError, ModelError."""
    if not folder.is_dir():
        write_set(folder, classes, _labelled(network, read_set(source, classes).samples, classes, progress))
    return folder


def _labelled(
    network: Path, samples: Sequence[Sample], classes: Sequence[str], progress: Progress
) -> Iterator[Labelled]:
    from savmap.lab.train.export import load_onnx  # torch, an extra, is imported when it is needed
    from savmap.lab.train.trainer import compute_device, predictor

    predict = magnified(predictor(load_onnx(network, classes)[0].to(compute_device())))
    for number, sample in enumerate(samples):
        progress(number / len(samples), f"labelling {sample.image.name}")
        image, labels = sample.load()
        yield sample.image.stem, image, completed(labels, predict(image))


def completed(labels: Bytes, maps: Maps) -> Bytes:
    """Labels (H, W) of a view, completed and corrected by a network's probabilities (1 + classes, H, W)."""
    best = maps.argmax(axis=0).astype(np.uint8)
    seen = np.where(maps.max(axis=0) >= SURE, best, IGNORE)
    valid = labels != IGNORE
    agreed = np.take_along_axis(maps, np.where(valid, labels, 0)[None].astype(np.intp), axis=0)[0]
    return np.where(valid, np.where(agreed < REFUTED, best, labels), seen).astype(np.uint8)


def magnified(predict: Predictor, zooms: Sequence[float] = ZOOMS) -> Predictor:
    """A predictor that gives the mean of the probabilities (1 + classes, H, W) of a picture and its mirror image at
    several magnifications. `predict` must take pictures of any size whose sides are multiples of `STRIDE`."""

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
