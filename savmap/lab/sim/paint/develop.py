"""A photograph of linear light: exposure, glare, lens, sensor and compression."""

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.lab.sim.paint.faces import Singles
from savmap.lab.sim.paint.noise import Random


def developed(linear: Singles, rng: Random, key: float | None = None) -> NDArray[np.uint8]:
    """An 8-bit RGB picture (h, w, 3). `key`: the mean brightness aimed at, 0 to 1 before the tone curve; random by
    default."""
    picture = np.nan_to_num(linear)
    aimed = _key(rng) if key is None else key
    picture = picture * (aimed / max(float(picture.mean()), 1e-4))
    picture = _glare(picture, rng) * _vignette(picture.shape, rng)
    picture = picture * np.exp(rng.normal(0, 0.09, 3)).astype(np.float32)
    return _compressed(_sensed(_lens(_toned(picture, rng), rng), rng), rng)


def _key(rng: Random) -> float:
    """Mean brightness in linear light: most pictures well exposed, one in six taken in the dark."""
    if rng.random() < 0.17:
        return float(np.exp(rng.uniform(np.log(0.012), np.log(0.08))))
    return float(np.clip(np.exp(rng.normal(np.log(0.18), 0.55)), 0.03, 0.7))


def _toned(picture: Singles, rng: Random) -> Singles:
    """The tone curve: roots of light, a shoulder, contrast and saturation."""
    shoulder = float(rng.uniform(0.4, 1.2))
    light = np.clip(picture, 0, None)
    light = light * (1 + shoulder * light) / (1 + (0.6 + shoulder) * light) * 1.25
    tone = np.power(np.clip(light, 0, 1), np.float32(1 / rng.uniform(1.8, 2.4)))
    grey = tone.mean(axis=2, keepdims=True)
    tone = grey + np.float32(rng.uniform(0.45, 1.35)) * (tone - grey)
    lifted = np.float32(rng.uniform(0, 0.12) * (rng.random() < 0.5))
    contrast, middle = np.float32(rng.uniform(0.75, 1.25)), tone.mean()
    result: Singles = lifted + (1 - lifted) * (middle + contrast * (tone - middle))
    return result


def _glare(picture: Singles, rng: Random) -> Singles:
    """Light that bleeds around what is bright."""
    if rng.random() < 0.5:
        return picture
    small = cv2.resize(np.clip(picture - 0.8, 0, 6), (80, 60), interpolation=cv2.INTER_AREA)
    halo = cv2.GaussianBlur(small, (0, 0), float(rng.uniform(1, 9)))
    large = cv2.resize(halo, (picture.shape[1], picture.shape[0]), interpolation=cv2.INTER_LINEAR)
    result: Singles = picture + np.float32(rng.uniform(0.1, 0.9)) * large
    return result


def _vignette(shape: tuple[int, ...], rng: Random) -> Singles:
    y = np.linspace(-1, 1, shape[0], dtype=np.float32)[:, None]
    x = np.linspace(-1, 1, shape[1], dtype=np.float32)
    shade = 1 - np.float32(rng.uniform(0, 0.35)) * (x**2 + y**2) / 2
    tilt = 1 + np.float32(rng.normal(0, 0.15)) * x + np.float32(rng.normal(0, 0.12)) * y
    result: Singles = (shade * np.clip(tilt, 0.4, 1.6))[..., None]
    return result


def _lens(picture: Singles, rng: Random) -> Singles:
    """Defocus, motion, a coarser original, sharpening: each by chance."""
    if rng.random() < 0.35:
        height, width = picture.shape[:2]
        coarse = rng.uniform(1.1, 2.2)
        small = cv2.resize(picture, (int(width / coarse), int(height / coarse)), interpolation=cv2.INTER_AREA)
        picture = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR).astype(np.float32)
    picture = cv2.GaussianBlur(picture, (0, 0), float(rng.uniform(0.2, 1.0))).astype(np.float32)
    if rng.random() < 0.12:
        picture = cv2.filter2D(picture, -1, _motion(rng)).astype(np.float32)
    if rng.random() < 0.4:
        soft = cv2.GaussianBlur(picture, (0, 0), 1.2)
        picture = picture + np.float32(rng.uniform(0.2, 1.2)) * (picture - soft)
    return picture


def _motion(rng: Random) -> Singles:
    size = 2 * int(rng.integers(1, 5)) + 1
    kernel = np.zeros((size, size), np.float32)
    angle = rng.normal(0, 0.4)
    reach = size // 2 * np.array([np.cos(angle), np.sin(angle)])
    middle = np.array([size // 2, size // 2])
    cv2.line(kernel, np.round(middle - reach).astype(int).tolist(), np.round(middle + reach).astype(int).tolist(), 1.0)
    blur: Singles = kernel / kernel.sum()
    return blur


def _sensed(picture: Singles, rng: Random) -> Singles:
    """Sensor noise, at times in coarse grains."""
    strength = float(np.clip(rng.exponential(0.012), 0.001, 0.07))
    height, width = picture.shape[:2]
    noise = rng.standard_normal((height, width), np.float32)[..., None] * np.float32(0.8)
    noise = noise + 0.5 * rng.standard_normal((height // 2, width // 2, 3), np.float32).repeat(2, 0).repeat(2, 1)
    result: Singles = picture + np.float32(strength) * noise
    return result


def _compressed(picture: Singles, rng: Random) -> NDArray[np.uint8]:
    """8 bits, and at times the traces of an earlier JPEG or WebP."""
    rgb = np.asarray(np.clip(picture, 0, 1) * 255 + 0.5, np.uint8)
    if rng.random() < 0.5:
        return rgb
    data = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(35, 92))])[1]
    return np.ascontiguousarray(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)[..., ::-1])
