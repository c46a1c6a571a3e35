"""Where the site stands in the user's world, and how well the places that are known there agree."""

import numpy as np

from savmap.report.numbers import fixed
from savmap.report.page.tables import Cell, Line, Table, centimetre_cell, heads, number_cell
from savmap.types import Alignment, AlignmentResidual
from savmap.types.maps import OFF_SIGMAS


def alignment_facts(alignment: Alignment) -> tuple[tuple[str, str], ...]:
    """Where the site's origin is in the user's world, and where its x axis points."""
    x, y, turn = (float(sigma) for sigma in np.sqrt(np.diag(alignment.covariance)))
    return (
        ("origin x", f"{fixed(alignment.x_m, 3)} \u00b1 {fixed(x, 3)} m"),
        ("origin y", f"{fixed(alignment.y_m, 3)} \u00b1 {fixed(y, 3)} m"),
        ("origin z", f"{fixed(alignment.z_m, 3)} m"),
        ("heading of the x axis", f"{fixed(alignment.heading_deg, 3)} \u00b1 {fixed(turn, 3)}\u00b0"),
    )


def alignment_table(alignment: Alignment) -> Table:
    """A line for each known place."""
    names = ("place", "'in row", "x, cm", "y, cm", "z, cm", "in \u03c3", "'used")
    lines = tuple(map(_line, alignment.residuals))
    return Table("alignment", "Known places: given less mapped, along your world\u2019s axes", heads(*names), lines)


def _line(residual: AlignmentResidual) -> Line:
    axes = (None if np.isnan(value) else float(value) for value in residual.residual_m)
    cells = (
        Cell(residual.at),
        Cell(residual.row),
        *(centimetre_cell(value, True) for value in axes),
        number_cell(residual.deviation, 1),
        Cell("yes" if residual.used else "left out"),
    )
    return Line(cells, "off" if residual.deviation > OFF_SIGMAS or not residual.used else "")
