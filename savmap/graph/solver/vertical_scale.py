"""The vertical scale of a row's panoramas: it is not 1 where they were cropped above and below and stretched to 2:1 again.

Poses and structures absorb most of it, so that residuals stay small. The row is solved once more with the factor as an unknown of the camera, which says how
large it is, and how well it is known.
"""

from dataclasses import replace

import numpy as np

from savmap.errors import SolveError
from savmap.graph.calibration.terms import Calibration, VerticalScale
from savmap.graph.solver.optimise import Iterate, SolveOptions, refined, shared_covariance
from savmap.graph.solver.solution import VerticalScaleError


def vertical_scale_error(iterate: Iterate) -> VerticalScaleError | None:
    """The share by which a row's panoramas show all elevations too large, from a solve that begins at the row's optimum.

    None where the camera's path is given, where its calibration is estimated anyway, and where the row cannot be solved so.
    """
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
    return VerticalScaleError(float(last.bias[-1]), float(np.sqrt(shared_covariance(last)[-1, -1])))
