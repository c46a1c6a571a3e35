"""The problem as GTSAM's factors, nearly all compiled, and estimates as GTSAM values.

A camera height is that of the rig's origin (`ReferenceFrameFactor`) in the world's axes. Axes that a relation leaves
free have no weight.
"""

from collections.abc import Callable, Iterator
from functools import lru_cache
from itertools import pairwise

import gtsam
import numpy as np

from savmap.graph.constraints import TIGHT_M, Relation
from savmap.graph.factors.projections import projection_factors
from savmap.graph.keys import ORIGIN, camera_height_key, frame_key, variable_at
from savmap.graph.measurements import ImageMeasurements
from savmap.graph.problem import Estimate, Problem, first_poses
from savmap.types import Floats

HUBER = 1.345
LOOSE_M = 100.0
ATTITUDE_RAD = 0.2
MOTION_M = 0.5
HELD_M, HELD_RAD = 1e-4, 1e-5


def whole_graph(
    problem: Problem, at: Estimate, measurements: ImageMeasurements, huber: float | Floats | None
) -> gtsam.NonlinearFactorGraph:
    """All factors of a problem, those of `measurements` last; `at` as below, and `huber` as in `projection_factors`."""
    graph = other_factors(problem, at)
    for factor in projection_factors(measurements, huber):
        graph.add(factor)
    return graph


def other_factors(problem: Problem, at: Estimate) -> gtsam.NonlinearFactorGraph:
    """All but the measurements: relations, frames, references, and the plugins' factors. `at` gives the motion to stay
    near to."""
    graph = gtsam.NonlinearFactorGraph()
    for relation in problem.relations:
        graph.add(relation_factor(relation))
    for key in problem.keys.tolist():
        graph.add(
            gtsam.PriorFactorPoint3(key, at.points[problem.index(key)], gtsam.noiseModel.Isotropic.Sigma(3, LOOSE_M))
        )
    for part in problem.parts:
        if part.factors is not None:
            graph.push_back(part.factors)
    for factor in _frame_factors(problem, at):
        graph.add(factor)
    return graph


@lru_cache(1 << 14)
def relation_factor(relation: Relation) -> gtsam.NonlinearFactor:
    """The paper's BetweenFactor or PriorFactor on one axis; a distance's RangeFactor. Every round asks for the same."""
    if relation.axis is None and relation.b is not None:
        return gtsam.RangeFactor3(
            relation.a, relation.b, relation.value, gtsam.noiseModel.Isotropic.Sigma(1, relation.sigma)
        )
    value = relation.value * np.eye(3)[relation.column]
    noise = along(relation.column, relation.sigma)
    if relation.b is None:
        return gtsam.PriorFactorPoint3(relation.a, value, noise)
    return gtsam.BetweenFactorPoint3(relation.a, relation.b, value, noise)


def along(axis: int, sigma: float) -> gtsam.noiseModel.Diagonal:
    """Noise `sigma` m on one axis of a point; the others have no weight."""
    return gtsam.noiseModel.Diagonal.Precisions(np.eye(3)[axis] / sigma**2)


def _frame_factors(problem: Problem, at: Estimate) -> Iterator[gtsam.NonlinearFactor]:
    yield gtsam.PriorFactorPoint3(ORIGIN, np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, TIGHT_M))
    if problem.camera.fixed is not None:
        yield from _held(problem)
        return
    given = first_poses(problem)
    for frame, pose in zip(problem.used.tolist(), given, strict=True):
        yield _attitude(frame, pose, ATTITUDE_RAD)
    yield from _motion(problem, at)
    yield from _heights(problem)


def _attitude(frame: int, pose: Floats, sigma: float) -> gtsam.NonlinearFactor:
    return gtsam.PoseRotationPrior3D(
        frame_key(frame), gtsam.Rot3(pose[:3, :3]), gtsam.noiseModel.Isotropic.Sigma(3, sigma)
    )


def _held(problem: Problem) -> Iterator[gtsam.NonlinearFactor]:
    """Poses of an earlier map."""
    position = gtsam.noiseModel.Isotropic.Sigma(3, HELD_M)
    for frame, pose in zip(problem.used.tolist(), first_poses(problem), strict=True):
        yield gtsam.PoseTranslationPrior3D(frame_key(frame), pose[:3, 3], position)
        yield _attitude(frame, pose, HELD_RAD)


def _motion(problem: Problem, at: Estimate) -> Iterator[gtsam.NonlinearFactor]:
    """Steps stay near the estimate's: far too weak to matter, but where next to nothing was measured in a frame."""
    for of_pass in problem.passes():
        for before, after in pairwise(of_pass.tolist()):
            step = at.poses[after, :3, 3] - at.poses[before, :3, 3]
            a, b = int(problem.used[before]), int(problem.used[after])
            noise = gtsam.noiseModel.Isotropic.Sigma(3, MOTION_M * np.sqrt(b - a))
            yield gtsam.CustomFactor(noise, [frame_key(a), frame_key(b)], _off_step(step))


def _off_step(step: Floats) -> Callable[[gtsam.CustomFactor, gtsam.Values, list[Floats] | None], Floats]:
    """How far the way from one frame to another is off a step (3,) in the world: GTSAM has no such factor, but in the
    first frame's axes."""

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        first, second = map(values.atPose3, factor.keys())
        if jacobians is not None:
            slopes = np.zeros((2, 3, 6))
            slopes[0, :, 3:], slopes[1, :, 3:] = -first.rotation().matrix(), second.rotation().matrix()
            jacobians[0], jacobians[1] = slopes
        left: Floats = second.translation() - first.translation() - step
        return left

    return error


def _heights(problem: Problem) -> Iterator[gtsam.NonlinearFactor]:
    """One unknown height for each reference; its frames sway about it."""
    for number, height in enumerate(problem.camera.references.camera_heights):
        key = camera_height_key(number)
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([1.0, height.sigma_m, 1.0]))
        yield gtsam.PriorFactorPoint3(key, np.array([0.0, height.value_m, 0.0]), noise)
        for of_pass in problem.passes(height.passes):
            for frame in problem.used[of_pass].tolist():
                yield gtsam.ReferenceFrameFactorPoint3Pose3(ORIGIN, frame_key(frame), key, along(1, height.sway_m))


def values_of(problem: Problem, estimate: Estimate) -> gtsam.Values:
    """GTSAM's values of an estimate."""
    values = gtsam.Values()
    values.insert(ORIGIN, np.zeros(3))
    for frame, pose in zip(problem.used.tolist(), estimate.poses, strict=True):
        values.insert(frame_key(frame), gtsam.Pose3(pose))
    for key, point in zip(problem.keys.tolist(), estimate.points, strict=True):
        values.insert(key, point)
    for key, value in estimate.variables.items():
        values.insert(key, value)
    if problem.camera.fixed is None:
        for number, height in enumerate(estimate.heights):
            values.insert(camera_height_key(number), np.array([0.0, height, 0.0]))
    return values


def estimate_of(problem: Problem, values: gtsam.Values, before: Estimate) -> Estimate:
    """The estimate in GTSAM's values."""
    poses = np.array([values.atPose3(frame_key(frame)).matrix() for frame in problem.used.tolist()])
    points = np.array([values.atPoint3(key) for key in problem.keys.tolist()]).reshape(-1, 3)
    variables = {key: variable_at(values, key) for key in before.variables}
    if problem.camera.fixed is not None:
        return Estimate(poses, points, before.heights, variables)
    heights = np.array([values.atPoint3(camera_height_key(number))[1] for number in range(len(before.heights))])
    return Estimate(poses, points, heights, variables)
