"""The solve: GTSAM's Levenberg-Marquardt with Huber's loss, then again without what does not fit, until that is settled."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import gtsam
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array

from savmap.errors import SolveError
from savmap.graph.calibrated import calibrated
from savmap.graph.covariance import Covariance, Covariances, Shared, covariance
from savmap.graph.factors import HUBER, estimate_of, values_of, whole_graph
from savmap.graph.finish import conclude, trajectory
from savmap.graph.keys import centre_key, frame_key
from savmap.graph.observations import Observations
from savmap.graph.order import along_aisle
from savmap.graph.problem import Problem
from savmap.graph.residuals import Fit, Persistence, fit_of, persistence
from savmap.graph.solution import Solution
from savmap.graph.start import Estimate, Start, starts
from savmap.graph.verdicts import tested_keys
from savmap.types import Floats, Trajectory

Mask = NDArray[np.bool_]
SETTLED = 1e-4
SETTLED_BIAS = 0.1
ROUGH, FINE = 1e-4, 1e-6
DOUBTED, CLEARLY = 12.5, 12.5


@dataclass(frozen=True)
class SolveOptions:
    """`start`: linear equations, or as published. `loss`: Huber's, or plain least squares. An observation more than
    `reject_sigma` off is left out, in at most `rounds` rounds. `max_iterations` of Levenberg-Marquardt a round."""

    start: Literal["linear", "published"] = "linear"
    loss: Literal["huber", "none"] = "huber"
    reject_sigma: float = 4.0
    rounds: int = 5
    max_iterations: int = 50


PUBLISHED = SolveOptions("published", loss="none", reject_sigma=float("inf"), rounds=1, max_iterations=100)
"""Plain least squares from the published start, every observation believed (paper, section III.E)."""


@dataclass(frozen=True)
class State:
    """How far the solve has come: the problem freed of the `bias` (k,) px found so far, the estimate, what fits it, and how
    errors persist; `notes` of the start for the user, and the residuals' scale of the first round."""

    problem: Problem
    bias: Floats
    estimate: Estimate
    fit: Fit
    persistence: Persistence
    notes: tuple[str, ...] = ()
    first_scale: float = 0.0

    @property
    def inflation(self) -> float:
        """By what factor observations' variances are larger than they were thought to be, in the solve and its tests."""
        return self.fit.scale**2 * self.persistence.weighed

    @property
    def told(self) -> "State":
        """With the factor for the standard deviations that are told instead."""
        return replace(self, persistence=replace(self.persistence, weighed=self.persistence.told))

    @property
    def kept(self) -> Observations:
        """The observations that fit."""
        return self.problem.observations.take(self.fit.kept)


def solve(problem: Problem, options: SolveOptions | None = None) -> Solution:
    """Solve, reject, repeat; then covariances. Raises SolveError if scale or place are not observable, if references
    contradict one another, or if the graph cannot be solved."""
    return concluded(settled(problem, options))


def located(problem: Problem) -> Trajectory:
    """Where the camera was by one round, good enough to look for other things: `solve` without covariances, and without what is
    told by them. Raises SolveError if scale or place are not observable, or if the graph cannot be solved."""
    state = settled(problem, SolveOptions(rounds=1))
    return trajectory(state.problem, state.estimate)


def settled(problem: Problem, options: SolveOptions | None = None) -> State:
    """The optimum, of the observations that fit it. Raises SolveError as `solve` does."""
    chosen = options or SolveOptions()
    begin = _likeliest(starts(problem, chosen.start), chosen)
    first, *later = _rounds(begin.problem, begin.estimate, chosen)
    last = later[-1] if later else first
    if not last.fit.kept.any():
        raise SolveError(f"row {problem.frames.facts.name}: no observation fits the solution")
    return replace(last, notes=begin.notes, first_scale=first.fit.scale)


def concluded(state: State, joint: Covariances | None = None) -> Solution:
    """What an optimum says, with its covariances or the `joint` ones of several rows. Raises SolveError if references
    contradict one another grossly."""
    joint = joint or Covariances(_covariance(state, None, tested_keys(state.problem)), _covariance(state.told, None))
    found = calibrated(state.problem.frames.calibration, state.bias, joint.told, state.first_scale, state.fit.scale)
    notes = (*state.notes, *found.notes)
    inflation = state.told.inflation
    return conclude(state.problem, state.estimate, state.fit, joint, inflation, state.bias, notes, found.report)


def _likeliest(ways: list[Start], options: SolveOptions) -> Start:
    """The start that leads to the best fit of pictures and references together. Raises SolveError where that is not clear."""
    if len(ways) == 1:
        return ways[0]
    firsts = [next(_rounds(way.problem, way.estimate, options)) for way in ways]
    inflation = min(state.inflation for state in firsts)
    costs = [_cost(state, inflation) + DOUBTED * len(way.doubts) for state, way in zip(firsts, ways, strict=True)]
    best, second = (int(k) for k in np.argsort(costs, kind="stable")[:2])
    if costs[second] - costs[best] < CLEARLY:
        part, other = (" and ".join(ways[k].reading) for k in (best, second))
        raise SolveError(
            f"row {ways[0].problem.frames.facts.name}: only a part of the row was found, and it is not clear whether that is"
            f" {part} or {other}: give only the references of the part that the footage shows"
        )
    return ways[best]


