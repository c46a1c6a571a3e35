"""Masks to points on outlines: along each straight side of a pallet's mask, where the probability falls through one half."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from savmap.types import Detection, Feature, Floats, View

WHOLE, CUT = "outline", "cut outline"
LEAST_AREA_PX = 150
LEAST_SIDE_PX = 10.0
ROUNDED = 0.12
APART_PX, MOST_POINTS = 8.0, 6
REACH_PX, STEP_PX = 3.0, 0.25
MARGIN_PX = 4.0
SIGMA_PX = 1.0


def extract_features(view: View, detections: Sequence[Detection]) -> list[Feature]:
    """Points on the outline of each pallet; `part` says whether the frame cuts it. Its corners, which networks round, are left
    out."""
    features: list[Feature] = []
    for instance, detection in enumerate(detections):
        if detection.mask.sum() >= LEAST_AREA_PX:
            features += _pallet(view, detection, instance)
    return features


def _pallet(view: View, detection: Detection, instance: int) -> Iterator[Feature]:
    size = np.array([view.spec.width, view.spec.height]) - 1.0
    outline = _outline(detection)
    whole = bool((outline > 1.5).all() and (outline < size - 1.5).all())
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        for pixel in _crossings(detection.probability, start, end):
            if (pixel > MARGIN_PX).all() and (pixel < size - MARGIN_PX).all():
                yield Feature(
                    view.frame,
                    view.spec.name,
                    detection.label,
                    WHOLE if whole else CUT,
                    instance,
                    pixel[None],
                    SIGMA_PX**2 * np.eye(2)[None],
                    score=detection.score,
                )


def _outline(detection: Detection) -> Floats:
    """The hull (n, 2) of a mask, px, with short sides merged; one's interior is on the same hand all the way round."""
    contours, _ = cv2.findContours(detection.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(contours, key=cv2.contourArea)
    hull = cv2.approxPolyDP(cv2.convexHull(largest), 1.5, True)
    return np.asarray(hull, np.float64).reshape(-1, 2)


def _crossings(probability: np.ndarray[tuple[int, ...], np.dtype[np.float32]], start: Floats, end: Floats) -> Floats:
    """Points (n, 2), px, where the probability falls through one half across a side."""
    length = float(np.linalg.norm(end - start))
    if length < LEAST_SIDE_PX:
        return np.zeros((0, 2))
    count = int(np.clip(length / APART_PX, 2, MOST_POINTS))
    along = start + np.linspace(ROUNDED, 1 - ROUNDED, count)[:, None] * (end - start)
    across = np.array([end[1] - start[1], start[0] - end[0]]) / length
    steps = np.arange(-REACH_PX, REACH_PX + STEP_PX / 2, STEP_PX)
    places = (along[:, None] + steps[:, None] * across).astype(np.float32)
    values = cv2.remap(probability, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inside, outside = values[:, :-1] - 0.5, values[:, 1:] - 0.5
    passes = inside * outside < 0
    first = np.argmax(passes, axis=1)
    rows = np.flatnonzero(passes.sum(axis=1) == 1)
    before, after = inside[rows, first[rows]], outside[rows, first[rows]]
    crossing = steps[first[rows]] + STEP_PX * before / (before - after)
    return np.asarray(along[rows] + crossing[:, None] * across, np.float64)
