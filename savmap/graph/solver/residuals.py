"""Residuals: their scale, which measurements are outliers, and how errors persist from frame to frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.graph.problem import Estimate, Problem
from savmap.types import Floats

MEDIAN_CHI2 = 0.55
LEAST_SCALE = 0.5
LAGS = 30
LEAST_RATE = 0.05
LEAST_LEFT = 0.4
MOST_INFLATION = 30.0
TURNS = 5


@dataclass(frozen=True, eq=False)
class Fit:
    """Whitened errors (n, 2), which measurements are kept (n,), and the errors' scale: 1 if covariances were honest."""

    errors: Floats
    kept: NDArray[np.bool_]
    scale: float


def fit_of(problem: Problem, estimate: Estimate, used: NDArray[np.bool_], reject_sigma: float) -> Fit:
    """Judge all measurements by the scale of the errors among those `used` (n,): a robust scale first, then the mean one."""
    if not len(problem.measurements):
        return Fit(np.zeros((0, 2)), used, 1.0)
    errors = problem.residuals(estimate.poses, estimate.points)
    squared = (errors**2).sum(axis=1)
    worth = problem.measurements.dof
    robust = max(LEAST_SCALE, float(np.sqrt(np.median((squared / worth)[used]) / MEDIAN_CHI2)))
    kept = squared < (reject_sigma * robust) ** 2
    freedom = worth[kept].sum()
    spare = max(float(freedom - _unknowns(problem)), 0.1 * float(freedom), 1.0)
    scale = max(LEAST_SCALE, float(np.sqrt(squared[kept].sum() / spare)))
    return Fit(errors, kept, scale)


def _unknowns(problem: Problem) -> int:
    """Unknowns that the pictures alone determine: six a frame, unless it is held, and the free coordinates of the grid."""
    frames = 0 if problem.camera.fixed is not None else 6 * len(problem.used)
    return frames + max(3 * len(problem.keys) - sum(not relation.name for relation in problem.relations), 0)


@dataclass(frozen=True)
class Persistence:
    """Factors (>= 1) by which errors that persist from frame to frame raise variances: one for the solve and its tests, and
    one for the standard deviations that are reported."""

    solved: float = 1.0
    reported: float = 1.0


def persistence(problem: Problem, fit: Fit) -> Persistence:
    """1 + 2 (r_1 + r_2 + ...), with r_k the errors' autocorrelations over k frames, summed until they vanish (Geyer's initial
    sequence).

    Residuals show too little correlation, for each point's position has absorbed the mean of its errors: n measurements
    without their mean lose I / n in every r_k, I being the factor itself. The reported factor allows for that lag by lag, in
    turns; the factor for tests, which must not hide a contradiction, does so for their sum alone.
    """
    if not fit.kept.any():
        return Persistence()
    rates, count = _autocorrelation(problem, fit)
    lags = int(np.argmax(np.append(rates, 0.0) < LEAST_RATE))
    total = 2 * float(rates[:lags].sum())
    solved = min((1 + total) / max(1 + (total - 2 * lags) / count, LEAST_LEFT), MOST_INFLATION)
    reported = 1.0
    for _ in range(TURNS):
        raised = rates * max(1 - reported / count, LEAST_LEFT) + reported / count
        lags = int(np.argmax(np.append(raised, 0.0) < LEAST_RATE))
        reported = 1 + 2 * float(raised[:lags].sum())
    return Persistence(solved, min(max(reported, solved), MOST_INFLATION))


def _autocorrelation(problem: Problem, fit: Fit) -> tuple[Floats, float]:
    """Correlation (LAGS,) of a point's errors in frames 1, 2, ... apart, and the usual number of measurements of a point."""
    measurements = problem.measurements
    order = np.lexsort((measurements.frames, measurements.view, measurements.keys))
    order = order[fit.kept[order]]
    both, squares = np.zeros(LAGS + 1), np.zeros(LAGS + 1)
    for shift in range(1, LAGS + 1):
        a, b = order[:-shift], order[shift:]
        apart = measurements.frames[b] - measurements.frames[a]
        same = (measurements.keys[a] == measurements.keys[b]) & (measurements.view[a] == measurements.view[b])
        near = same & (apart <= LAGS) & (apart > 0)
        first, second = fit.errors[a[near]], fit.errors[b[near]]
        both += np.bincount(apart[near], (first * second).sum(axis=1), LAGS + 1)
        squares += np.bincount(apart[near], ((first**2).sum(axis=1) + (second**2).sum(axis=1)) / 2, LAGS + 1)
    seen = np.bincount(problem.at_key[order])
    return both[1:] / np.maximum(squares[1:], 1e-9), float(np.mean(seen[seen > 0])) if len(order) else 1.0