def _cost(state: State, inflation: float) -> float:
    """Half the sum of squared residuals, in standard deviations, of all references and of all observations by Huber's loss."""
    graph = whole_graph(state.problem, state.estimate, state.problem.observations, inflation, HUBER)
    return float(graph.error(values_of(state.problem, state.estimate)))


def _rounds(problem: Problem, estimate: Estimate, options: SolveOptions) -> Iterator[State]:
    """States, the last one being the answer: all observations at first, then those that fitted, freed of their biases."""
    huber = HUBER if options.loss == "huber" else None
    kept: Mask = np.ones(len(problem.observations), dtype=bool)
    bias, weight = np.zeros(len(problem.observations.shared.prior)), 1.0
    row = f"row {problem.frames.facts.name}"
    for number in range(options.rounds):
        freed = problem.without(bias, estimate.poses, estimate.points)
        graph = whole_graph(freed, estimate, freed.observations.take(kept), weight, huber)
        settings = LevenbergMarquardt(
            row, along_aisle(freed, estimate), options.max_iterations, FINE if number else ROUGH
        )
        values = settings.minimum(graph, values_of(freed, estimate))
        estimate = estimate_of(freed, values, estimate)
        freed = problem.without(bias, estimate.poses, estimate.points)
        fit = fit_of(freed, estimate, kept, options.reject_sigma)
        state = State(freed, bias, estimate, fit, persistence(freed, fit))
        weight = state.inflation
        yield state
        huber = None if huber is None else HUBER / float(np.sqrt(state.persistence.weighed))
        step = _bias_step(state, huber) if number + 1 < options.rounds else np.zeros(len(bias))
        if number and (fit.kept != kept).sum() <= SETTLED * len(kept) and not step.any():
            return
        kept, bias = fit.kept, bias + step


def _bias_step(state: State, huber: float | None) -> Floats:
    """What would bring the free biases (k,) to their optimum; zeros where that is near."""
    if not state.problem.observations.shared.free.any():
        return np.zeros(len(state.bias))
    joint = _covariance(state, huber, ())
    near = np.abs(joint.step) <= SETTLED_BIAS * np.sqrt(np.diag(joint.shared))
    return np.zeros(len(state.bias)) if near.all() else joint.step


@dataclass(frozen=True)
class LevenbergMarquardt:
    """GTSAM's, with the order of elimination; errors name the `row`. It ends where a step changes the error by no more than a
    share of it, `change`."""

    row: str
    ordering: gtsam.Ordering
    iterations: int = 50
    change: float = FINE

    def minimum(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.Values:
        """The minimum near some values. Raises SolveError if the graph cannot be solved."""
        settings = gtsam.LevenbergMarquardtParams()
        settings.setMaxIterations(self.iterations)
        settings.setRelativeErrorTol(self.change)
        settings.setOrdering(self.ordering)
        try:
            return gtsam.LevenbergMarquardtOptimizer(graph, values, settings).optimize()
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[0] if str(error).strip() else "no reason given"
            raise SolveError(f"{self.row}: the graph cannot be solved ({reason})") from error


def _covariance(state: State, huber: float | None, only: Collection[int] | None = None) -> Covariance:
    graph = whole_graph(state.problem, state.estimate, state.kept, state.inflation, huber)
    used = state.problem.used.tolist()
    frames, centres = [frame_key(frame) for frame in used], [centre_key(frame) for frame in used]
    values = values_of(state.problem, state.estimate)
    return covariance(graph, values, frames, centres, shared_biases(state, huber), only)


def shared_biases(state: State, huber: float | None) -> Shared:
    """The biases of the kept observations."""
    inflation = state.inflation
    errors = state.fit.errors[state.fit.kept] / np.sqrt(inflation)
    columns = _bias_columns(state.kept, errors, inflation, huber)
    shared = state.problem.observations.shared
    return Shared(columns, state.bias, shared.prior, shared.free)


def _bias_columns(observations: Observations, errors: Floats, inflation: float, huber: float | None) -> csc_array:
    """Derivatives (2n, k) of whitened errors (n, 2) to the biases, weighted as Huber's loss weighs those."""
    whiten = np.swapaxes(np.linalg.cholesky(np.linalg.inv(inflation * observations.covariances)), 1, 2)
    size = np.linalg.norm(errors, axis=1)
    weight = np.ones(len(size)) if huber is None else np.minimum(1.0, huber / np.maximum(size, 1e-9))
    shared = observations.shared
    values = np.sqrt(weight)[:, None, None] * (whiten @ shared.moves)
    rows = np.broadcast_to(np.arange(2 * len(values)).reshape(-1, 2, 1), values.shape)
    columns = np.broadcast_to(shared.which[:, None, :], values.shape)
    shape = (2 * len(values), len(shared.prior))
    return csc_array(coo_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=shape))
