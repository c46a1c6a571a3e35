"""GTSAM's Levenberg-Marquardt, with errors that name the row."""

from dataclasses import dataclass

import gtsam

from savmap.errors import SolveError

ROUGH, FINE = 1e-4, 1e-6
"""Shares of the error by which a last step may still change it."""


@dataclass(frozen=True)
class LevenbergMarquardt:
    """GTSAM's, with the order of elimination; errors name the `row`. It ends where a step changes the error by no more
    than a share of it, `change`."""

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
        except Exception as error:  # GTSAM's own are RuntimeErrors; a plugin's factor may raise any
            reason = str(error).strip().splitlines()[0] if str(error).strip() else "no reason given"
            raise SolveError(f"{self.row}: the graph cannot be solved ({reason})") from error
