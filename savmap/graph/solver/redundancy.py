"""Redundancy: how much of each class's residuals the unknowns have absorbed.

A class that few measurements belong to but that places the camera, such as edges along which it moves, loses more of
its errors to the camera's poses than one of many measurements. Residuals are that much smaller than errors.
"""

import numpy as np

from savmap.graph.problem import Estimate, Problem
from savmap.types import Bools, Floats

LEAST_LEFT, NEAREST_M = 0.1, 0.1
LOOSE = np.array([5.0, 5.0, 5.0, 0.1, 0.1, 0.1])
"""What is known of a pose in any case, 1/rad and 1/m: a frame with few measurements is not at a loss."""


def left_of(problem: Problem, estimate: Estimate, kept: Bools, freedom: Floats) -> Floats:
    """The part (c,) of the `freedom` (c,) of the kept (n,) measurements of each class that is left of their errors'
    squares: 1 where the unknowns are held, 0.1 at the least."""
    count = len(freedom)
    classes = problem.measurements.classes[kept]
    points = np.unique(np.stack([classes, problem.at_key[kept]]), axis=1)[0]
    share = np.bincount(points, minlength=count) / max(len(problem.keys), 1)
    free = max(3 * len(problem.keys) - sum(not relation.name for relation in problem.relations), 0)
    taken = free * share + (0.0 if problem.camera.fixed is not None else _by_poses(problem, estimate, kept, count))
    return np.asarray(np.maximum(1 - taken / np.maximum(freedom, 1.0), LEAST_LEFT))


def _by_poses(problem: Problem, estimate: Estimate, kept: Bools, count: int) -> Floats:
    """How many of the poses' unknowns, six a frame, each class (c,) determines: the traces of its parts of their
    information."""
    at, classes = problem.at_frame[kept], problem.measurements.classes[kept]
    slopes = _slopes(problem, estimate)[kept]
    own = np.zeros((count, len(problem.used), 6, 6))
    np.add.at(own, (classes, at), np.swapaxes(slopes, 1, 2) @ slopes)
    inverse = np.linalg.inv(own.sum(axis=0) + np.diag(LOOSE**2))
    return np.asarray(np.einsum("cfij,fji->c", own, inverse))


def _slopes(problem: Problem, estimate: Estimate) -> Floats:
    """Derivatives (n, 2, 6) of whitened errors by turns and steps of the rig, where errors are small."""
    poses = estimate.poses[problem.at_frame]
    forms = problem.linear_forms
    offsets = np.einsum("nji,nj->ni", poses[:, :3, :3], estimate.points[problem.at_key] - poses[:, :3, 3])
    depths = np.maximum(np.einsum("ni,ni->n", forms.axes, offsets), NEAREST_M)[:, None, None]
    turns = np.cross(forms.forms, offsets[:, None])
    return np.asarray(np.concatenate([turns, -forms.forms], axis=2) / depths)
