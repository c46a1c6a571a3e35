"""The calibration terms' values, for the map's report and for the user."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from savmap.graph.calibration.bends import total_baseline
from savmap.graph.calibration.terms import LENS_DISTANCES, SHUTTER, TURNS, Calibration
from savmap.graph.covariance import Covariance
from savmap.types import Floats

VAGUE = 0.5
"""A parameter is hardly observable where its sigma is more than this share of its prior's."""


@dataclass(frozen=True)
class CalibrationReport:
    """Figures for the report, and lines for the user."""

    report: Mapping[str, float | str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def calibration_report(
    term: Calibration | None, bias: Floats, covariance: Covariance, before: float, after: float
) -> CalibrationReport:
    """Values with sigmas of the parameters, which are the last of `bias` (k,), and the residuals' scale without them
    (`before`) and with them. With the lens distance, the scale without it is not known: the solve begins with one."""
    if term is None:
        return CalibrationReport()
    count = len(term.names)
    sigmas = np.sqrt(np.diag(covariance.shared))[-count:]
    report: dict[str, float | str] = {}
    lines_of_terms, vague = list[str](), list[str]()
    for name, value, sigma, prior in zip(term.names, bias[-count:], sigmas, term.prior, strict=True):
        unit, size = _unit(name)
        report[f"calibration {name}, {unit}"] = float(value * size)
        report[f"calibration {name}, sigma {unit}"] = float(sigma * size)
        lines_of_terms.append(f"{name} {value * size:+.2f} +- {sigma * size:.2f} {unit}")
        vague += [name] if sigma > VAGUE * prior else []
    scales = f"{after:.2f} with it"
    if term.lens_distance:
        at = [term.names.index(name) - count for name in LENS_DISTANCES]
        distance, sigma = total_baseline(bias[at], covariance.shared[np.ix_(at, at)])
        report |= {"calibration lens distance, cm": 100 * distance, "calibration lens distance, sigma cm": 100 * sigma}
    else:
        report["residual_scale_uncalibrated"] = before
        scales = f"{before:.2f} without, {scales}"
    lines = [f"calibration: {', '.join(lines_of_terms)}; residuals' scale {scales}"]
    if vague:
        lines.append(f"calibration: this footage hardly tells {', '.join(vague)}")
    return CalibrationReport(report, tuple(lines))


def _unit(name: str) -> tuple[str, float]:
    """Unit of a parameter in reports, and how many there are to a radian, a whole, a metre, or a second."""
    if name in TURNS:
        return "deg", float(np.degrees(1.0))
    if name in LENS_DISTANCES:
        return "cm", 1e2
    return ("ms", 1e3) if name == SHUTTER else ("percent", 1e2)
