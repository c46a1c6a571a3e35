"""Panoramas with a plate drawn into them, exactly where its corners say."""

import cv2
import numpy as np

from savmap.geometry.sphere import rays_from_panorama_pixels
from savmap.types import Floats, Panorama
from savmap_signs.lab.artwork import Code, artwork

GROUND = 90.0


def plate(middle: tuple[float, float, float], size: tuple[float, float], turn_deg: float = 0.0) -> Floats:
    """Corners (4, 3) m of a plate in the rig's frame (x right, y down, z forward), turned about the vertical."""
    turn = np.radians(turn_deg)
    right = np.array([np.cos(turn), 0.0, np.sin(turn)])
    offsets = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * size
    return np.array(middle) + offsets[:, :1] * right + offsets[:, 1:] * np.array([0.0, 1.0, 0.0])


def panorama_of(corners: Floats, text: str, height: int, code: Code = "none") -> Panorama:
    """A grey place with the plate of these corners (4, 3) m in it, 3 x 3 rays a pixel; only what is before the rig is drawn."""
    size = float(np.linalg.norm(corners[1] - corners[0])), float(np.linalg.norm(corners[3] - corners[0]))
    printed = artwork(text, size, (225, 225, 225), (15, 15, 15), "DejaVuSans-Bold", False, code, text)[..., 0]
    image = np.full((height, 2 * height), GROUND)
    v, u = np.mgrid[height // 4 : 3 * height // 4, 3 * height // 4 : 5 * height // 4].astype(np.float64)
    shifts = np.array([-1, 0, 1]) / 3
    seen = [_seen(printed, corners, np.stack([u + du, v + dv], axis=-1), height) for du in shifts for dv in shifts]
    image[height // 4 : 3 * height // 4, 3 * height // 4 : 5 * height // 4] = np.mean(seen, axis=0)
    return Panorama(4, 0.1, np.repeat(np.round(image).astype(np.uint8)[..., None], 3, axis=2))


def _seen(printed: np.ndarray, corners: Floats, pixels: Floats, height: int) -> Floats:
    rays = rays_from_panorama_pixels(pixels, height)
    right, down = corners[1] - corners[0], corners[3] - corners[0]
    system = np.column_stack([right, down, corners[0]])
    shares = rays @ np.linalg.inv(system).T
    across, along = shares[..., 0] / shares[..., 2], shares[..., 1] / shares[..., 2]
    soft = cv2.GaussianBlur(printed, (0, 0), 2.0)
    columns = (across * printed.shape[1] - 0.5).astype(np.float32)
    rows = (along * printed.shape[0] - 0.5).astype(np.float32)
    color = cv2.remap(soft, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
    inside = (shares[..., 2] > 0) & (np.abs(across - 0.5) < 0.5) & (np.abs(along - 0.5) < 0.5)
    return np.where(inside, color, GROUND)
