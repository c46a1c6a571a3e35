"""The model: a cuboid's outline in a view, and how it moves with the cuboid and the camera. numpy only.

A pallet's pose is (x, y, turn), as `gtsam.Pose2` has it: x along the row and y = -z, so that turns are counter-clockwise as seen
from above. The outline of a convex body is the hull of its projected corners, so no point on it need be told to be on a given edge.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from savmap.types import Floats, ViewSpec

NEAREST_M = 0.1


@dataclass(frozen=True)
class Camera:
    """A view of a frame: world_from_rig (4, 4) and what cuts the view out of the panorama."""

    world_from_rig: Floats
    spec: ViewSpec


def corners(pose: Floats, size: Floats) -> Floats:
    """The corners (8, 3) m in the row's frame of a cuboid of `size` (3,) (along its x, y, z) on the floor: the lower four, then the
    upper ones, each counter-clockwise as seen from above."""
    x, z = np.array([-1, 1, 1, -1]) * size[0] / 2, np.array([1, 1, -1, -1]) * size[2] / 2
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    ring = np.stack([pose[0] + cos * x + sin * z, np.zeros(4), -pose[1] - sin * x + cos * z], axis=1)
    return np.concatenate([ring, ring + np.array([0.0, size[1], 0.0])])


def corner_slopes(pose: Floats, points: Floats) -> Floats:
    """Derivatives (n, 3, 3) of points (n, 3) of a pallet by its pose in GTSAM's tangent: steps along its own axes, and a turn."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    slopes = np.zeros((len(points), 3, 3))
    slopes[:, :, 0] = cos, 0.0, -sin
    slopes[:, :, 1] = -sin, 0.0, -cos
    slopes[:, 0, 2], slopes[:, 2, 2] = points[:, 2] + pose[1], pose[0] - points[:, 0]
    return slopes


def errors(pixels: Floats, pose: Floats, size: Floats, camera: Camera) -> Floats:
    """How far pixels (n, 2) lie outside (+) or inside (-) the outline, px; NaN where a corner is not in front of the camera."""
    return with_slopes(pixels, pose, size, camera)[0]


def with_slopes(pixels: Floats, pose: Floats, size: Floats, camera: Camera) -> tuple[Floats, Floats, Floats]:
    """The errors (n,) px, and their derivatives by the frame's pose (n, 6), as GTSAM moves a Pose3, and the pallet's (n, 3)."""
    world = corners(pose, size)
    rotation = camera.world_from_rig[:3, :3]
    rig = (world - camera.world_from_rig[:3, 3]) @ rotation
    view = rig @ camera.spec.rig_from_view
    if view[:, 2].min() < NEAREST_M:
        nothing = np.full(len(pixels), np.nan)
        return nothing, np.zeros((len(pixels), 6)), np.zeros((len(pixels), 3))
    focal, middle = camera.spec.camera[0, 0], camera.spec.camera[:2, 2]
    projected = focal * view[:, :2] / view[:, 2:] + middle
    distances, by_corner = from_hull(pixels, projected)
    slopes = np.zeros((8, 2, 3))
    slopes[:, 0, 0] = slopes[:, 1, 1] = focal / view[:, 2]
    slopes[:, :, 2] = -focal * view[:, :2] / view[:, 2:] ** 2
    by_rig = slopes @ camera.spec.rig_from_view.T
    by_frame = np.concatenate([by_rig @ _skew(rig), -by_rig], axis=2)
    by_pallet = by_rig @ rotation.T @ corner_slopes(pose, world)
    return distances, np.einsum("nci,cij->nj", by_corner, by_frame), np.einsum("nci,cij->nj", by_corner, by_pallet)


def from_hull(pixels: Floats, projected: Floats) -> tuple[Floats, Floats]:
    """Signed distances (n,) of pixels (n, 2) from the hull of points (m, 2), + outside, and their derivatives (n, m, 2) by these."""
    order = cv2.convexHull(projected.astype(np.float32), returnPoints=False).ravel()
    after = np.roll(order, -1)
    sides = projected[after] - projected[order]
    lengths = np.maximum(np.linalg.norm(sides, axis=1), 1e-9)
    normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / lengths[:, None]
    normals *= -np.sign(np.sum(normals * (projected.mean(axis=0) - projected[order]), axis=1))[:, None]
    offsets = pixels[:, None] - projected[order]
    distances = np.einsum("nsi,si->ns", offsets, normals)
    side = np.argmax(distances, axis=1)
    rows = np.arange(len(pixels))
    share = np.einsum("ni,ni->n", offsets[rows, side], sides[side]) / lengths[side] ** 2
    slopes = np.zeros((len(pixels), len(projected), 2))
    slopes[rows, order[side]] = -(1 - share)[:, None] * normals[side]
    slopes[rows, after[side]] -= share[:, None] * normals[side]
    return distances[rows, side], slopes


def _skew(vectors: Floats) -> Floats:
    """Matrices (n, 3, 3) of the cross product with vectors (n, 3)."""
    made = np.zeros((len(vectors), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        made[:, i, j], made[:, j, i] = -vectors[:, k], vectors[:, k]
    return made
