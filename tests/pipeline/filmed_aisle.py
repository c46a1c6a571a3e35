"""Panoramas of a drive along an aisle with blots of any grey on its walls, its floor and its ceiling."""

from functools import cache

import cv2
import numpy as np

from savmap.geometry import sphere
from savmap.types import Floats, Panorama

BLOT = 0.1
"""The side of a blot, as a share of the camera's distance from its plane: all look alike."""
SIDES_M, EYE_M, TOP_M = (1.5, 1.0), 1.6, 4.0
"""How far the walls z = 0 and beyond lie from the camera, and its height."""
LEVEL = np.diag([1.0, -1.0, -1.0])
"""world_from_rig: the camera looks at the wall z = 0."""


def aisle(x: float, frame: int, height: int = 256) -> Panorama:
    """What is seen from (x, EYE_M, SIDES_M[0]), at 15 frames a second."""
    eye = np.array([x, EYE_M, SIDES_M[0]], np.float32)
    planes = [(2, 0.0), (2, sum(SIDES_M)), (1, 0.0), (1, TOP_M)]
    rays = _rays(height)
    with np.errstate(divide="ignore"):
        reaches = np.stack([(at - eye[axis]) / rays[..., axis] for axis, at in planes])
    reaches[reaches <= 0] = np.inf
    nearest, reach = reaches.argmin(axis=0), np.minimum(reaches.min(axis=0), 1e3)
    places = eye + rays * reach[..., None]
    blot = BLOT * np.array([abs(at - eye[axis]) for axis, at in planes], np.float32)[nearest]
    along, across = places[..., 0] / blot, np.where(nearest < 2, places[..., 1], places[..., 2]) / blot
    row = across % 48 + 4 + 56 * nearest.astype(np.float32)
    grey = cv2.remap(_blots(), along % 192 + 4, row, cv2.INTER_CUBIC)
    return Panorama(frame, frame / 15, np.repeat(grey[..., None], 3, axis=2))


@cache
def _rays(height: int) -> Floats:
    pixels = np.stack(np.meshgrid(np.arange(2.0 * height), np.arange(float(height))), axis=-1)
    return np.asarray((sphere.rays_from_panorama_pixels(pixels, height) @ LEVEL.T).astype(np.float32))


@cache
def _blots() -> Floats:
    return np.random.default_rng(1).integers(20, 236, (4 * 56, 200)).astype(np.uint8)
