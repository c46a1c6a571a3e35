"""Repeatability: the landmarks by either half of the frames alone, every other one, of every view.

The halves share references, first attitudes and the choice of measurements, but no picture: where they differ by more
than their uncertainty, measurements of one thing were taken for another's, or the uncertainty is wrong.
"""

from dataclasses import dataclass

import numpy as np

from savmap.graph.factors.problem_factors import estimate_of, values_of, whole_graph
from savmap.graph.problem import Estimate, Problem
from savmap.graph.solver.elimination import aisle_ordering
from savmap.graph.solver.levenberg_marquardt import ROUGH, LevenbergMarquardt
from savmap.types import Bools, Floats, Ints

LEAST_FRAMES, LEAST_SEEN = 12, 4


@dataclass(frozen=True, eq=False)
class HalfDifference:
    """A landmark's position by the second, fourth ... frames less that by the first, third ... ones (3,), m."""

    plugin: str
    name: str
    difference: Floats


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
    odd = odd_frames(problem.used, _sparsest(problem))[problem.at_frame]
    halves = [kept & odd, kept & ~odd]
    points = [_points(problem, estimate, half, inflation, huber) for half in halves]
    often = np.logical_and(*(_frames_seen(problem, half) >= LEAST_SEEN for half in halves))
    return tuple(
        HalfDifference(*problem.name_of(int(problem.keys[index])), points[0][index] - points[1][index])
        for index in np.flatnonzero(often)
    )


def odd_frames(used: Ints, every: int) -> Bools:
    """Which of the frames (f,) are of the one half: every other one of the view that is rendered from multiples of
    `every` only, with the frames up to its next. A frame is in one half with all its views, or what one of them shows
    would have no pose there."""
    _, number = np.unique(used // every, return_inverse=True)
    return np.asarray(number % 2 == 1)


def _sparsest(problem: Problem) -> int:
    """`ViewSpec.every` of the view with measurements that is rendered least often."""
    views = problem.measurements.views
    return max(views[int(index)].every for index in np.unique(problem.measurements.view).tolist())


def _points(problem: Problem, estimate: Estimate, chosen: Bools, inflation: Floats, huber: Floats) -> Floats:
    """The landmarks (m, 3) by some of the measurements. Frames without any stay near their neighbours."""
    measurements = problem.measurements.inflated(inflation).take(chosen)
    graph = whole_graph(problem, estimate, measurements, huber[chosen])
    row = f"row {problem.camera.facts.name}"
    solver = LevenbergMarquardt(row, aisle_ordering(problem, estimate), change=ROUGH)
    values = solver.minimum(graph, values_of(problem, estimate))
    return estimate_of(problem, values, estimate).points


def _frames_seen(problem: Problem, chosen: Bools) -> Ints:
    """In how many frames (m,) each landmark was measured."""
    pairs = np.unique(np.stack([problem.at_key[chosen], problem.at_frame[chosen]]), axis=1)
    return np.bincount(pairs[0], minlength=len(problem.keys))
