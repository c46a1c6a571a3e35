"""Standard deviations of what was measured: in the hint of a structure, and over the whole site."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from savmap.report.numbers import centimetres, fixed
from savmap.report.page.summary import Summary
from savmap.report.page.tables import Cell, Line, Table, centimetre_cells, count_cell, heads
from savmap.types import Bools, Floats, Structure

SIZE_AXES = {"width": 0, "height": 1, "depth": 2}
"""Along which axis a size is, by the last word of its name."""
_FIRST_M, _LAST_M, _BINS = 1e-4, 1.0, 32


def hints(row: Summary) -> Mapping[str, str]:
    """By structure id: its sizes and standard deviations, and how far it is off the survey."""
    deviations = row.score.deviations if row.score else {}
    return {
        structure.id: _hint(structure, assumed, deviations.get(structure.id)) for structure, assumed in _structures(row)
    }


def sigma_table(rows: Sequence[Summary]) -> Table:
    """By label and what is measured (sizes; vertices where a structure has none): how many, median, 95th percentile,
    largest, and a histogram on a logarithmic scale. What is assumed was not measured: it is counted and left out of all
    of them."""
    by_name: dict[str, list[float]] = {}
    left_out = 0
    for row in rows:
        for structure, assumed in _structures(row):
            left_out += int(assumed.any(axis=1).sum())
            for name, sigma in _named_sigmas(structure, assumed):
                by_name.setdefault(name, []).append(sigma)
    names = ("what", "'0.1 mm to 1 m, logarithmic", "count", "median, cm", "95 %, cm", "largest, cm")
    lines = []
    for name, values in by_name.items():
        median, high = (float(value) for value in np.percentile(values, [50, 95]))
        chart = Cell("", median, heights=histogram(np.array(values)))
        figures = centimetre_cells(median, high, max(values))
        lines.append(Line((Cell(name), chart, count_cell(len(values)), *figures)))
    without = f"; {left_out} vertices with an assumed coordinate are left out" if left_out else ""
    return Table("sigmas", f"Standard deviations along the rows\u2019 axes{without}", heads(*names), tuple(lines))


def histogram(values_m: Floats) -> tuple[float, ...]:
    """Heights (0..1) of bins evenly spaced in the logarithm; what is outside goes into the outermost."""
    edges = np.geomspace(_FIRST_M, _LAST_M, _BINS + 1)
    counts, _ = np.histogram(np.clip(values_m, _FIRST_M, _LAST_M), edges)
    return tuple(float(count) for count in np.round(counts / max(1, counts.max()), 3))


def _structures(row: Summary) -> Iterator[tuple[Structure, Bools]]:
    """A row's structures, and which of their coordinates (n, 3) are assumed."""
    for plugin, group in row.row.structures.items() if row.row else ():
        for structure in group:
            yield structure, structure.assumed(plugin, row.row.joint if row.row else None)


def _vertex_sigmas(structure: Structure) -> Floats:
    """Standard deviations of its vertices (n, 3), m."""
    variances = np.diagonal(structure.covariances, axis1=1, axis2=2)
    return np.sqrt(np.maximum(variances, 0.0))


def _hint(structure: Structure, assumed: Bools, off_m: float | None) -> str:
    sizes = [
        f"{name} {fixed(value, 3)} \u00b1 {fixed(sigma, 3)} m{', assumed' if _rests_on(name, assumed) else ''}"
        for name, value, sigma in structure.sizes()
    ]
    largest = np.where(assumed, 0.0, _vertex_sigmas(structure)).max(axis=0, initial=0.0)
    axes = ", ".join(f"{axis} {fixed(value, 3)}" for axis, value in zip("xyz", largest, strict=True))
    words = [*sizes, f"vertices \u03c3 up to {axes} m"]
    words += [
        f"{axis} of {count} of {len(assumed)} vertices assumed"
        for axis, count in zip("xyz", assumed.sum(axis=0).tolist(), strict=True)
        if count
    ]
    if off_m is not None:
        words += ["not in the survey" if np.isinf(off_m) else f"off the survey by {centimetres(off_m)} cm"]
    return f"{structure.id}: {'; '.join(words)}"


def _named_sigmas(structure: Structure, assumed: Bools) -> list[tuple[str, float]]:
    sizes = list(structure.sizes())
    if sizes:
        return [(f"{structure.label}: {name}", sigma) for name, _, sigma in sizes if not _rests_on(name, assumed)]
    return [
        (f"{structure.label}: {axis} of a vertex", float(sigma))
        for vertex, guessed in zip(_vertex_sigmas(structure), assumed, strict=True)
        for axis, sigma, guess in zip("xyz", vertex, guessed, strict=True)
        if not guess
    ]


def _rests_on(size: str, assumed: Bools) -> bool:
    """Whether a size is along an axis along which a vertex is assumed."""
    axis = SIZE_AXES.get(size.rpartition(" ")[2])
    return axis is not None and bool(assumed[:, axis].any())
