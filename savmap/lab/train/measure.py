"""How good a segmentation network is: intersection over union, where it puts the edges, whether its confidence can be
believed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.lab.train.data.dataset import IGNORE, Sample
from savmap.vision.networks.segmenter import Segmenter

Bytes = NDArray[np.uint8]
Maps = NDArray[np.float32]
Predictor = Callable[[Bytes], Maps]
"""Picture (H, W, 3) uint8 -> probabilities (1 + classes, H, W), background first."""

BINS = 15
SIDES = ("right", "bottom", "left", "top")
REACH_PX, STEP_PX = 4.0, 0.25


@dataclass(frozen=True, eq=False)
class EdgeOffsets:
    """Distances in px by which predicted edges lie outside (positive) or inside the true ones, and their sides."""

    offsets_px: NDArray[np.float64]
    sides: NDArray[np.int64]

    def summary(self) -> dict[str, float]:
        """Median offset of each side, of all, and the spread (half the width that holds the middle 68 %)."""
        if len(self.offsets_px) == 0:
            return {}
        low, middle, high = np.percentile(self.offsets_px, [16, 50, 84])
        sides = {
            f"{name}_px": float(np.median(self.offsets_px[self.sides == index]))
            for index, name in enumerate(SIDES)
            if np.any(self.sides == index)
        }
        return {**sides, "median_px": float(middle), "spread_px": float(high - low) / 2}


def intersection_and_union(predicted: Bytes, truth: Bytes, classes: int) -> NDArray[np.int64]:
    """Pixel counts (classes, 2) for masks (H, W); pixels to be ignored are left out."""
    valid = truth != IGNORE
    counts = [
        (np.sum((predicted == k) & (truth == k)), np.sum(((predicted == k) | (truth == k)) & valid))
        for k in range(1, classes + 1)
    ]
    return np.array(counts, np.int64)


def _profile(plane: Maps, points: NDArray[np.float32], normals: NDArray[np.float32]) -> Maps:
    """Values (n, steps) of `plane` along the normals (n, 2) through points (n, 2)."""
    steps = np.arange(-REACH_PX, REACH_PX + STEP_PX / 2, STEP_PX, dtype=np.float32)
    along = points[:, None, :] + steps[None, :, None] * normals[:, None, :]
    values = cv2.remap(plane, along[..., 0], along[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, np.float32)


def _outward_crossing(profile: Maps) -> NDArray[np.float64]:
    """Position (n,) in px where each profile falls through one half, nearest to its middle; NaN if nowhere."""
    falls = (profile[:, :-1] >= 0.5) & (profile[:, 1:] < 0.5)
    steps = profile.shape[1] - 1
    distance = np.abs(np.arange(steps) - steps / 2 + 0.5)
    nearest = np.argmin(np.where(falls, distance, np.inf), axis=1)
    rows = np.arange(len(profile))
    before, after = profile[rows, nearest], profile[rows, nearest + 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        position = (nearest + (before - 0.5) / (before - after)) * STEP_PX - REACH_PX
    return np.where(falls.any(axis=1), position, np.nan).astype(np.float64)


def edge_offsets(probability: Maps, truth: Bytes, value: int, limit: int = 2000) -> EdgeOffsets:
    """Compare the predicted edge (probability one half) with the true one along the true edge's normals.

    Only straight, clear pieces of boundary between the class and anything that is judged are used; edges not found
    within the reach are left out (they are misses, which IoU counts).
    """
    smooth = cv2.GaussianBlur((truth == value).astype(np.float32), (0, 0), 1.5)
    dx, dy = cv2.Scharr(smooth, cv2.CV_32F, 1, 0) / 32, cv2.Scharr(smooth, cv2.CV_32F, 0, 1) / 32
    strength = np.hypot(dx, dy)
    near_ignored = cv2.dilate((truth == IGNORE).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    usable = (np.abs(smooth - 0.5) < 0.16) & (strength > 0.2) & ~near_ignored
    margin = int(REACH_PX) + 2
    usable[:margin], usable[-margin:], usable[:, :margin], usable[:, -margin:] = False, False, False, False
    rows, columns = np.nonzero(usable)
    if len(rows) == 0:
        return EdgeOffsets(np.empty(0), np.empty(0, np.int64))
    chosen = np.linspace(0, len(rows) - 1, min(limit, len(rows))).astype(int)
    rows, columns = rows[chosen], columns[chosen]
    normals = -np.stack([dx[rows, columns], dy[rows, columns]], axis=1) / strength[rows, columns][:, None]
    points = np.stack([columns, rows], axis=1).astype(np.float32)
    true_at = _outward_crossing(_profile(smooth, points, normals))
    predicted_at = _outward_crossing(_profile(probability, points, normals))
    offsets = predicted_at - true_at
    sides = np.round(np.arctan2(normals[:, 1], normals[:, 0]) / (np.pi / 2)).astype(np.int64) % 4
    measured = np.isfinite(offsets)
    return EdgeOffsets(offsets[measured], sides[measured])


def measure(predict: Predictor, samples: Iterable[Sample], classes: Sequence[str]) -> dict[str, Mapping[str, float]]:
    """For each class its `iou` over all samples together, if it is in any, and the summary of its edges' offsets."""
    counts = np.zeros((len(classes), 2), np.int64)
    edges: list[list[EdgeOffsets]] = [[] for _ in classes]
    for sample in samples:
        image, truth = sample.load()
        maps = predict(image)
        counts += intersection_and_union(np.argmax(maps, axis=0).astype(np.uint8), truth, len(classes))
        for index, offsets in enumerate(edges):
            offsets.append(edge_offsets(np.ascontiguousarray(maps[index + 1]), truth, index + 1))
    return {name: _class_result(counts[index], edges[index]) for index, name in enumerate(classes)}


