"""What the residuals say: their scale, which observations do not belong, and how far neighbours in time agree."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.graph.problem import Problem
from savmap.graph.start import Estimate
from savmap.types import Floats

MEDIAN_CHI2 = 0.55
LEAST_SCALE = 0.5
MOST_CORRELATION = 0.9


@dataclass(frozen=True)
class Fit:
    """Whitened errors (n, 2), which observations are kept (n,), and the errors' scale: 1 if covariances were honest."""

    errors: Floats
    kept: NDArray[np.bool_]
    scale: float


def fit_of(problem: Problem, estimate: Estimate, used: NDArray[np.bool_], reject_sigma: float) -> Fit:
    """Judge all observations by the scale of the errors among those `used` (n,): a robust scale first, then the mean one."""
    errors = problem.residuals(estimate.poses, estimate.points)
    squared = (errors**2).sum(axis=1)
    worth = problem.observations.dof
    robust = max(LEAST_SCALE, float(np.sqrt(np.median((squared / worth)[used]) / MEDIAN_CHI2)))
    kept = squared < (reject_sigma * robust) ** 2
    freedom = worth[kept].sum()
    spare = max(float(freedom - _unknowns(problem)), 0.1 * float(freedom), 1.0)
    scale = max(LEAST_SCALE, float(np.sqrt(squared[kept].sum() / spare)))
    return Fit(errors, kept, scale)


def _unknowns(problem: Problem) -> int:
    """Unknowns that the pictures alone determine: six a frame, unless it is held, and the free coordinates of the grid."""
    frames = 0 if problem.frames.fixed is not None else 6 * len(problem.used)
    return frames + max(3 * len(problem.keys) - sum(not relation.name for relation in problem.relations), 0)


def correlation(problem: Problem, fit: Fit) -> float:
    """Factor (>= 1) by which errors that persist from frame to frame raise variances: (1 + r) / (1 - r)."""
    observations = problem.observations
    order = np.lexsort((observations.frames, observations.view, observations.keys))
    order = order[fit.kept[order]]
    before, after = order[:-1], order[1:]
    same = (observations.keys[before] == observations.keys[after]) & (
        observations.view[before] == observations.view[after]
    )
    near = same & (observations.frames[after] - observations.frames[before] == 1)
    if not near.any():
        return 1.0
    a, b = fit.errors[before[near]], fit.errors[after[near]]
    rate = float((a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum()))
    rate = min(max(rate, 0.0), MOST_CORRELATION)
    return (1 + rate) / (1 - rate)
