"""Standard deviations over the whole site: of the sizes that structures tell, else of their vertices."""

from collections.abc import Sequence

import numpy as np

from savmap.report.page.numbers import centimetres
from savmap.report.page.summary import Summary
from savmap.report.page.tables import Cell, Line, Table, heads, number
from savmap.report.page.words import measures, sigmas
from savmap.types import Structure

_FIRST_M, _LAST_M, _BINS = 1e-4, 1.0, 32


def spread_table(rows: Sequence[Summary]) -> Table:
    """By label and what is measured: how many, median, 95th percentile, largest, and a histogram on a logarithmic scale."""
    found: dict[str, list[float]] = {}
    for row in rows:
        for every in row.row.structures.values() if row.row else ():
            for own in every:
                for name, sigma in _sigmas(own):
                    found.setdefault(name, []).append(sigma)
    names = ("what", "'0.1 mm to 1 m, logarithmic", "count", "median, cm", "95 %, cm", "largest, cm")
    lines = tuple(_line(name, np.array(values)) for name, values in found.items())
    return Table("sigmas", "Standard deviations", heads(*names), lines)


def histogram(values_m: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, ...]:
    """Heights (0..1) of bins evenly spaced in the logarithm; what is outside goes into the outermost."""
    edges = np.geomspace(_FIRST_M, _LAST_M, _BINS + 1)
    counts, _ = np.histogram(np.clip(values_m, _FIRST_M, _LAST_M), edges)
    return tuple(float(count) for count in np.round(counts / max(1, counts.max()), 3))


def _sigmas(own: Structure) -> list[tuple[str, float]]:
    sizes = [(f"{own.label}: {name}", sigma) for name, _, sigma in measures(own)]
    if sizes:
        return sizes
    return [
        (f"{own.label}: {axis} of a vertex", float(v))
        for vertex in sigmas(own)
        for axis, v in zip("xyz", vertex, strict=True)
    ]


def _line(name: str, values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Line:
    median, high = (float(value) for value in np.percentile(values, [50, 95]))
    figures = [number(value, centimetres(value)) for value in (median, high, float(values.max()))]
    return Line(
        (Cell(name), Cell("", median, heights=histogram(values)), number(len(values), str(len(values))), *figures)
    )
