"""What is wrong with a row's panoramas: they were cropped above and below and stretched to 2:1 again, or bent at their seam by lenses that stand apart.

Poses and structures absorb most of it, so that residuals stay small. The row is solved once more with both as unknowns of the camera, which says how
large they are, and how well they are known.
"""

from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import SolveError
from savmap.graph.calibration.terms import LENSES, VERTICAL, Calibration, LensDistance, VerticalScale
from savmap.graph.solver.optimise import Iterate, SolveOptions, refined, shared_covariance
from savmap.graph.solver.solution import LensDistanceError, VerticalScaleError
from savmap.types import Floats


@dataclass(frozen=True)
class PanoramaErrors:
    """What is wrong with a row's panoramas; None for what was not asked, for the row's own calibration estimates it."""

    vertical_scale: VerticalScaleError | None = None
    lens_distance: LensDistanceError | None = None

    @property
    def report(self) -> dict[str, float]:
        """Its entries in the row's report."""
        known = (self.vertical_scale, self.lens_distance)
        return {name: value for error in known if error is not None for name, value in error.report.items()}


def panorama_errors(iterate: Iterate) -> PanoramaErrors:
    """What is wrong with a row's panoramas, from a solve that begins at the row's optimum. Nothing is told where the camera's path is given, and where
    the row cannot be solved so."""
    problem = iterate.problem
    own = problem.camera.calibration
    term = replace(own or Calibration(), vertical=VerticalScale(), lenses=LensDistance())
    if problem.camera.fixed is not None or (own is not None and own.names == term.names):
        return PanoramaErrors()
    measurements = own.without_parameters(problem.measurements) if own else problem.measurements
    camera = replace(problem.camera, calibration=term)
    asked = replace(problem, camera=camera, measurements=term.with_parameters(measurements))
    try:
        last = refined(asked, iterate.estimate, SolveOptions())
    except SolveError:
        return PanoramaErrors()
    count = len(term.names)
    values, covariance = last.bias[-count:], shared_covariance(last)[-count:, -count:]
    vertical, lenses = [term.names.index(VERTICAL)], [term.names.index(name) for name in LENSES]
    return PanoramaErrors(
        None if own and own.vertical else _stretched(values[vertical], covariance[np.ix_(vertical, vertical)]),
        None if own and own.lenses else _apart(values[lenses], covariance[np.ix_(lenses, lenses)]),
    )


def _stretched(value: Floats, covariance: Floats) -> VerticalScaleError:
    return VerticalScaleError(float(value[0]), float(np.sqrt(covariance[0, 0])))


def _apart(parts: Floats, covariance: Floats) -> LensDistanceError:
    deviation = float(np.sqrt(parts @ np.linalg.solve(covariance, parts)))
    return LensDistanceError(float(parts.sum()), float(np.sqrt(covariance.sum())), deviation)
