"""Whether all elevations are seen too large by one factor: panoramas that were cropped above and below and stretched to 2:1 again.

Poses and structures absorb most of it, so that residuals stay small. The row is solved once more with the factor as an unknown of the camera, which says how
large it is, and how well it is known.
"""

from dataclasses import replace

import numpy as np

from savmap.errors import SolveError
from savmap.graph.calibration.terms import Calibration, VerticalScale
from savmap.graph.solver.optimise import Iterate, SolveOptions, refined, shared_covariance
from savmap.graph.solver.solution import ElevationError


def elevation_error(iterate: Iterate) -> ElevationError | None:
    """That of a row at its optimum; None where the camera's path is given, its calibration is asked for, or the row cannot be solved with it."""
    problem = iterate.problem
    if problem.camera.fixed is not None or problem.camera.calibration is not None:
        return None
    term = Calibration(vertical=VerticalScale())
    camera = replace(problem.camera, calibration=term)
    asked = replace(problem, camera=camera, measurements=term.with_parameters(problem.measurements))
    try:
        last = refined(asked, iterate.estimate, SolveOptions())
    except SolveError:
        return None
    return ElevationError(float(last.bias[-1]), float(np.sqrt(shared_covariance(last)[-1, -1])))
