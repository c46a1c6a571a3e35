"""Appearance as relative motion: points followed through a few frames, as one factor between these frames' poses.

Each point is free in space. It is triangulated with the poses that the structures gave, and left out where it disagrees
with them; then it is eliminated (Mourikis and Roumeliotis 2007), so that the factor binds its frames to one another and
to no position, no scale and no structure. The factor is linear about the structures' poses.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from savmap.geometry.triangulate import nearest_points
from savmap.graph.constraints import Constraints
from savmap.graph.keys import frame_key
from savmap.graph.measurements import image_measurements
from savmap.types import Floats, Flow, Ints, Trajectory

PLUGIN = "appearance"
ERROR_PX, SIGMA_PX = 0.3, 1.0
GATE_SIGMA = 4.0
MOST_M = 0.1
HUBER = 1.345
NEAREST_M, FARTHEST_M = 0.3, 30.0
LEAST_PARALLAX_DEG = 1.0
LEAST_POINTS = 8
ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Reprojection:
    """Points' errors (n, k, 2) px, the errors' slopes (n, k, 2, 3) by the point in the rig, px/m, and where it is
    there, offsets (n, k, 3) m."""

    errors: Floats
    slopes: Floats
    offsets: Floats


def motion_constraints(
    flows: Sequence[Flow], path: Trajectory, frames: Ints, sigma_px: float = SIGMA_PX
) -> tuple[Constraints, dict[str, int]]:
    """Motion between `frames`, those that structures were seen in, from followed points, about the `path` that the
    structures gave; and, for the report, the numbers of points and of those that agree with it. Frames where the path
    is worse than a decimetre get no factor. `sigma_px`: of each point, much more than its error, for neighbouring
    points err alike and windows overlap."""
    located = np.intersect1d(frames, path.frames[_sigma_m(path) < MOST_M])
    graph, seen, used = gtsam.NonlinearFactorGraph(), 0, 0
    for flow in flows:
        if not np.isin(flow.frames, located).all():
            continue
        at = np.searchsorted(path.frames, flow.frames)
        poses = path.world_from_rig[at]
        points, weights = weighed_points(flow, poses, _sigma_m(path)[at])
        kept = weights > 0
        seen, used = seen + len(kept), used + int(kept.sum())
        if kept.sum() >= LEAST_POINTS:
            slopes, errors = motion(flow.take(kept), poses, points[kept], weights[kept] / sigma_px)
            graph.push_back(motion_factor(flow.frames, poses, slopes, errors))
    counts = {"points followed": seen, "points used": used}
    return Constraints(PLUGIN, {}, image_measurements((), {}, {}), (), {}, factors=graph), counts


def _sigma_m(path: Trajectory) -> Floats:
    """The standard deviation (f,) of the camera's positions along the worst axis, m."""
    return np.zeros(len(path.frames)) if path.sigma_m is None else np.asarray(path.sigma_m.max(axis=1))


def weighed_points(flow: Flow, poses: Floats, sigma_m: Floats) -> tuple[Floats, Floats]:
    """Points (n, 3) m by poses (k, 4, 4) whose positions have standard deviations sigma_m (k,), and the weight of each
    (n,): Huber's weight of its largest error, in standard deviations of the tracker's and the positions' errors; 0
    where a point is not in front of the camera, has no parallax, or deviates by more than four."""
    points = triangulated(flow, poses, sigma_m)
    projected = seen_from(flow, poses, points)
    depth = projected.offsets @ flow.spec.rig_from_view[:, 2]
    rays = (points[:, None] - poses[:, :3, 3]) / np.linalg.norm(projected.offsets, axis=2, keepdims=True)
    parallax = np.einsum("ni,ni->n", rays[:, 0], rays[:, -1]) < np.cos(np.radians(LEAST_PARALLAX_DEG))
    before = ((depth > NEAREST_M) & (depth < FARTHEST_M)).all(axis=1)
    deviation = (np.linalg.norm(projected.errors, axis=2) / _sigma_px(flow, sigma_m, depth)).max(axis=1)
    weights = np.minimum(1.0, HUBER / np.maximum(deviation, 1e-9))
    return points, np.where(before & parallax & (deviation < GATE_SIGMA), weights, 0.0)