def _class_result(counts: NDArray[np.int64], edges: Sequence[EdgeOffsets]) -> dict[str, float]:
    offsets = np.concatenate([edge.offsets_px for edge in edges]) if edges else np.empty(0)
    sides = np.concatenate([edge.sides for edge in edges]) if edges else np.empty(0, np.int64)
    overlap = {"iou": float(counts[0] / counts[1])} if counts[1] else {}
    return {**overlap, **EdgeOffsets(offsets, sides).summary()}


@dataclass(frozen=True)
class NetworkScore:
    """Of `pictures`: each class's intersection over union (NaN where nothing is or was seen of it), and the expected
    calibration error over all pixels (Guo et al., On Calibration of Modern Neural Networks, 2017), both 0..1."""

    pictures: int
    iou: Mapping[str, float]
    calibration_error: float

    @property
    def mean(self) -> float:
        """Mean intersection over union of the classes; 0 where there is none."""
        finite = [value for value in self.iou.values() if np.isfinite(value)]
        return float(np.mean(finite)) if finite else 0.0

    def as_json(self) -> dict[str, object]:
        """For the recipe."""
        iou = {name: round(value, 4) for name, value in self.iou.items() if np.isfinite(value)}
        return {"pictures": self.pictures, "iou": iou, "calibration error": round(self.calibration_error, 5)}


class Reliability:
    """Counts how often a network is right, by how sure it is (confidence in bins of equal width)."""

    def __init__(self) -> None:
        self.counts = np.zeros((3, BINS))

    def add(self, probabilities: NDArray[np.float32], labels: NDArray[np.uint8]) -> None:
        """Probabilities (classes, ...) and true classes (...), 255 not to be judged."""
        valid = labels != IGNORE
        sure = probabilities.max(axis=0)[valid]
        right = probabilities.argmax(axis=0)[valid] == labels[valid]
        bins = np.minimum((sure * BINS).astype(np.int64), BINS - 1)
        for row, weights in enumerate((np.ones_like(sure), sure, right.astype(np.float64))):
            self.counts[row] += np.bincount(bins, weights, BINS)

    @property
    def error(self) -> float:
        """Expected calibration error: the mean distance of confidence from the share that is right."""
        total, sure, right = self.counts
        return float(np.abs(sure - right).sum() / max(total.sum(), 1))


def score_network(
    predict: Predictor, samples: Sequence[Sample], classes: Sequence[str], limit: int = 0
) -> NetworkScore:
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
    return NetworkScore(len(samples), iou, reliability.error)


def score_file(model: Path, samples: Sequence[Sample], classes: Sequence[str]) -> NetworkScore:
    """What the network in an ONNX file makes of labelled pictures. A class that it does not have is never seen. Raises
    ModelError."""
    segmenter = Segmenter(model, 1, providers=("cpu",))
    order = [segmenter.classes.index(name) + 1 if name in segmenter.classes else -1 for name in classes]

    def predict(image: NDArray[np.uint8]) -> NDArray[np.float32]:
        maps = segmenter.probabilities(image)
        selected = np.stack([maps[index] if index > 0 else np.zeros_like(maps[0]) for index in order])
        return np.concatenate([1 - selected.sum(axis=0, keepdims=True), selected]).astype(np.float32)

    return score_network(predict, samples, classes)
