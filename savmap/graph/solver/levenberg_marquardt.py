"""Levenberg-Marquardt by GTSAM's elimination, with errors that name the row.

GTSAM's own optimizer moves a frame that turns along an arc, where this one goes straight. Both find one optimum, but a
solve ends before it, as soon as a step hardly changes the error.
"""

import gtsam
import numpy as np

from savmap.errors import SolveError
from savmap.graph.normal_equations import Layout

ROUGH, FINE = 1e-4, 1e-6
"""Shares of the error by which a last step may still change it."""
LEAST_CHANGE = 1e-5
FIRST_DAMPING, TIMES, MOST_DAMPING = 1e-5, 10.0, 1e5


def minimum(
    row: str, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, iterations: int = 50, change: float = FINE
) -> gtsam.Values:
    """The minimum of a graph near some values. It ends where a step changes the error by no more than a share of it,
    `change`. Raises SolveError, which names the `row`, if the graph cannot be solved."""
    try:
        return _minimum(graph, values, iterations, change)
    except Exception as error:  # GTSAM's are RuntimeErrors; a plugin's factor may raise any
        reason = str(error).strip().splitlines()[0] if str(error).strip() else "no reason given"
        raise SolveError(f"{row}: the graph cannot be solved ({reason})") from error


def _minimum(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, iterations: int, change: float) -> gtsam.Values:
    layout, damping, error, linear = Layout.of(values), FIRST_DAMPING, graph.error(values), graph.linearize(values)
    ordering = gtsam.Ordering.ColamdGaussianFactorGraph(linear)
    while iterations and damping <= MOST_DAMPING:
        least, after = max(LEAST_CHANGE, change * error), np.inf
        damped = linear.clone()
        damped.push_back(layout.damping(damping))
        try:
            moved = layout.moved(values, damped.optimize(ordering))
            after = graph.error(moved)
        except RuntimeError:  # undetermined: as with more damping
            pass
        if not after < error + least:
            damping *= TIMES
        elif error - after <= least:
            return moved if after < error else values
        else:
            values, error, damping, iterations = moved, after, damping / TIMES, iterations - 1
            linear = graph.linearize(values)
    return values
