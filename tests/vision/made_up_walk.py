"""A made-up walk with an ordinary lens along a face: points of it and behind it, posts and beams."""

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.geometry.cameras import Pinhole
from savmap.types import Floats
from savmap.vision.lens_tracks import WIDTH, LensTracks

LENS = Pinhole.of_hfov(WIDTH, 640, 75.0)
LEVEL = np.diag([1.0, -1.0, -1.0])
STEP_M = 0.12


def walked_poses(count: int) -> Floats:
    """world_from_rig (n, 4, 4): along x, about a metre and a half before z = 0, swaying and turning a little."""
    at = np.arange(count)
    poses = np.tile(np.eye(4), (count, 1, 1))
    turns = np.radians([1.0, 2.0, 0.5]) * np.sin(at[:, None] / [5.0, 7.0, 9.0])
    poses[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix() @ LEVEL
    poses[:, :3, 3] = np.column_stack([STEP_M * at, 0.03 * np.sin(at / 4), 1.5 + 0.04 * np.sin(at / 6)])
    return poses


def tracks_of(poses: Floats, outliers: float = 0.0, noise_px: float = 0.2) -> LensTracks:
    """What is followed along a path. Of some points, every sighting drifts."""
    rng = np.random.default_rng(2)
    count = 60 * len(poses)
    points = rng.uniform([-2.0, -1.0, -1.0], [STEP_M * len(poses) + 2.0, 1.2, 0.05], (count, 3))
    points[::2, 2] = 0.0
    drift = (rng.random(count) < outliers)[:, None] * rng.normal(0, 0.004, (count, 3))
    frames, numbers, pixels, segments = [], [], [], []
    for k, pose in enumerate(poses):
        here = LENS.pixels((points + k * drift - pose[:3, 3]) @ pose[:3, :3])
        seen = np.flatnonzero(np.isfinite(here[:, 0]))
        frames.append(np.full(len(seen), k))
        numbers.append(seen)
        pixels.append(here[seen] + rng.normal(0, noise_px, (len(seen), 2)))
        segments.append(lines_at(pose))
    return LensTracks(
        np.arange(len(poses)),
        np.concatenate(frames),
        np.concatenate(numbers),
        np.concatenate(pixels),
        tuple(segments),
        (LENS.width, LENS.height),
    )


def lines_at(pose: Floats) -> Floats:
    """Segments (n, 4) of posts and beams, and of what goes into depth, that a picture shows."""
    x = pose[0, 3]
    ends = [([x + dx, -0.5, 0.0], [x + dx, 0.6, 0.0]) for dx in (-0.7, -0.2, 0.3, 0.8)]
    ends += [([x - 0.8, y, 0.0], [x + 0.8, y, 0.0]) for y in (-0.5, 0.1, 0.6)]
    ends += [([x + dx, y, 0.0], [x + dx, y, -0.8]) for dx in (-0.5, 0.5) for y in (-0.5, 0.5)]
    both = np.array(ends) - pose[:3, 3]
    at = LENS.pixels(both @ pose[:3, :3])
    return np.asarray(at[np.isfinite(at).all(axis=(1, 2))].reshape(-1, 4))
