"""How well a network does on pictures: intersection over union, and whether its confidence can be believed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from savmap.train.dataset import IGNORE, Sample
from savmap.train.measure import Predictor, intersection_and_union
from savmap.vision.networks.segmenter import Segmenter

BINS = 15


@dataclass(frozen=True)
class Verdict:
    """Of `pictures`: each class's intersection over union (NaN where nothing is or was seen of it), and the expected
    calibration error over all pixels (Guo et al., On Calibration of Modern Neural Networks, 2017), both 0..1."""

    pictures: int
    iou: Mapping[str, float]
    calibration_error: float

    @property
    def mean(self) -> float:
        """Mean intersection over union of the classes; 0 where there is none."""
        known = [one for one in self.iou.values() if np.isfinite(one)]
        return float(np.mean(known)) if known else 0.0

    def as_json(self) -> dict[str, object]:
        """For the recipe."""
        iou = {name: round(one, 4) for name, one in self.iou.items() if np.isfinite(one)}
        return {"pictures": self.pictures, "iou": iou, "calibration error": round(self.calibration_error, 5)}


class Reliability:
    """Counts how often a network is right, by how sure it is (confidence in bins of equal width)."""

    def __init__(self) -> None:
        self.counts = np.zeros((3, BINS))

    def add(self, probabilities: NDArray[np.float32], labels: NDArray[np.uint8]) -> None:
        """Probabilities (classes, ...) and true classes (...), 255 not to be judged."""
        judged = labels != IGNORE
        sure = probabilities.max(axis=0)[judged]
        right = probabilities.argmax(axis=0)[judged] == labels[judged]
        bins = np.minimum((sure * BINS).astype(np.int64), BINS - 1)
        for row, weights in enumerate((np.ones_like(sure), sure, right.astype(np.float64))):
            self.counts[row] += np.bincount(bins, weights, BINS)

    @property
    def error(self) -> float:
        """Expected calibration error: the mean distance of confidence from the share that is right."""
        total, sure, right = self.counts
        return float(np.abs(sure - right).sum() / max(total.sum(), 1))


def judge(predict: Predictor, samples: Sequence[Sample], classes: Sequence[str], limit: int = 0) -> Verdict:
    """What a predictor makes of labelled pictures: of `limit` of them, evenly chosen, if it is positive."""
    if 0 < limit < len(samples):
        samples = [samples[index] for index in np.linspace(0, len(samples) - 1, limit).astype(int)]
    counts, reliability = np.zeros((len(classes), 2), np.int64), Reliability()
    for sample in samples:
        image, truth = sample.load()
        maps = predict(image)
        counts += intersection_and_union(np.argmax(maps, axis=0).astype(np.uint8), truth, len(classes))
        reliability.add(maps, truth)
    iou = {
        name: float(both / either) if either else np.nan for name, (both, either) in zip(classes, counts, strict=True)
    }
    return Verdict(len(samples), iou, reliability.error)


def judge_file(model: Path, samples: Sequence[Sample], classes: Sequence[str]) -> Verdict:
    """What the network in an ONNX file makes of labelled pictures. A class that it does not have is never seen. Raises ModelError."""
    segmenter = Segmenter(model, 1, providers=("cpu",))
    order = [segmenter.classes.index(name) + 1 if name in segmenter.classes else -1 for name in classes]

    def predict(image: NDArray[np.uint8]) -> NDArray[np.float32]:
        maps = segmenter.probabilities(image)
        own = np.stack([maps[index] if index > 0 else np.zeros_like(maps[0]) for index in order])
        return np.concatenate([1 - own.sum(axis=0, keepdims=True), own]).astype(np.float32)

    return judge(predict, samples, classes)
