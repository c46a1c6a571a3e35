"""Appearance as relative motion: points followed through a few frames, as one factor between these frames' poses.

Each point is free in space. It is placed with the poses that the structures gave, and left out where it disagrees with them;
then it is eliminated (Mourikis and Roumeliotis 2007), so that what is left binds its frames to one another and to no place,
no scale and no structure. The factor is linear about the structures' poses, which are good to centimetres.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray

from savmap.geometry.triangulate import nearest_points
from savmap.graph.constraints import Constraints
from savmap.graph.keys import frame_key
from savmap.graph.observations import observe
from savmap.types import Floats, Flow, Ints, Trajectory

ROOM = "appearance"
ERROR_PX, SIGMA_PX = 0.3, 2.0
GATE_SIGMA = 4.0
HUBER = 1.345
NEAREST_M, FARTHEST_M = 0.3, 30.0
LEAST_PARALLAX_DEG = 1.0
LEAST_POINTS = 8
ROUNDS = 4


@dataclass(frozen=True)
class Placed:
    """Points' errors (n, k, 2) px, the errors' slopes (n, k, 2, 3) by the point in the rig, px/m, and where it is there,
    offsets (n, k, 3) m."""

    errors: Floats
    slopes: Floats
    offsets: Floats


def motion_constraints(
    flows: Sequence[Flow], path: Trajectory, frames: Ints
) -> tuple[Constraints, tuple[int, int]]:
    """What followed points say of the motion between `frames`, the ones that structures were seen in, about the `path` that
    these gave; and how many points there were and how many of them agree."""
    graph, seen, used = gtsam.NonlinearFactorGraph(), 0, 0
    for one in flows:
        if not np.isin(one.frames, frames).all():
            continue
        own = np.searchsorted(path.frames, one.frames)
        poses = path.world_from_rig[own]
        sigma_m = np.zeros(len(own)) if path.sigma_m is None else path.sigma_m[own].max(axis=1)
        chosen = one.take(agreeing(one, poses, sigma_m))
        seen, used = seen + len(one.pixels), used + len(chosen.pixels)
        if len(chosen.pixels) >= LEAST_POINTS:
            graph.push_back(motion_factor(one.frames, poses, *motion(chosen, poses)))
    return Constraints(ROOM, {}, observe((), {}, {}), (), {}, factors=graph), (seen, used)


def agreeing(one: Flow, poses: Floats, sigma_m: Floats) -> NDArray[np.bool_]:
    """Which points (n,) agree with poses (k, 4, 4) whose places are good to sigma_m (k,): those before the camera, with
    parallax, that are nowhere off by more than four standard deviations of the tracker's and the places' errors."""
    if not len(one.pixels):
        return np.zeros(0, np.bool_)
    points = place(one, poses)
    placed = seen_from(one, poses, points)
    depth = placed.offsets @ one.spec.rig_from_view[:, 2]
    rays = (points[:, None] - poses[:, :3, 3]) / np.linalg.norm(placed.offsets, axis=2, keepdims=True)
    parallax = np.einsum("ni,ni->n", rays[:, 0], rays[:, -1]) < np.cos(np.radians(LEAST_PARALLAX_DEG))
    before = ((depth > NEAREST_M) & (depth < FARTHEST_M)).all(axis=1)
    places_px = one.spec.camera[0, 0] * sigma_m / np.maximum(depth, NEAREST_M)
    off = np.abs(placed.errors).max(axis=2) / np.hypot(ERROR_PX, places_px)
    fits: NDArray[np.bool_] = before & parallax & (off < GATE_SIGMA).all(axis=1)
    return fits


def place(one: Flow, poses: Floats) -> Floats:
    """Points (n, 3) m in the world: nearest to all rays first, then where the squared errors in pixels are least."""
    rays = np.einsum("kij,nkj->nki", poses[:, :3, :3], one.spec.rig_rays(one.pixels))
    points = nearest_points(poses[:, :3, 3], rays)
    for _ in range(ROUNDS):
        placed = seen_from(one, poses, points)
        slopes = _by_point(placed, poses)
        normal = np.swapaxes(slopes, 1, 2) @ slopes + 1e-6 * np.eye(3)
        right = np.swapaxes(slopes, 1, 2) @ placed.errors.reshape(*slopes.shape[:2], 1)
        points = points - np.linalg.solve(normal, right)[..., 0]
    return points


def seen_from(one: Flow, poses: Floats, points: Floats) -> Placed:
    """How points (n, 3) are seen from poses (k, 4, 4): projected less followed pixels."""
    camera, turn = one.spec.camera, one.spec.rig_from_view
    offsets = np.einsum("kji,nkj->nki", poses[:, :3, :3], points[:, None] - poses[:, :3, 3])
    inside = offsets @ turn
    depth = np.where(np.abs(inside[..., 2]) > 1e-3, inside[..., 2], 1e-3)[..., None]
    errors = camera[0, 0] * inside[..., :2] / depth + camera[:2, 2] - one.pixels
    slopes = np.zeros((*errors.shape, 3))
    slopes[..., 0, 0] = slopes[..., 1, 1] = camera[0, 0] / depth[..., 0]
    slopes[..., 2] = -camera[0, 0] * inside[..., :2] / depth**2
    return Placed(errors, slopes @ turn.T, offsets)


def _by_point(placed: Placed, poses: Floats) -> Floats:
    """Derivatives (n, 2k, 3) of the errors by the points in the world."""
    slopes = placed.slopes @ np.swapaxes(poses[:, :3, :3], 1, 2)
    return slopes.reshape(len(slopes), -1, 3)


def motion(one: Flow, poses: Floats) -> tuple[Floats, Floats]:
    """What points say of their frames' motion: slopes (m, 6k) and errors (m,) in standard deviations, m <= 6k + 1, by turns
    and steps in each rig's own axes, as GTSAM moves poses. Huber's weights for each point."""
    placed = seen_from(one, poses, place(one, poses))
    count, frames = placed.errors.shape[:2]
    own = np.concatenate([placed.slopes @ _skew(placed.offsets), -placed.slopes], axis=-1)
    slopes = np.zeros((count, frames, 2, frames, 6))
    slopes[:, np.arange(frames), :, np.arange(frames)] = np.swapaxes(own, 0, 1)
    free = np.swapaxes(np.linalg.qr(_by_point(placed, poses), mode="complete")[0][:, :, 3:], 1, 2) / SIGMA_PX
    errors = free @ placed.errors.reshape(count, 2 * frames, 1)
    size = np.sqrt((errors**2).mean(axis=1, keepdims=True))
    weight = np.sqrt(np.minimum(1.0, HUBER / np.maximum(size, 1e-9)))
    joint = weight * np.concatenate([free @ slopes.reshape(count, 2 * frames, 6 * frames), errors], axis=2)
    small = np.linalg.qr(joint.reshape(-1, 6 * frames + 1), mode="r")
    return small[:, :-1], small[:, -1]


def _skew(vectors: Floats) -> Floats:
    """Matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    made = np.zeros((*vectors.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        made[..., i, j], made[..., j, i] = -vectors[..., k], vectors[..., k]
    return made


def motion_factor(frames: Ints, poses: Floats, slopes: Floats, errors: Floats) -> gtsam.CustomFactor:
    """The same as a factor on the frames' poses, linear about `poses` (k, 4, 4)."""
    keys = [frame_key(frame) for frame in frames.tolist()]
    about = [gtsam.Pose3(pose) for pose in poses]

    def error(_: object, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        if jacobians is not None:
            for number in range(len(keys)):
                jacobians[number] = np.asfortranarray(slopes[:, 6 * number : 6 * number + 6])
        steps = [pose.localCoordinates(values.atPose3(key)) for pose, key in zip(about, keys, strict=True)]
        moved: Floats = errors + slopes @ np.concatenate(steps)
        return moved

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(len(errors)), keys, error)
