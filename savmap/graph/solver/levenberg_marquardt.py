"""Levenberg-Marquardt, with errors that name the row."""

import gtsam
import numpy as np

from savmap.errors import SolveError
from savmap.graph.factors.projections import Graph
from savmap.graph.normal_equations import Equations, Layout, Reduced

ROUGH, FINE = 1e-4, 1e-6
"""Shares of the error by which a last step may still change it."""
LEAST_CHANGE = 1e-5
FIRST_DAMPING, TIMES, MOST_DAMPING = 1e-5, 10.0, 1e5


def minimum(
    row: str,
    graph: Graph,
    values: gtsam.Values,
    iterations: int = 50,
    change: float = FINE,
    near: Reduced | None = None,
) -> gtsam.Values:
    """The minimum of a graph near some values. It ends where a step changes the error by no more than a share of it,
    `change`. An elimination of normal equations `near` these, if there is one, serves as long as it can. Raises
    SolveError, which names the `row`, if the graph cannot be solved."""
    try:
        return _minimum(graph, values, iterations, change, near)
    except Exception as error:  # GTSAM's are RuntimeErrors; a plugin's factor may raise any
        reason = str(error).strip().splitlines()[0] if str(error).strip() else "no reason given"
        raise SolveError(f"{row}: the graph cannot be solved ({reason})") from error


def _minimum(graph: Graph, values: gtsam.Values, iterations: int, change: float, near: Reduced | None) -> gtsam.Values:
    layout = Layout.of(values)
    damping, error, equations = FIRST_DAMPING, graph.error(values), Equations.of(graph, values, layout)
    while iterations and damping <= MOST_DAMPING:
        least, after = max(LEAST_CHANGE, change * error), np.inf
        try:
            step = equations.step(near, damping) if near else None
            if step is None:
                near = equations.reduced(damping)
                step = near.solve(equations.right)
            moved = layout.moved(values, step)
            after = graph.error(moved)
        except SolveError:
            near = None
        if not after < error + least:
            damping *= TIMES
        elif error - after <= least:
            return moved if after < error else values
        else:
            values, error, damping, iterations = moved, after, damping / TIMES, iterations - 1
            equations = Equations.of(graph, values, layout)
    return values
