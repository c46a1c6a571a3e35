"""Lamps in a ceiling-facing view: mask to centre (compact lamps) or to the two ends (strips). Paper, section III.C."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.plugin import Detection, Feature, Floats, Ints, View, point_feature, touches_border

STRIP_RATIO = 2.5
SIGMA_CENTRE_PX = 0.7
SIGMA_END_PX = 1.2
CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


def extract_features(view: View, detections: Sequence[Detection]) -> list[Feature]:
    """For each lamp a "centre" point, and for a strip an "end a" and an "end b" point where the frame does not cut it.

    A lamp that touches the frame's border has no centre. The ends of a strip come in no particular order.
    """
    features: list[Feature] = []
    for instance, detection in enumerate(detections):
        features += _lamp(view, detection, instance)
    return features


def _lamp(view: View, detection: Detection, instance: int) -> list[Feature]:
    rows, columns = _grown_pixels(detection.mask)
    weights = detection.probability[rows, columns].astype(np.float64)
    if weights.sum() <= 0:
        return []
    pixels = np.stack([columns, rows], axis=1).astype(np.float64)
    centre = np.average(pixels, axis=0, weights=weights)
    spread, axes = np.linalg.eigh(np.cov((pixels - centre).T, aweights=weights) + 1e-9 * np.eye(2))
    long, wide = np.sqrt(12 * spread[1]), np.sqrt(12 * spread[0])
    inside = not touches_border(detection.mask)
    points = [("centre", centre, SIGMA_CENTRE_PX)] if inside else []
    if long > STRIP_RATIO * wide:
        ends = _ends(pixels, weights, centre, axes[:, 1])
        size = (view.spec.width, view.spec.height)
        points += [
            (name, end, SIGMA_END_PX) for name, end in zip(("end a", "end b"), ends, strict=True) if _within(end, size)
        ]
    return [point_feature(view, detection, instance, *point) for point in points]


def _ends(pixels: Floats, weights: Floats, centre: Floats, axis: Floats) -> tuple[Floats, Floats]:
    """Both ends on the long axis: where the mean probability of a slice, one pixel long, falls below a half of its usual."""
    along = (pixels - centre) @ axis
    bins = np.floor(along).astype(np.int64)
    first = int(bins.min())
    profile = np.bincount(bins - first, weights=weights).astype(np.float64)
    level = 0.5 * float(np.median(profile[profile > 0.25 * profile.max()]))
    inner = np.nonzero(profile >= level)[0]
    low = inner[0] + first - _fraction(profile, int(inner[0]), -1, level)
    high = inner[-1] + first + 1 + _fraction(profile, int(inner[-1]), 1, level)
    return centre + low * axis, centre + high * axis


def _fraction(profile: Floats, index: int, step: int, level: float) -> float:
    """How far the end reaches into the slice after the last full one, 0..1: the share of that slice's mass."""
    after = index + step
    if not 0 <= after < len(profile):
        return 0.0
    return float(min(1.0, profile[after] / max(profile[index], 1e-9)))


def _grown_pixels(mask: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Rows and columns (n,), in scan order, of a mask grown by a pixel."""
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    left, top = max(left - 1, 0), max(top - 1, 0)
    rows, columns = np.nonzero(cv2.dilate(mask[top : top + height + 2, left : left + width + 2].view(np.uint8), CROSS))
    return rows + top, columns + left


def _within(pixel: Floats, size: tuple[int, int], margin: float = 3.0) -> bool:
    return bool(margin <= pixel[0] <= size[0] - 1 - margin and margin <= pixel[1] <= size[1] - 1 - margin)
