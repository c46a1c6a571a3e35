"""Masks to polygons and back, to the pixel: corners are on pixels' corners, (0, 0) the picture's upper left one, as in
COCO.

A polygon is (n, 2) float64, x and y in pixels. A hole is joined to its outline by a cut of no width, so that one
polygon says it all, whether a reader fills it by the even-odd rule or by winding number.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

Polygon = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_PIXELS = 12
TOLERANCE_PX = 0.35


def outlines(mask: Mask, tolerance_px: float = TOLERANCE_PX, least_pixels: int = LEAST_PIXELS) -> list[Polygon]:
    """A polygon for each connected region of a mask (h, w), holes cut in; regions and holes of less than about
    `least_pixels` are left out. It cuts inner corners of the pixels' borders by half a pixel along each side, and may
    be `tolerance_px` away from what is then left (Douglas and Peucker)."""
    borders, tree = cv2.findContours(_corner_grid(mask), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if tree is None:
        return []
    rings = [cv2.approxPolyDP(border, 2 * tolerance_px, True)[:, 0].astype(np.float64) / 2 for border in borders]
    sizes = [cv2.contourArea(border) / 4 for border in borders]
    kept = [len(ring) >= 3 and size >= least_pixels for ring, size in zip(rings, sizes, strict=True)]
    return [
        _with_holes(ring, [rings[inner] for inner in range(len(rings)) if kept[inner] and tree[0][inner][3] == outer])
        for outer, ring in enumerate(rings)
        if kept[outer] and tree[0][outer][3] < 0
    ]


def _corner_grid(mask: Mask) -> NDArray[np.uint8]:
    """(2h + 1, 2w + 1): pixels at odd places grown by one, so that the outermost places are pixels' corners, at even
    ones."""
    grid = np.zeros((2 * mask.shape[0] + 1, 2 * mask.shape[1] + 1), np.uint8)
    grid[1::2, 1::2] = mask
    return np.asarray(cv2.dilate(grid, np.ones((3, 3), np.uint8)), np.uint8)


def _with_holes(ring: Polygon, holes: list[Polygon]) -> Polygon:
    """One ring that goes round the outline and, from its nearest corner, round each hole and back."""
    for hole in holes:
        distances = np.linalg.norm(ring[:, None] - hole[None], axis=2)
        here, start = np.unravel_index(int(distances.argmin()), distances.shape)
        round_hole = np.roll(hole, -int(start), axis=0)
        ring = np.concatenate([ring[: here + 1], round_hole, round_hole[:1], ring[here:]])
    return ring


def filled(polygon: Polygon, height: int, width: int) -> Mask:
    """The pixels (height, width) whose centres a polygon holds, by the even-odd rule; parts outside the picture are cut
    off."""
    flips = np.zeros((height, width + 1), np.uint8)
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        low, high = min(y0, y1), max(y0, y1)
        rows = np.arange(max(0, int(np.ceil(low - 0.5))), min(height, int(np.ceil(high - 0.5))))
        if len(rows):
            crossings = x0 + (rows + 0.5 - y0) * (x1 - x0) / (y1 - y0)
            flips[rows, np.clip(np.ceil(crossings - 0.5), 0, width).astype(np.int64)] ^= 1
    inside: Mask = np.bitwise_xor.accumulate(flips, axis=1)[:, :width].astype(np.bool_)
    return inside


def area(polygon: Polygon) -> float:
    """Pixels inside a polygon (shoelace formula; holes are cut in the other direction)."""
    x, y = polygon.T
    return float(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2)
