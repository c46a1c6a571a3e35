"""Equirectangular panoramas: pixels to rays and back.

Rig frame: x right, y down, z towards the panorama's centre column. Pixel centres are at integer coordinates, so the
panorama spans [-0.5, W - 0.5) x [-0.5, H - 0.5).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from savmap.geometry.arrays import Floats


def rays_from_panorama_pixels(pixels: Floats, height: int) -> Floats:
    """Unit rays (..., 3) in the rig frame through panorama pixels (..., 2) of a (height, 2 height) image."""
    longitude = (pixels[..., 0] + 0.5) * np.pi / height - np.pi
    latitude = np.pi / 2 - (pixels[..., 1] + 0.5) * np.pi / height
    cos_lat = np.cos(latitude)
    return np.stack([cos_lat * np.sin(longitude), -np.sin(latitude), cos_lat * np.cos(longitude)], axis=-1)


def panorama_pixels_from_rays(rays: Floats, height: int) -> Floats:
    """Panorama pixels (..., 2) of rays (..., 3) in the rig frame, of any length but zero."""
    return np.stack(columns_and_rows(rays[..., 0], rays[..., 1], rays[..., 2], height), axis=-1)


def columns_and_rows(
    x: NDArray[Any], y: NDArray[Any], z: NDArray[Any], height: int
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Panorama columns (...) and rows (...) of rays with these coordinates (...) in the rig frame."""
    longitude = np.arctan2(x, z)
    latitude = np.arctan2(-y, np.hypot(x, z))
    return (longitude + np.pi) * height / np.pi - 0.5, (np.pi / 2 - latitude) * height / np.pi - 0.5
