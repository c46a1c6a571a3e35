"""Standard deviations: in the hint of a structure, and over the whole site."""

from collections.abc import Mapping, Sequence

import numpy as np

from savmap.report.numbers import centimetres, fixed
from savmap.report.page.summary import Summary
from savmap.report.page.tables import Cell, Line, Table, centimetre_cell, count_cell, heads
from savmap.types import Floats, Structure

_FIRST_M, _LAST_M, _BINS = 1e-4, 1.0, 32


def hints(row: Summary) -> Mapping[str, str]:
    """By structure id: its sizes and standard deviations, and how far it is off the survey."""
    deviations = row.score.deviations if row.score else {}
    structures = (structure for group in row.row.structures.values() for structure in group) if row.row else ()
    return {structure.id: _hint(structure, deviations.get(structure.id)) for structure in structures}


def sigma_table(rows: Sequence[Summary]) -> Table:
    """By label and what is measured (sizes; vertices where a structure has none): how many, median, 95th percentile, largest, and a
    histogram on a logarithmic scale."""
    by_name: dict[str, list[float]] = {}
    for row in rows:
        for structures in row.row.structures.values() if row.row else ():
            for structure in structures:
                for name, sigma in _named_sigmas(structure):
                    by_name.setdefault(name, []).append(sigma)
    names = ("what", "'0.1 mm to 1 m, logarithmic", "count", "median, cm", "95 %, cm", "largest, cm")
    lines = tuple(_line(name, np.array(values)) for name, values in by_name.items())
    return Table("sigmas", "Standard deviations", heads(*names), lines)


def histogram(values_m: Floats) -> tuple[float, ...]:
    """Heights (0..1) of bins evenly spaced in the logarithm; what is outside goes into the outermost."""
    edges = np.geomspace(_FIRST_M, _LAST_M, _BINS + 1)
    counts, _ = np.histogram(np.clip(values_m, _FIRST_M, _LAST_M), edges)
    return tuple(float(count) for count in np.round(counts / max(1, counts.max()), 3))


def _vertex_sigmas(structure: Structure) -> Floats:
    """Standard deviations of its vertices (n, 3), m."""
    variances = np.diagonal(structure.covariances, axis1=1, axis2=2)
    return np.sqrt(np.maximum(variances, 0.0))


def _hint(structure: Structure, off_m: float | None) -> str:
    sizes = [f"{name} {fixed(value, 3)} \u00b1 {fixed(sigma, 3)} m" for name, value, sigma in structure.sizes()]
    largest = _vertex_sigmas(structure).max(axis=0, initial=0.0)
    axes = ", ".join(f"{axis} {fixed(value, 3)}" for axis, value in zip("xyz", largest, strict=True))
    words = [*sizes, f"vertices \u03c3 up to {axes} m"]
    if off_m is not None:
        words += ["not in the survey" if np.isinf(off_m) else f"off the survey by {centimetres(off_m)} cm"]
    return f"{structure.id}: {'; '.join(words)}"


def _named_sigmas(structure: Structure) -> list[tuple[str, float]]:
    sizes = [(f"{structure.label}: {name}", sigma) for name, _, sigma in structure.sizes()]
    return sizes or [
        (f"{structure.label}: {axis} of a vertex", float(sigma))
        for vertex in _vertex_sigmas(structure)
        for axis, sigma in zip("xyz", vertex, strict=True)
    ]


def _line(name: str, values_m: Floats) -> Line:
    median, high = (float(value) for value in np.percentile(values_m, [50, 95]))
    chart = Cell("", median, heights=histogram(values_m))
    figures = map(centimetre_cell, (median, high, float(values_m.max())))
    return Line((Cell(name), chart, count_cell(len(values_m)), *figures))
