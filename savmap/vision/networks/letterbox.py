"""Pictures fitted into a network's input, and the place of the network's coarse masks in the picture."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.vision.networks.adapter import Probabilities

GREY = 114
WHITE = np.float32(255)


@dataclass(frozen=True)
class Fit:
    """A picture of `width` x `height` pixels in an input of `size` (w, h): scaled by `across` and `down`, its upper
    left corner at (left, top) of the input. Pixel centres are at integer coordinates."""

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
        """Boxes (n, 4) of the input (x0, y0, x1, y1 between pixels' borders), grown by `margin` of its pixels, as the
        picture's first and last + 1 columns and rows (n, 4)."""
        corner = np.array([self.left, self.top])
        scale = np.array([self.across, self.down])
        first = np.floor((boxes[:, :2] - margin - corner) / scale)
        last = np.ceil((boxes[:, 2:] + margin - corner) / scale)
        limits = np.array([self.width, self.height])
        return np.hstack([np.clip(first, 0, limits), np.clip(last, 0, limits)]).astype(np.int64)


def letterboxed(image: NDArray[np.uint8], size: tuple[int, int]) -> tuple[NDArray[np.uint8], Fit]:
    """A picture (H, W, 3) scaled to fit into `size` (w, h), in the middle of a grey canvas, as ultralytics' LetterBox
    does."""
    height, width = image.shape[:2]
    ratio = min(size[0] / width, size[1] / height)
    inner = round(width * ratio), round(height * ratio)
    left, top = (round((size[axis] - inner[axis]) / 2 - 0.1) for axis in (0, 1))
    canvas = np.full((size[1], size[0], 3), GREY, np.uint8)
    canvas[top : top + inner[1], left : left + inner[0]] = _resized(image, inner)
    return canvas, Fit(width, height, size, inner[0] / width, inner[1] / height, left, top)


def stretched(image: NDArray[np.uint8], size: tuple[int, int]) -> tuple[NDArray[np.uint8], Fit]:
    """A picture (H, W, 3) scaled to `size` (w, h), its aspect ratio not kept."""
    height, width = image.shape[:2]
    return _resized(image, size), Fit(width, height, size, size[0] / width, size[1] / height)


def planes(picture: NDArray[np.uint8]) -> Probabilities:
    """(H, W, 3) uint8 -> (1, 3, H, W) float32 in 0..255 (`WHITE`)."""
    return np.stack(cv2.split(picture)).astype(np.float32)[None]


def _resized(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    if (image.shape[1], image.shape[0]) == size:
        return image
    interpolation = cv2.INTER_AREA if image.shape[1] > size[0] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=interpolation), np.uint8)
