"""What is wrong with a row's panoramas: they were cropped above and below and stretched to 2:1 again, or bent at their
seam by lenses that stand apart.

Poses and structures absorb most of it, so that residuals stay small. The row is solved twice more with unknowns of the
camera, which says how large they are, and how well they are known: with the lens distance and a vertical scale, then
with the vertical scale alone, which is known best so.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from savmap.errors import SolveError
from savmap.graph.calibration.bends import largest_displacement, total_baseline
from savmap.graph.calibration.terms import LENS_DISTANCES, VERTICAL, Calibration, LensDistance, VerticalScale
from savmap.graph.solver.optimise import Iterate, SolveOptions, estimated_biases, refined
from savmap.graph.solver.solution import LensDistanceError, VerticalScaleError
from savmap.types import Floats

Result = TypeVar("Result")


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
    """What is wrong with a row's panoramas, from solves that begin at the row's optimum. Nothing is told where the
    camera's path is given, and what cannot be solved is not told."""
    if iterate.problem.camera.fixed is not None:
        return PanoramaErrors()
    own = iterate.problem.camera.calibration or Calibration()
    apart = None if own.lens_distance else _or_none(_lens_distance, iterate, own)
    bent = apart is not None and apart.significant
    return PanoramaErrors(None if own.vertical else _or_none(_vertical_scale, iterate, own, bent), apart)


def _or_none(solve: Callable[..., Result], *arguments: object) -> Result | None:
    try:
        return solve(*arguments)
    except (SolveError, np.linalg.LinAlgError):
        return None


def _vertical_scale(iterate: Iterate, own: Calibration, bent: bool) -> VerticalScaleError:
    """The vertical scale without the lens distance, which makes it less sure; with it in pictures that are `bent`."""
    term = replace(own, vertical=VerticalScale(), lens_distance=LensDistance() if bent else own.lens_distance)
    values, covariance = _estimated(iterate, own, term, (VERTICAL,))
    return VerticalScaleError(float(values[0]), float(np.sqrt(covariance[0, 0])))


def _lens_distance(iterate: Iterate, own: Calibration) -> LensDistanceError:
    """The lens distance beside a vertical scale. Both bend the scene in similar ways."""
    term = replace(own, vertical=own.vertical or VerticalScale(), lens_distance=LensDistance())
    parts, covariance = _estimated(iterate, own, term, LENS_DISTANCES)
    deviation = float(np.sqrt(max(float(parts @ np.linalg.solve(covariance, parts)), 0.0)))
    return LensDistanceError(*total_baseline(parts, covariance), largest_displacement(parts), deviation)


def _estimated(iterate: Iterate, own: Calibration, term: Calibration, names: Sequence[str]) -> tuple[Floats, Floats]:
    """The named parameters (k,) of the calibration `term`, and their covariance (k, k). It takes the place of the row's
    `own` calibration, for which the measurements are corrected already: the parameters of both begin at 0. Raises
    SolveError."""
    problem = iterate.problem
    camera = replace(problem.camera, calibration=term)
    measurements = term.with_parameters(own.without_parameters(problem.measurements))
    initial = np.where([name in own.names for name in term.names], 0.0, term.initial)
    bias = np.concatenate([np.zeros(len(measurements.biases.prior) - len(initial)), initial])
    last = refined(replace(problem, camera=camera, measurements=measurements), iterate.estimate, SolveOptions(), bias)
    values, covariance = estimated_biases(last)
    at = [term.names.index(name) - len(term.names) for name in names]
    return values[at], covariance[np.ix_(at, at)]
