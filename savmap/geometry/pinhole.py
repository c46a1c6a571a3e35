"""Rectilinear views: rotation from angles, intrinsics, projection.

View frame: x right, y down, z along the optical axis. Pixel centres are at integer coordinates, so the principal point
of a (height, width) view is ((width - 1) / 2, (height - 1) / 2).
"""

import numpy as np

from savmap.geometry.arrays import Floats


def rig_from_view(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Floats:
    """Rotation (3, 3): yaw turns the view to the right, then pitch raises it, then roll turns it clockwise."""
    yaw, pitch, roll = np.radians([yaw_deg, pitch_deg, roll_deg])
    about_y = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    about_z = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    rotation: Floats = about_y @ about_x @ about_z
    return rotation


def angles_from_rotation(rotation: Floats) -> tuple[float, float, float]:
    """Yaw, pitch and roll in degrees, to a billionth, so that processors agree on a view's pixels: the inverse of
    `rig_from_view`. At pitch +-90 the roll is 0, and the yaw includes it."""
    forward = rotation[:, 2]
    pitch = np.arcsin(np.clip(-forward[1], -1, 1))
    if np.hypot(forward[0], forward[2]) < 1e-9:
        right = rotation[:, 0]
        return _rounded(np.arctan2(-right[2], right[0]), pitch, 0.0)
    yaw = np.arctan2(forward[0], forward[2])
    level = rig_from_view(float(np.degrees(yaw)), float(np.degrees(pitch)), 0.0)
    about_z = level.T @ rotation
    return _rounded(yaw, pitch, np.arctan2(about_z[1, 0], about_z[0, 0]))


def _rounded(*angles_rad: float) -> tuple[float, float, float]:
    yaw, pitch, roll = np.degrees(angles_rad).round(9).tolist()
    return yaw, pitch, roll


def focal_px(hfov_deg: float, width: int) -> float:
    """Focal length in pixels of a view `width` pixels wide: its outer pixel borders are `hfov_deg` apart."""
    return float(width / 2 / np.tan(np.radians(hfov_deg) / 2))


def intrinsics(hfov_deg: float, width: int, height: int) -> Floats:
    """Calibration matrix K (3, 3)."""
    focal = focal_px(hfov_deg, width)
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


def rays_from_pixels(pixels: Floats, camera: Floats) -> Floats:
    """Unit rays (..., 3) in the view frame through pixels (..., 2), for the calibration matrix `camera`."""
    normalised = np.stack(
        [
            (pixels[..., 0] - camera[0, 2]) / camera[0, 0],
            (pixels[..., 1] - camera[1, 2]) / camera[1, 1],
            np.ones(pixels.shape[:-1]),
        ],
        axis=-1,
    )
    unit: Floats = normalised / np.linalg.norm(normalised, axis=-1, keepdims=True)
    return unit


def project(points: Floats, camera: Floats) -> Floats:
    """Pixels (..., 2) of points (..., 3) in the view frame; nan where a point is not in front of the view."""
    depth = np.where(points[..., 2] > 1e-9, points[..., 2], np.nan)
    return np.stack(
        [
            camera[0, 0] * points[..., 0] / depth + camera[0, 2],
            camera[1, 1] * points[..., 1] / depth + camera[1, 2],
        ],
        axis=-1,
    )
