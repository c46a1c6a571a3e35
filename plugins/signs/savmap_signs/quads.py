"""Masks of signs to quadrilaterals."""

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Floats

LEAST_SIDE_PX = 5.0
LEAST_FILLED = 0.8
BORDER_PX = 2


def quad_of(mask: NDArray[np.bool_]) -> Floats | None:
    """Corners (4, 2) px of a mask (h, w), from the upper left one clockwise; None where the picture's border cuts it, where it is
    tiny, or no quadrilateral."""
    if _cut(mask):
        return None
    contours, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(contours, key=cv2.contourArea)
    hull = np.asarray(cv2.convexHull(outline), np.int32)
    corners = _four(hull)
    area = float(cv2.contourArea(corners.astype(np.float32)))
    grown = float(mask.sum())
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    if sides.min() < LEAST_SIDE_PX or grown < LEAST_FILLED * area:
        return None
    return clockwise(_padded(corners))


def _four(hull: NDArray[np.int32]) -> Floats:
    """The hull with as few corners as leave it alike: four, or those of the least rectangle around it."""
    length = cv2.arcLength(hull, True)
    for share in np.arange(0.02, 0.12, 0.01):
        found = cv2.approxPolyDP(hull, share * length, True)
        if len(found) == 4:
            return found.reshape(4, 2).astype(np.float64)
        if len(found) < 4:
            break
    return np.asarray(cv2.boxPoints(cv2.minAreaRect(hull)), np.float64)


def _padded(corners: Floats) -> Floats:
    """From the centres of the outermost pixels to their outer borders: half a pixel further out."""
    away = corners - corners.mean(axis=0)
    padded: Floats = corners + 0.5 * np.sign(away)
    return padded


def clockwise(corners: Floats) -> Floats:
    """Four corners in order around as the picture shows them, beginning at the upper left."""
    away = corners - corners.mean(axis=0)
    around = corners[np.argsort(np.arctan2(away[:, 1], away[:, 0]), kind="stable")]
    return np.roll(around, -int(np.argmin(around.sum(axis=1))), axis=0)


def _cut(mask: NDArray[np.bool_]) -> bool:
    near = BORDER_PX
    return bool(mask[:near].any() or mask[-near:].any() or mask[:, :near].any() or mask[:, -near:].any())
