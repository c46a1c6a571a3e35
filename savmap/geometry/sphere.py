"""Equirectangular panoramas: pixels to rays and back.

Rig frame: x right, y down, z towards the panorama's centre column. Pixel centres are at integer coordinates, so the
panorama spans [-0.5, W - 0.5) x [-0.5, H - 0.5).
"""

import numpy as np

from savmap.geometry.arrays import Floats


def rays_from_panorama_pixels(pixels: Floats, height: int) -> Floats:
    """Unit rays (..., 3) in the rig frame through panorama pixels (..., 2) of a (height, 2 height) image."""
    longitude = (pixels[..., 0] + 0.5) * np.pi / height - np.pi
    latitude = np.pi / 2 - (pixels[..., 1] + 0.5) * np.pi / height
    cos_lat = np.cos(latitude)
    return np.stack([cos_lat * np.sin(longitude), -np.sin(latitude), cos_lat * np.cos(longitude)], axis=-1)


def panorama_pixels_from_rays(rays: Floats, height: int) -> Floats:
    """Panorama pixels (..., 2) of rays (..., 3) in the rig frame, of any length but zero."""
    longitude = np.arctan2(rays[..., 0], rays[..., 2])
    latitude = np.arctan2(-rays[..., 1], np.hypot(rays[..., 0], rays[..., 2]))
    u = (longitude + np.pi) * height / np.pi - 0.5
    v = (np.pi / 2 - latitude) * height / np.pi - 0.5
    return np.stack([u, v], axis=-1)
