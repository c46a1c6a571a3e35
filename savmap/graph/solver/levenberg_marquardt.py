"""GTSAM's Levenberg-Marquardt, with errors that name the row, and the order in which variables are eliminated.

The order is that of positions along the aisle, so that only neighbours meet. The matrix is a band then, and costs about
half of what a minimum degree order (GTSAM's COLAMD) does on a long row. Variables that many others of the row are bound
to, such as the landmark that defines a common plane, come last.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence

import gtsam
import numpy as np

from savmap.errors import SolveError
from savmap.graph.constraints import factors_in
from savmap.graph.keys import ORIGIN, camera_height_key, centre_key, frame_key, rekey
from savmap.graph.problem import Estimate, Problem

ROUGH, FINE = 1e-4, 1e-6
"""Shares of the error by which a last step may still change it."""
MANY = 30
KeyPosition = tuple[float, int]
"""Position along the aisle, m, and key of a variable."""


def minimum(
    row: str,
    ordering: gtsam.Ordering,
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    iterations: int = 50,
    change: float = FINE,
) -> gtsam.Values:
    """The minimum of a graph near some values. It ends where a step changes the error by no more than a share of it,
    `change`. Raises SolveError, which names the `row`, if the graph cannot be solved."""
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(iterations)
    settings.setRelativeErrorTol(change)
    settings.setOrdering(ordering)
    try:
        return gtsam.LevenbergMarquardtOptimizer(graph, values, settings).optimize()
    except Exception as error:  # GTSAM's are RuntimeErrors; a plugin's factor may raise any
        reason = str(error).strip().splitlines()[0] if str(error).strip() else "no reason given"
        raise SolveError(f"{row}: the graph cannot be solved ({reason})") from error


def aisle_ordering(problem: Problem, estimate: Estimate) -> gtsam.Ordering:
    """The order of the variables of one row."""
    return ordering_of(aisle_positions(problem, estimate, gtsam.Pose3(), 0), hub_keys(problem, 0))


def ordering_of(positions: Sequence[KeyPosition], last: Sequence[int]) -> gtsam.Ordering:
    """Variables by their position, those of `last` at the end."""
    ordering, late = gtsam.Ordering(), set(last)
    for key in (*(key for _, key in sorted(positions) if key not in late), *last):
        ordering.push_back(key)
    return ordering


def aisle_positions(problem: Problem, estimate: Estimate, aisle_from_row: gtsam.Pose3, row: int) -> list[KeyPosition]:
    """Where along the aisle the variables of a row are, with their keys in the graph of several rows."""
    cameras = np.reshape(aisle_from_row.transformFrom(estimate.poses[:, :3, 3].T), (3, -1))[0].tolist()
    points = (
        np.reshape(aisle_from_row.transformFrom(estimate.points.T), (3, -1))[0].tolist() if len(estimate.points) else []
    )
    frames = list(zip(cameras, problem.used.tolist(), strict=True))
    keys = [
        *((x, key) for x, frame in frames for key in (frame_key(frame), centre_key(frame))),
        *zip(points, problem.keys.tolist(), strict=True),
    ]
    variables = _variable_positions(problem, {key: x for x, key in keys})
    return [(x, rekey(key, row)) for x, key in (*keys, *variables)]


def _variable_positions(problem: Problem, x: Mapping[int, float]) -> Iterator[KeyPosition]:
    """Plugins' variables: in the middle of what their factors bind them to."""
    near = defaultdict[int, list[float]](list)
    for part in problem.parts:
        for factor in factors_in(part.factors) if part.variables else ():
            keys = factor.keys()
            for key in (key for key in keys if key in part.variables):
                near[key] += [x[other] for other in keys if other in x]
    for part in problem.parts:
        yield from ((float(np.mean(near[key] or [0.0])), key) for key in part.variables)


def hub_keys(problem: Problem, row: int) -> list[int]:
    """Keys, in the graph of several rows, of variables of a row that many others are bound to."""
    return [rekey(key, row) for key in _hubs(problem)]


def _hubs(problem: Problem) -> Iterator[int]:
    bound = Counter(key for relation in problem.relations for key in relation.keys)
    yield from (key for key, count in bound.items() if count > MANY)
    if problem.camera.fixed is None:
        yield from (camera_height_key(number) for number in range(len(problem.camera.references.camera_heights)))
    yield ORIGIN
