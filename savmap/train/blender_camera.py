"""What a camera does to a picture after the light: coarser pixels, vignetting, colour cast, noise, compression."""

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.train.blender_looks import Lens, Rng

Image = NDArray[np.uint8]


def _shade(width: int, height: int, strength: float) -> NDArray[np.float64]:
    u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    shade: NDArray[np.float64] = 1 - strength * (u**2 + v**2) / 2
    return shade[..., None]


def _grain(shape: tuple[int, int], strength: float, rng: Rng) -> NDArray[np.float64]:
    """Noise in 0..255 units, partly the same in all channels, partly two pixels wide as after demosaicing."""
    fine = rng.normal(0, 1, (*shape, 3))
    coarse = cv2.resize(rng.normal(0, 1, ((shape[0] + 1) // 2, (shape[1] + 1) // 2, 3)), shape[::-1])
    grain: NDArray[np.float64] = 14 * strength * (0.5 * fine + 0.5 * coarse + 0.5 * fine[..., :1])
    return grain


def _compressed(picture: Image, quality: int) -> Image:
    if not quality:
        return picture
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)


def develop(picture: Image, lens: Lens, size: tuple[int, int], rng: Rng) -> Image:
    """The picture as the camera delivers it, at `size` (width, height); pixel centres keep their directions."""
    width, height = size
    full = cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC).astype(np.float64)
    full = full * _shade(width, height, lens.vignette) * np.array(lens.tint)
    full += _grain((height, width), lens.noise, rng)
    return _compressed(np.clip(np.round(full), 0, 255).astype(np.uint8), lens.quality)
