"""The solve: GTSAM's Levenberg-Marquardt with Huber's loss, then again without what does not fit, until that is settled."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import gtsam
import numpy as np
from numpy.typing import NDArray

from savmap.errors import SolveError
from savmap.graph.covariance import Covariance, covariance
from savmap.graph.factors import estimate_of, observation_factors, other_factors, values_of
from savmap.graph.finish import conclude
from savmap.graph.keys import centre_key, frame_key
from savmap.graph.problem import Problem
from savmap.graph.residuals import Fit, correlation, fit_of
from savmap.graph.solution import Solution
from savmap.graph.start import Estimate, start

Mask = NDArray[np.bool_]
SETTLED = 1e-4
ROUGH, FINE = 1e-4, 1e-6


@dataclass(frozen=True)
class SolveOptions:
    """`start`: linear equations, or as published. An observation more than `reject_sigma` off is left out, in at most
    `rounds` rounds. `max_iterations` of Levenberg-Marquardt a round."""

    start: Literal["linear", "published"] = "linear"
    reject_sigma: float = 4.0
    rounds: int = 5
    max_iterations: int = 50


def solve(problem: Problem, options: SolveOptions | None = None) -> Solution:
    """Solve, reject, repeat; then covariances. Raises SolveError if scale or place are not observable, if references
    contradict one another, or if the graph cannot be solved."""
    chosen = options or SolveOptions()
    row = problem.frames.facts.name
    begin = start(problem, chosen.start)
    problem = begin.problem
    estimate, fit = [*_rounds(problem, begin.estimate, chosen)][-1]
    if not fit.kept.any():
        raise SolveError(f"row {row}: no observation fits the solution")
    inflation = fit.scale**2 * correlation(problem, fit)
    found = _covariance(problem, estimate, fit.kept, inflation)
    return conclude(problem, estimate, fit, found, inflation, begin.notes)


def _rounds(problem: Problem, estimate: Estimate, options: SolveOptions) -> Iterator[tuple[Estimate, Fit]]:
    """Estimates and what fits them, the last one being the answer: all observations at first, then those that fitted."""
    factors = observation_factors(problem.observations)
    kept: Mask = np.ones(len(factors), dtype=bool)
    for number in range(options.rounds):
        chosen = [factors[index] for index in np.flatnonzero(kept)]
        estimate = _optimise(problem, estimate, chosen, options.max_iterations, FINE if number else ROUGH)
        fit = fit_of(problem, estimate, kept, options.reject_sigma)
        yield estimate, fit
        if number and (fit.kept != kept).sum() <= SETTLED * len(kept):
            return
        kept = fit.kept


def _optimise(
    problem: Problem, estimate: Estimate, factors: list[gtsam.NonlinearFactor], iterations: int, change: float
) -> Estimate:
    graph = other_factors(problem, estimate)
    for factor in factors:
        graph.push_back(factor)
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(iterations)
    settings.setRelativeErrorTol(change)
    try:
        values = gtsam.LevenbergMarquardtOptimizer(graph, values_of(problem, estimate), settings).optimize()
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else "no reason given"
        raise SolveError(f"row {problem.frames.facts.name}: the graph cannot be solved ({reason})") from error
    return estimate_of(problem, values, estimate)


def _covariance(problem: Problem, estimate: Estimate, kept: Mask, inflation: float) -> Covariance:
    graph = other_factors(problem, estimate)
    for factor in observation_factors(problem.observations.take(kept), inflation):
        graph.push_back(factor)
    used = problem.used.tolist()
    frames, centres = [frame_key(frame) for frame in used], [centre_key(frame) for frame in used]
    return covariance(graph, values_of(problem, estimate), frames, centres)
