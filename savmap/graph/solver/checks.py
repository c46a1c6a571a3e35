"""Checks of a solved row by solving it again: how its landmarks repeat, and what is wrong with its panoramas.

Repeatability: the landmarks by either half of the frames, every other one, of every view. The halves share references,
first attitudes and the choice of measurements, but no picture: where they differ by more than their uncertainty,
measurements of one thing were taken for another's, or the uncertainty is wrong.

Panoramas that were cropped above and below and stretched to 2:1 again, or bent at their seam by lenses that stand
apart: poses and structures absorb most of it, so that residuals stay small. The row is solved twice more with unknowns
of the camera, which says how large they are, and how well they are known: with the lens distance and a vertical scale,
then with the vertical scale only, which is known best so.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from savmap.errors import SolveError
from savmap.graph.calibration import (
    LENS_DISTANCES,
    VERTICAL,
    Calibration,
    LensDistance,
    VerticalScale,
    largest_displacement,
    total_baseline,
)
from savmap.graph.factors.problem_factors import estimate_of, values_of, whole_graph
from savmap.graph.problem import Estimate, Problem
from savmap.graph.solver.levenberg_marquardt import ROUGH, aisle_ordering, minimum
from savmap.graph.solver.optimise import Iterate, SolveOptions, estimated_biases, refined
from savmap.graph.solver.solution import HalfDifference, LensDistanceError, Solution, VerticalScaleError
from savmap.types import Bools, Floats, Ints

LEAST_FRAMES, LEAST_SEEN = 12, 4
Result = TypeVar("Result")


def checked(solution: Solution, iterate: Iterate) -> Solution:
    """A row's solution with how its landmarks repeat in either half of the frames, and what is wrong with its
    panoramas, at the optimum that the row has by itself. Raises SolveError where a half cannot be solved."""
    halves = half_differences(iterate.problem, iterate.estimate, iterate.fit.kept, iterate.inflation, iterate.huber)
    vertical, lenses = _panorama_errors(iterate)
    entries = {name: value for error in (vertical, lenses) if error for name, value in error.report.items()}
    report = {**solution.report, **entries}
    return replace(solution, halves=halves, vertical_scale=vertical, lens_distance=lenses, report=report)


def half_differences(
    problem: Problem, estimate: Estimate, kept: Bools, inflation: Floats, huber: Floats
) -> tuple[HalfDifference, ...]:
    """Of the landmarks that were seen in `LEAST_SEEN` frames of either half; none where there are few frames or the
    camera's path is given.

    From the optimum `estimate` of all measurements that are `kept` (n,), whose variances are `inflation` (n,) times as
    large as given, with Huber's loss `huber` (n,). Raises SolveError where a half cannot be solved.
    """
    if problem.camera.fixed is not None or len(problem.used) < LEAST_FRAMES:
        return ()
    views = problem.measurements.views
    sparsest = max(views[index].every for index in np.unique(problem.measurements.view).tolist())
    odd = odd_frames(problem.used, sparsest)[problem.at_frame]
    halves = [kept & odd, kept & ~odd]
    points = [_points(problem, estimate, half, inflation, huber) for half in halves]
    often = np.logical_and(*(_frames_seen(problem, half) >= LEAST_SEEN for half in halves))
    return tuple(
        HalfDifference(*problem.name_of(int(problem.keys[index])), points[0][index] - points[1][index])
        for index in np.flatnonzero(often)
    )


def odd_frames(used: Ints, every: int) -> Bools:
    """Which of the frames (f,) are of the second half: every other one of the view that is rendered from multiples of
    `every` only, with the frames up to its next. A frame is in one half with all its views."""
    _, number = np.unique(used // every, return_inverse=True)
    return np.asarray(number % 2 == 1)


def _points(problem: Problem, estimate: Estimate, chosen: Bools, inflation: Floats, huber: Floats) -> Floats:
    """The landmarks (m, 3) by some of the measurements. Frames without any stay near their neighbours."""
    measurements = problem.measurements.inflated(inflation).take(chosen)
    graph = whole_graph(problem, estimate, measurements, huber[chosen])
    row = f"row {problem.camera.facts.name}"
    order, begin = aisle_ordering(problem, estimate), values_of(problem, estimate)
    values = minimum(row, order, graph, begin, change=ROUGH)
    return estimate_of(problem, values, estimate).points


def _frames_seen(problem: Problem, chosen: Bools) -> Ints:
    """In how many frames (m,) each landmark was measured."""
    pairs = np.unique(np.stack([problem.at_key[chosen], problem.at_frame[chosen]]), axis=1)
    return np.bincount(pairs[0], minlength=len(problem.keys))


def _panorama_errors(iterate: Iterate) -> tuple[VerticalScaleError | None, LensDistanceError | None]:
    """What is wrong with a row's panoramas, from solves that begin at the row's optimum. None for what the camera's
    given path or the row's calibration leaves nothing to ask of, and for what cannot be solved."""
    if iterate.problem.camera.fixed is not None:
        return None, None
    given = iterate.problem.camera.calibration or Calibration()
    distance = None if given.lens_distance else _or_none(_lens_distance, iterate, given)
    bent = distance is not None and distance.significant
    return None if given.vertical else _or_none(_vertical_scale, iterate, given, bent), distance


def _or_none(solve: Callable[..., Result], *arguments: object) -> Result | None:
    try:
        return solve(*arguments)
    except (SolveError, np.linalg.LinAlgError):
        return None


def _vertical_scale(iterate: Iterate, given: Calibration, bent: bool) -> VerticalScaleError:
    """The vertical scale without the lens distance, which makes it less sure; with it in pictures that are `bent`."""
    term = replace(given, vertical=VerticalScale(), lens_distance=LensDistance() if bent else given.lens_distance)
    values, covariance = _estimated(iterate, given, term, (VERTICAL,))
    return VerticalScaleError(float(values[0]), float(np.sqrt(covariance[0, 0])))


def _lens_distance(iterate: Iterate, given: Calibration) -> LensDistanceError:
    """The lens distance beside a vertical scale. Both bend the scene in similar ways."""
    term = replace(given, vertical=given.vertical or VerticalScale(), lens_distance=LensDistance())
    parts, covariance = _estimated(iterate, given, term, LENS_DISTANCES)
    deviation = float(np.sqrt(max(float(parts @ np.linalg.solve(covariance, parts)), 0.0)))
    return LensDistanceError(*total_baseline(parts, covariance), largest_displacement(parts), deviation)


def _estimated(iterate: Iterate, given: Calibration, term: Calibration, names: Sequence[str]) -> tuple[Floats, Floats]:
    """The named parameters (k,) of the calibration `term`, and their covariance (k, k). It replaces the `given` one,
    for which the measurements are corrected already: the parameters of both begin at 0."""
    problem = iterate.problem
    camera = replace(problem.camera, calibration=term)
    measurements = term.with_parameters(given.without_parameters(problem.measurements))
    initial = np.where([name in given.names for name in term.names], 0.0, term.initial)
    bias = np.concatenate([np.zeros(len(measurements.biases.prior) - len(initial)), initial])
    last = refined(replace(problem, camera=camera, measurements=measurements), iterate.estimate, SolveOptions(), bias)
    values, covariance = estimated_biases(last)
    at = [term.names.index(name) - len(term.names) for name in names]
    return values[at], covariance[np.ix_(at, at)]
