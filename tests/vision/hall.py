"""A plain hall drawn by intersecting rays with its six walls: one of them a red grid, lamps overhead."""

import numpy as np

from savmap.geometry import sphere
from savmap.types import Panorama

TOP = 5.0
EYE_HEIGHT = 3.0
EYE_DISTANCE = 1.5
HEIGHT = 384
WALLS = (("y", 0.0), ("y", 7.0), ("z", 0.0), ("z", 3.2), ("x", -4.0), ("x", 16.0))
AXIS = {"x": 0, "y": 1, "z": 2}


def hall(x: float, rig_from_world: np.ndarray, frame: int = 0, height: int = HEIGHT) -> Panorama:
    """Panorama from (x, EYE_HEIGHT, EYE_DISTANCE); the grid is the wall z = 0, up to TOP, for x in 0..12."""
    grid = np.stack(np.meshgrid(np.arange(2.0 * height), np.arange(float(height))), axis=-1)
    rays = (sphere.rays_from_panorama_pixels(grid, height) @ rig_from_world).astype(np.float32)
    eye = np.array([x, EYE_HEIGHT, EYE_DISTANCE], np.float32)
    image = np.zeros((height, 2 * height, 3), np.uint8)
    nearest = np.full((height, 2 * height), np.inf, np.float32)
    for name, at in WALLS:
        axis = AXIS[name]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (at - eye[axis]) / rays[..., axis]
        seen = (distance > 0) & (distance < nearest)
        nearest[seen] = distance[seen]
        image[seen] = _paint(name, at, eye + rays[seen] * distance[seen, None])
    return Panorama(frame, frame / 15, image)


def _paint(name: str, at: float, points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    if name == "z" and at == 0.0:
        return _face(x, y)
    if name == "y" and at > 0:
        lamp = (np.abs(z - 1.5) < 0.1) & (x % 2.5 < 1.2)
        return np.where(lamp[:, None], 255, _tiles(x, z, 60)).astype(np.uint8)
    across = {"x": (y, z), "y": (x, z), "z": (x, y)}[name]
    return _tiles(*across, 150 if name == "y" else 110)


def _face(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    inside = (y < TOP) & (x > 0) & (x < 12.12)
    grid = inside & ((x % 2.0 < 0.12) | ((TOP - y) % 1.1 < 0.14))
    goods = 40 + 30 * ((np.floor(x * 2.3) * 7 + np.floor(y * 3.1) * 3) % 4)
    colours = np.where(inside[:, None], np.stack([goods * 0.6, goods, goods], axis=-1), _tiles(x, y, 90))
    return np.where(grid[:, None], [220, 30, 30], colours).astype(np.uint8)


def _tiles(a: np.ndarray, b: np.ndarray, grey: int) -> np.ndarray:
    joint = (a % 1.3 < 0.05) | (b % 0.9 < 0.05)
    shade = grey + 8 * ((np.floor(a / 1.3) + 3 * np.floor(b / 0.9)) % 3) - 40 * joint
    return np.repeat(shade[:, None], 3, axis=1).astype(np.uint8)


def red(image: np.ndarray) -> np.ndarray:
    """Mask (h, w) of the grid's pixels."""
    channels = image.astype(int)
    return (channels[..., 0] > 120) & (channels[..., 1] < 90)
