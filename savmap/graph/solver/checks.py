"""Checks of a solved row at its optimum: what is wrong with its panoramas.

Panoramas that were cropped above and below and stretched to 2:1 again, or bent at their seam by lenses that stand
apart: poses and structures absorb most of it, so that residuals stay small. Unknowns of the camera beside the row's say
how large they are, and how well they are known: the lens distance and a vertical scale, then the vertical scale only,
which is known best so.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import SolveError
from savmap.graph.calibration import LENS_DISTANCES, VERTICAL, Calibration, largest_displacement, total_baseline
from savmap.graph.problem import Problem
from savmap.graph.solver.optimise import Iterate, SolveOptions, estimated_biases, refined, stepped
from savmap.graph.solver.solution import LensDistanceError, Solution, VerticalScaleError
from savmap.types import Floats
from savmap.types.calibration import LensDistance, VerticalScale

LIKELY = 3.0
"""Standard deviations from 0 from which on a step's figure is not good enough to be told."""


def checked(solution: Solution, iterate: Iterate) -> Solution:
    """A row's solution with what is wrong with its panoramas, at the optimum that the row has by itself."""
    vertical, lenses = _panorama_errors(iterate)
    entries = {name: value for error in (vertical, lenses) if error for name, value in error.report.items()}
    report = {**solution.report, **entries}
    return replace(solution, vertical_scale=vertical, lens_distance=lenses, report=report)


def _panorama_errors(iterate: Iterate) -> tuple[VerticalScaleError | None, LensDistanceError | None]:
    """What is wrong with a row's panoramas. None for what the camera's given path or the row's calibration leaves
    nothing to ask of, and for what cannot be solved."""
    given = iterate.problem.camera.calibration or Calibration()
    if iterate.problem.camera.fixed is not None or (given.vertical and given.lens_distance):
        return None, None
    try:
        return _errors_beside(iterate, given)
    except (SolveError, np.linalg.LinAlgError):
        return None, None


def _errors_beside(iterate: Iterate, given: Calibration) -> tuple[VerticalScaleError | None, LensDistanceError | None]:
    """What the `given` calibration leaves open: by two steps from the row's optimum, and by a solve with what these
    find `LIKELY`. Both bend the scene in similar ways: the lens distance is found beside the vertical scale, but that
    without the lens distance, which makes it less sure, unless the pictures are bent."""
    vertical, lenses = given.vertical or VerticalScale(), given.lens_distance or LensDistance()
    both, distance = replace(given, vertical=vertical, lens_distance=lenses), None
    asked = _Asked(iterate, given)
    estimates = asked.estimated(both)
    if not given.lens_distance:
        if estimates.deviation(LENS_DISTANCES) > LIKELY:
            estimates = asked.solved(both)
        parts, covariance = estimates.of(LENS_DISTANCES)
        sum_m, sigma_m = total_baseline(parts, covariance)
        distance = LensDistanceError(sum_m, sigma_m, largest_displacement(parts), estimates.deviation(LENS_DISTANCES))
    if given.vertical:
        return None, distance
    if distance and not distance.significant:
        estimates = estimates.without(LENS_DISTANCES)
    if estimates.deviation((VERTICAL,)) > LIKELY and not (distance and distance.significant):
        estimates = asked.solved(replace(both, lens_distance=given.lens_distance))
    share, covariance = estimates.of((VERTICAL,))
    return VerticalScaleError(float(share[0]), float(np.sqrt(covariance[0, 0]))), distance


@dataclass(frozen=True, eq=False)
class _Found:
    """Parameters `names` with values (k,) and covariance (k, k)."""

    names: Sequence[str]
    values: Floats
    covariance: Floats

    def of(self, names: Sequence[str]) -> tuple[Floats, Floats]:
        """The values and the covariance of some of them."""
        at = [self.names.index(name) for name in names]
        return self.values[at], self.covariance[np.ix_(at, at)]

    def deviation(self, names: Sequence[str]) -> float:
        """The Mahalanobis distance of some of them from 0."""
        values, covariance = self.of(names)
        return float(np.sqrt(max(float(values @ np.linalg.solve(covariance, values)), 0.0)))

    def without(self, names: Sequence[str]) -> "_Found":
        """The others, where these are 0."""
        at = [self.names.index(name) for name in names]
        rest = [number for number in range(len(self.names)) if number not in at]
        follow = np.linalg.solve(self.covariance[np.ix_(at, at)], self.covariance[np.ix_(at, rest)]).T
        covariance = self.covariance[np.ix_(rest, rest)] - follow @ self.covariance[np.ix_(at, rest)]
        return _Found([self.names[k] for k in rest], self.values[rest] - follow @ self.values[at], covariance)


@dataclass(frozen=True, eq=False)
class _Asked:
    """A row at its optimum, whose measurements are corrected for the `given` calibration already: the parameters of a
    term in its place begin at 0."""

    iterate: Iterate
    given: Calibration

    def estimated(self, term: Calibration) -> _Found:
        """The parameters of a term by a step from the row's optimum, and one from there with the weights that the
        measurements have then: errors that a parameter explains make all of them look worse."""
        problem, estimate = self._with(term), self.iterate.estimate
        bias = np.zeros(len(problem.measurements.biases.prior))
        corrected = problem.without(bias, estimate.poses, estimate.points)
        return self._found(term, stepped(problem, replace(self.iterate, problem=corrected, bias=bias)))

    def solved(self, term: Calibration) -> _Found:
        """The parameters of a term by a solve."""
        problem = self._with(term)
        initial = np.where([name in self.given.names for name in term.names], 0.0, term.initial)
        bias = np.zeros(len(problem.measurements.biases.prior))
        bias[len(bias) - len(initial) :] = initial
        return self._found(term, refined(problem, self.iterate.estimate, SolveOptions(), bias))

    def _with(self, term: Calibration) -> Problem:
        problem = self.iterate.problem
        measurements = term.with_parameters(self.given.without_parameters(problem.measurements))
        return replace(problem, camera=replace(problem.camera, calibration=term), measurements=measurements)

    @staticmethod
    def _found(term: Calibration, iterate: Iterate) -> _Found:
        values, covariance = estimated_biases(iterate)
        count = len(term.names)
        return _Found(term.names, values[-count:], covariance[-count:, -count:])
