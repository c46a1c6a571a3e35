"""What is wrong with a row's panoramas: they were cropped above and below and stretched to 2:1 again, or bent at their seam by lenses that stand apart.

Poses and structures absorb most of it, so that residuals stay small. The row is solved once more with each as unknowns of the camera, which says how
large they are, and how well they are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import SolveError
from savmap.graph.calibration.bends import BENDS
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
    """What is wrong with a row's panoramas, from solves that begin at the row's optimum. Nothing is told where the camera's path is given, and where
    the row cannot be solved so."""
    own = iterate.problem.camera.calibration or Calibration()
    if iterate.problem.camera.fixed is not None:
        return PanoramaErrors()
    try:
        apart = None if own.lenses else _apart(iterate, own)
        bent = apart is not None and apart.significant
        return PanoramaErrors(None if own.vertical else _stretched(iterate, own, bent), apart)
    except SolveError:
        return PanoramaErrors()


def _stretched(iterate: Iterate, own: Calibration, bent: bool) -> VerticalScaleError:
    """The vertical scale alone, which is known best so; in pictures that are `bent`, beside that."""
    term = replace(own, vertical=VerticalScale(), lenses=LensDistance() if bent else own.lenses)
    values, covariance = _estimated(iterate, own, term, (VERTICAL,))
    return VerticalScaleError(float(values[0]), float(np.sqrt(covariance[0, 0])))


def _apart(iterate: Iterate, own: Calibration) -> LensDistanceError:
    """The vector from the rear lens to the front one is the sum of the bends'. The vertical scale is estimated beside them, for it looks alike."""
    term = replace(own, vertical=own.vertical or VerticalScale(), lenses=LensDistance())
    parts, covariance = _estimated(iterate, own, term, LENSES)
    vectors = np.array([bend.apart(np.eye(3)) for bend in BENDS])
    apart = parts @ vectors
    distance = float(np.linalg.norm(apart))
    towards = vectors @ apart / max(distance, 1e-9)
    deviation = float(np.sqrt(parts @ np.linalg.solve(covariance, parts)))
    return LensDistanceError(distance, float(np.sqrt(towards @ covariance @ towards)), deviation)


def _estimated(iterate: Iterate, own: Calibration, term: Calibration, names: Sequence[str]) -> tuple[Floats, Floats]:
    """The named parameters (k,) of a calibration in place of the row's own one, and their covariance (k, k). Raises SolveError."""
    problem = iterate.problem
    measurements = own.without_parameters(problem.measurements) if own.names else problem.measurements
    camera = replace(problem.camera, calibration=term)
    asked = replace(problem, camera=camera, measurements=term.with_parameters(measurements))
    last = refined(asked, iterate.estimate, SolveOptions())
    at = [term.names.index(name) - len(term.names) for name in names]
    return last.bias[at], shared_covariance(last)[np.ix_(at, at)]
