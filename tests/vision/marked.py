"""Panoramas with a marker painted in by intersecting rays with its plane, sixteen to a pixel, then blurred and made noisy."""

import cv2
import numpy as np

from savmap.geometry import sphere
from savmap.types import Panorama

SPAN = 10
"""Modules across a marker with its white border; 8 within the black square."""


def pattern(dictionary: int, number: int) -> np.ndarray:
    """Modules (10, 10) of a marker with 6 x 6 bits, 0 and 255, with a white border."""
    known = cv2.aruco.getPredefinedDictionary(dictionary)
    return np.pad(cv2.aruco.generateImageMarker(known, number, SPAN - 2), 1, constant_values=255)


def marked(
    frame: int, height: int, corners: np.ndarray, modules: np.ndarray, rng: np.random.Generator, blur_px: float = 0.7
) -> Panorama:
    """A grey panorama with a marker whose corners (4, 3), clockwise from its upper left one, are given in the rig frame."""
    image = np.full((height, 2 * height, 3), 120, np.uint8)
    pixels = sphere.panorama_pixels_from_rays(corners, height)
    pixels[:, 0] = pixels[0, 0] + (pixels[:, 0] - pixels[0, 0] + height) % (2 * height) - height
    reach = 0.4 * np.ptp(pixels, axis=0).max() + 4
    low, high = (pixels.min(axis=0) - reach).astype(int), (pixels.max(axis=0) + reach).astype(int)
    fine = (np.arange(4) + 0.5) / 4 - 0.5
    columns, rows = (np.add.outer(np.arange(low[k], high[k]), fine).ravel() for k in (0, 1))
    rays = sphere.rays_from_panorama_pixels(np.stack(np.meshgrid(columns, rows), axis=-1), height)
    grey = _painted(rays, corners, modules).reshape(high[1] - low[1], 4, high[0] - low[0], 4).mean(axis=(1, 3))
    grey = cv2.GaussianBlur(grey, (0, 0), blur_px) + rng.normal(0, 2, grey.shape)
    wrapped = np.arange(low[0], high[0]) % (2 * height)
    image[low[1] : high[1], wrapped] = np.clip(grey, 0, 255).round().astype(np.uint8)[..., None]
    return Panorama(frame, frame / 15, image)


def _painted(rays: np.ndarray, corners: np.ndarray, modules: np.ndarray) -> np.ndarray:
    origin, right, down = corners[0], corners[1] - corners[0], corners[3] - corners[0]
    normal = np.cross(right, down)
    distance = (origin @ normal) / (rays @ normal)
    points = rays * distance[..., None] - origin
    inner = SPAN - 2
    column, row = (np.floor(inner * (points @ side) / (side @ side) + 1).astype(int) for side in (right, down))
    on = (distance > 0) & (np.minimum(column, row) >= 0) & (np.maximum(column, row) < SPAN)
    grey = np.full(rays.shape[:2], 120.0)
    grey[on] = 15 + 0.85 * modules[row[on], column[on]]
    return grey
