"""Pictures fitted into a network's input, and where its coarse masks lie in the picture."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.vision.networks.adapter import Probabilities

GREY = 114
WHITE = np.float32(255)


@dataclass(frozen=True)
class Fit:
    """A picture of `width` x `height` pixels in an input of `size` (w, h): enlarged `across` and `down` times, its upper left
    corner at (left, top) of the input. Pixel centres are at integer coordinates."""

    width: int
    height: int
    size: tuple[int, int]
    across: float
    down: float
    left: int = 0
    top: int = 0

    def on_grid(self, columns: int, rows: int) -> tuple[tuple[float, float], tuple[float, float]]:
        """For a grid of masks over the input: scale and offset that take the picture's u to the grid's, and its v."""
        u, v = columns / self.size[0], rows / self.size[1]
        return (
            (self.across * u, (self.across / 2 + self.left) * u - 0.5),
            (self.down * v, (self.down / 2 + self.top) * v - 0.5),
        )

    def window(self, boxes: NDArray[np.float64], margin: float) -> NDArray[np.int64]:
        """Boxes (n, 4) of the input (x0, y0, x1, y1 between pixels' borders), grown by `margin` of its pixels, as the picture's first and
        last + 1 columns and rows (n, 4)."""
        corner = np.array([self.left, self.top])
        scale = np.array([self.across, self.down])
        first = np.floor((boxes[:, :2] - margin - corner) / scale)
        last = np.ceil((boxes[:, 2:] + margin - corner) / scale)
        limits = np.array([self.width, self.height])
        return np.hstack([np.clip(first, 0, limits), np.clip(last, 0, limits)]).astype(np.int64)


def letterboxed(image: NDArray[np.uint8], size: tuple[int, int]) -> tuple[NDArray[np.uint8], Fit]:
    """A picture (H, W, 3) as large as it fits into `size` (w, h), in the middle of grey, as ultralytics' LetterBox places it."""
    height, width = image.shape[:2]
    ratio = min(size[0] / width, size[1] / height)
    inner = round(width * ratio), round(height * ratio)
    left, top = (round((size[axis] - inner[axis]) / 2 - 0.1) for axis in (0, 1))
    canvas = np.full((size[1], size[0], 3), GREY, np.uint8)
    canvas[top : top + inner[1], left : left + inner[0]] = _resized(image, inner)
    return canvas, Fit(width, height, size, inner[0] / width, inner[1] / height, left, top)


def stretched(image: NDArray[np.uint8], size: tuple[int, int]) -> tuple[NDArray[np.uint8], Fit]:
    """A picture (H, W, 3) drawn to `size` (w, h), whatever its shape was."""
    height, width = image.shape[:2]
    return _resized(image, size), Fit(width, height, size, size[0] / width, size[1] / height)


def planes(picture: NDArray[np.uint8]) -> Probabilities:
    """(H, W, 3) uint8 -> (1, 3, H, W) float32 in 0..255 (`WHITE`)."""
    return np.stack(cv2.split(picture)).astype(np.float32)[None]


def sampled(mask: Probabilities, fit: Fit, window: NDArray[np.int64]) -> Probabilities:
    """A mask (rows, columns) over the network's input, at the picture's pixels in a window (4,), interpolated linearly."""
    (across, right), (down, below) = fit.on_grid(mask.shape[1], mask.shape[0])
    columns = np.arange(window[0], window[2]) * across + right
    rows = np.arange(window[1], window[3]) * down + below
    between: Probabilities = _between(_between(mask, rows).T, columns).T
    return between


def _between(mask: Probabilities, at: NDArray[np.float64]) -> Probabilities:
    """Rows of a mask at fractional numbers `at`; beyond the first and last one these go on."""
    inside = np.clip(at, 0, len(mask) - 1)
    lower = np.minimum(inside.astype(np.int64), max(len(mask) - 2, 0))
    weight = (inside - lower).astype(np.float32)[:, None]
    upper = np.minimum(lower + 1, len(mask) - 1)
    between: Probabilities = mask[lower] * (1 - weight) + mask[upper] * weight
    return between


def _resized(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    if (image.shape[1], image.shape[0]) == size:
        return image
    how = cv2.INTER_AREA if image.shape[1] > size[0] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=how), np.uint8)