def _sigma_px(flow: Flow, sigma_m: Floats, depth: Floats) -> Floats:
    """Expected errors (n, k) of points at depths (n, k) m: the tracker's, and those of the camera's positions."""
    return np.asarray(np.hypot(ERROR_PX, flow.spec.camera[0, 0] * sigma_m / np.maximum(depth, NEAREST_M)))


def triangulated(flow: Flow, poses: Floats, sigma_m: Floats) -> Floats:
    """Points (n, 3) m in the world: nearest to all rays first, then by least squares of their errors in pixels."""
    rays = np.einsum("kij,nkj->nki", poses[:, :3, :3], flow.spec.rig_rays(flow.pixels))
    points = nearest_points(poses[:, :3, 3], rays)
    for _ in range(ROUNDS):
        projected = seen_from(flow, poses, points)
        sigma_px = np.repeat(_sigma_px(flow, sigma_m, projected.offsets @ flow.spec.rig_from_view[:, 2]), 2, axis=1)[
            ..., None
        ]
        slopes = _by_point(projected, poses) / sigma_px
        normal = np.swapaxes(slopes, 1, 2) @ slopes + 1e-6 * np.eye(3)
        right = np.swapaxes(slopes, 1, 2) @ (projected.errors.reshape(sigma_px.shape) / sigma_px)
        points = points - np.linalg.solve(normal, right)[..., 0]
    return points


def seen_from(flow: Flow, poses: Floats, points: Floats) -> Reprojection:
    """How points (n, 3) are seen from poses (k, 4, 4): projected less followed pixels."""
    camera, turn = flow.spec.camera, flow.spec.rig_from_view
    offsets = np.einsum("kji,nkj->nki", poses[:, :3, :3], points[:, None] - poses[:, :3, 3])
    inside = offsets @ turn
    depth = np.where(np.abs(inside[..., 2]) > 1e-3, inside[..., 2], 1e-3)[..., None]
    errors = camera[0, 0] * inside[..., :2] / depth + camera[:2, 2] - flow.pixels
    slopes = np.zeros((*errors.shape, 3))
    slopes[..., 0, 0] = slopes[..., 1, 1] = camera[0, 0] / depth[..., 0]
    slopes[..., 2] = -camera[0, 0] * inside[..., :2] / depth**2
    return Reprojection(errors, slopes @ turn.T, offsets)


def _by_point(projected: Reprojection, poses: Floats) -> Floats:
    """Derivatives (n, 2k, 3) of the errors by the points in the world."""
    slopes = projected.slopes @ np.swapaxes(poses[:, :3, :3], 1, 2)
    return slopes.reshape(len(slopes), -1, 3)


def motion(flow: Flow, poses: Floats, points: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """What points (n, 3) say of their frames' motion with weights (n,) 1/px: whitened slopes (m, 6k) and errors (m,),
    with m <= 6k + 1, by turns and steps in each rig's own axes, as GTSAM moves poses."""
    projected = seen_from(flow, poses, points)
    count, frames = len(projected.errors), len(flow.frames)
    blocks = np.concatenate([projected.slopes @ skew(projected.offsets), -projected.slopes], axis=-1)
    slopes = np.zeros((count, frames, 2, frames, 6))
    slopes[:, np.arange(frames), :, np.arange(frames)] = np.swapaxes(blocks, 0, 1)
    across = np.linalg.qr(_by_point(projected, poses), mode="complete").Q[:, :, 3:]
    free = weights[:, None, None] * np.swapaxes(across, 1, 2)
    errors = free @ projected.errors.reshape(count, 2 * frames, 1)
    joint = np.concatenate([free @ slopes.reshape(count, 2 * frames, 6 * frames), errors], axis=2)
    small = np.asarray(np.linalg.qr(joint.reshape(-1, 6 * frames + 1), mode="r"))
    return small[:, :-1], small[:, -1]


def skew(vectors: Floats) -> Floats:
    """Matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    return np.asarray(np.cross(np.eye(3), vectors[..., None, :]))


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
