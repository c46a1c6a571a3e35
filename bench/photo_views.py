"""Ways of showing a photograph to a network that takes views of 640x480: whole, in tiles, at several scales."""

from collections.abc import Callable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.lab.train.data.dataset import HEIGHT, WIDTH

Bytes = NDArray[np.uint8]
Maps = NDArray[np.float32]
Predict = Callable[[Bytes], Maps]
"""Picture (480, 640, 3) RGB -> probabilities (1 + classes, 480, 640), background first."""

THICKNESS_PX = 10.0
"""How thick the median front member is in `tiles`."""
STEPS = (1.0, 1.6, 2.56)
"""The three scales of `scales`, in multiples of the one at which the whole photograph fits into a view."""
OVERLAP = 0.25
GREY = 127


def letterboxed(predict: Predict, image: Bytes, thickness_px: float) -> Maps:
    """Probabilities (1 + classes, H, W) of a photograph (H, W, 3) shown as a whole; its members' thickness is not used."""
    return at_scale(predict, image, fitting(image))


def tiles(predict: Predict, image: Bytes, thickness_px: float) -> Maps:
    """The same, of tiles in which the median front member is 10 px thick."""
    return at_scale(predict, image, THICKNESS_PX / thickness_px)


def scales(predict: Predict, image: Bytes, thickness_px: float) -> Maps:
    """The same, the mean over three scales: whole, and in tiles at 1.6 and 2.56 times that scale; members' thickness is not used."""
    shown = [at_scale(predict, image, step * fitting(image)) for step in STEPS]
    return np.asarray(np.mean(shown, axis=0), np.float32)


WAYS: dict[str, Callable[[Predict, Bytes, float], Maps]] = {
    "letterboxed": letterboxed,
    "tiles": tiles,
    "scales": scales,
}


def fitting(image: Bytes) -> float:
    """The scale at which a whole photograph fits into a view."""
    height, width = image.shape[:2]
    return float(min(WIDTH / width, HEIGHT / height))


def at_scale(predict: Predict, image: Bytes, scale: float) -> Maps:
    """Probabilities of a photograph that is scaled, shown in overlapping tiles, and read at its own resolution. A photograph smaller than
    a tile lies in the middle of a grey one."""
    height, width = image.shape[:2]
    size = max(1, round(width * scale)), max(1, round(height * scale))
    canvas = np.full((max(HEIGHT, size[1]), max(WIDTH, size[0]), 3), GREY, np.uint8)
    left, top = (canvas.shape[1] - size[0]) // 2, (canvas.shape[0] - size[1]) // 2
    inner = slice(top, top + size[1]), slice(left, left + size[0])
    canvas[inner] = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    how = cv2.INTER_AREA if scale > 1 else cv2.INTER_LINEAR
    planes = [cv2.resize(plane[inner], (width, height), interpolation=how) for plane in blended(predict, canvas)]
    return np.stack(planes).astype(np.float32)


def blended(predict: Predict, canvas: Bytes) -> Maps:
    """Probabilities of a picture at least as large as a tile: the mean of its tiles', weighted less towards their edges."""
    weight = np.minimum.outer(_ramp(HEIGHT), _ramp(WIDTH)).astype(np.float32)
    total = np.zeros(canvas.shape[:2], np.float32)
    sums: Maps | None = None
    for top in starts(canvas.shape[0], HEIGHT):
        for left in starts(canvas.shape[1], WIDTH):
            place = slice(top, top + HEIGHT), slice(left, left + WIDTH)
            maps = predict(np.ascontiguousarray(canvas[place]))
            sums = np.zeros((len(maps), *total.shape), np.float32) if sums is None else sums
            sums[:, *place] += weight * maps
            total[place] += weight
    assert sums is not None
    return np.asarray(sums / total, np.float32)


def starts(length: int, tile: int) -> Iterator[int]:
    """Where tiles begin that cover a length, evenly, and overlap by at least a quarter."""
    count = 1 + int(np.ceil((length - tile) / ((1 - OVERLAP) * tile)))
    yield from np.linspace(0, length - tile, count).round().astype(int).tolist()


def _ramp(length: int) -> NDArray[np.float64]:
    """Weights (length,) that rise to 1 over the overlap from both ends."""
    place = np.arange(length) + 0.5
    weights: NDArray[np.float64] = np.minimum(1.0, np.minimum(place, length - place) / (OVERLAP * length))
    return weights
