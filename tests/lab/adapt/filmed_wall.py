"""A made-up wall with two posts and a plank between them, and a camera before it."""

import numpy as np

from savmap.types import Floats, Structure, View, ViewSpec
from savmap.vision.evidence import PackedView
from savmap.vision.networks.adapter import Segmentation

CLASSES = ("post", "plank")
SPEC = ViewSpec("pass 1 / face", 0.0, hfov_deg=90.0, width=320, height=240)
BOXES = {"post 1": (-1.0, -0.9, 0.0, 1.5), "post 2": (0.9, 1.0, 0.0, 1.5), "plank 1": (-0.9, 0.9, 1.0, 1.1)}
RING = np.array([[0, 1], [1, 3], [3, 2], [2, 0]])


def quad(name: str, sigma_m: float = 0.001, z: float = 0.0) -> Structure:
    """A structure of BOXES: its corners from the bottom up, left then right."""
    left, right, low, high = BOXES[name]
    corners = np.array([[x, y, z] for y in (low, high) for x in (left, right)])
    covariances = np.repeat(sigma_m**2 * np.eye(3)[None], 4, axis=0)
    return Structure(name, name.split()[0], corners, covariances, ("a", "b", "c", "d"), RING)


def pose(x: float = 0.0, away: float = 1.5) -> Floats:
    """world_from_rig (4, 4) of a camera that looks straight at the wall."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = x, 0.75, away
    return pose


def pixel(x: float, y: float) -> tuple[int, int]:
    """Row and column of a point of the wall in the view of `pose()`."""
    focal = SPEC.camera[0, 0]
    return round(119.5 - focal * (y - 0.75) / 1.5), round(159.5 + focal * x / 1.5)


def packed_view(post: float = 0.8, plank: float = 0.8, grey: int = 120) -> PackedView:
    """A look that gives the same everywhere."""
    shape = (SPEC.height, SPEC.width)
    maps = np.stack([np.full(shape, value, np.float32) for value in (1 - post, post, plank)])
    noise = np.random.default_rng(0).integers(-3, 4, (*shape, 3))
    image = np.clip(grey + noise, 0, 255).astype(np.uint8)
    image[:, : SPEC.width // 4] //= 2
    return PackedView.of(View(SPEC, 0, 0.0, image), Segmentation(CLASSES, maps))
