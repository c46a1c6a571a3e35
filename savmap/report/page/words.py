"""What the page says of a structure under the pointer."""

from collections.abc import Iterator, Mapping

import numpy as np

from savmap.evaluation import Score
from savmap.report.page.numbers import centimetres, fixed
from savmap.types import Measured, RowMap, Structure

_SIGMA, _METRES = "_sigma_m", "_m"


def measures(structure: Structure) -> Iterator[tuple[str, float, float]]:
    """Sizes among its attributes with their standard deviations: name, m, m. A size is `Measured`, or "width_m" goes with
    "width_sigma_m"."""
    for key, sigma in structure.attributes.items():
        if key.endswith(_METRES) and isinstance(sigma, Measured):
            yield key.removesuffix(_METRES).replace("_", " "), sigma.value, sigma.sigma
        value = structure.attributes.get(key.removesuffix(_SIGMA) + _METRES)
        if key.endswith(_SIGMA) and isinstance(sigma, float | int) and isinstance(value, float | int):
            yield key.removesuffix(_SIGMA).replace("_", " "), float(value), float(sigma)


def sigmas(structure: Structure) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Standard deviations of its vertices (n, 3), m."""
    variances = np.diagonal(structure.covariances, axis1=1, axis2=2)
    return np.sqrt(np.maximum(variances, 0.0))


def said_of(row: RowMap, score: Score | None) -> Mapping[str, str]:
    """By structure id: its sizes and standard deviations, and how far it is off the survey."""
    off = score.deviations if score else {}
    return {own.id: _said(own, off.get(own.id)) for every in row.structures.values() for own in every}


def _said(own: Structure, off_m: float | None) -> str:
    sizes = [f"{name} {fixed(value, 3)} \u00b1 {fixed(sigma, 3)} m" for name, value, sigma in measures(own)]
    largest = sigmas(own).max(axis=0, initial=0.0)
    spread = (
        "vertices \u03c3 up to "
        + ", ".join(f"{axis} {fixed(value, 3)}" for axis, value in zip("xyz", largest, strict=True))
        + " m"
    )
    survey = (
        []
        if off_m is None
        else ["not in the survey" if np.isinf(off_m) else f"off the survey by {centimetres(off_m)} cm"]
    )
    return f"{own.id}: " + "; ".join([*sizes, spread, *survey])
