"""What two rows both see, and how well they agree on where it is."""

from collections.abc import Mapping, Sequence

import numpy as np

from savmap.report.numbers import centimetres, natural
from savmap.report.page.tables import Cell, Line, Table, centimetre_cell, count_cell, heads, number_cell
from savmap.types import CrossRowMatch, Floats
from savmap.types.maps import OFF_SIGMAS

_AXES = "xyz"


def largest_residual(tie: CrossRowMatch) -> float:
    """The largest of its residuals in standard deviations; 0 where none is known."""
    known = ~np.isnan(tie.residual_m) & ~np.isnan(tie.sigma_m) & (tie.sigma_m > 0)
    return float(np.abs(tie.residual_m[known] / tie.sigma_m[known]).max(initial=0.0))


def is_tie_off(tie: CrossRowMatch) -> bool:
    """Whether the two rows contradict each other there."""
    return largest_residual(tie) > OFF_SIGMAS


def tie_hint(tie: CrossRowMatch) -> str:
    """Such as "A: upright 1 = B: upright 9, x +0.4 cm, z -1.0 cm (1.3 sigmas)"."""
    residuals = ", ".join(
        f"{axis} {centimetres(float(value), True)} cm"
        for axis, value in zip(_AXES, tie.residual_m, strict=True)
        if not np.isnan(value)
    )
    sigmas = f"{largest_residual(tie):.2f} \u03c3"
    return f"{tie.row_a}: {tie.id_a} = {tie.row_b}: {tie.id_b}, {residuals} ({sigmas})"


def pair_table(ties: Sequence[CrossRowMatch]) -> Table:
    """A line for each two rows that see the same structures."""
    pairs: dict[tuple[str, str], list[CrossRowMatch]] = {}
    for tie in ties:
        pairs.setdefault((tie.row_a, tie.row_b), []).append(tie)
    order = {name: k for k, name in enumerate(natural({name for pair in pairs for name in pair}))}
    in_order = sorted(pairs, key=lambda pair: (order[pair[0]], order[pair[1]]))
    lines = tuple(_pair_line(pair, pairs[pair]) for pair in in_order)
    names = ("rows", "shared", "root mean square x, cm", "y, cm", "z, cm", "largest, \u03c3", "off by > 3 \u03c3")
    return Table(
        "ties-by-pair",
        "Rows that see the same things, or share a camera path: what is left between them, along the site\u2019s axes",
        heads(*names),
        lines,
    )


def tie_table(ties: Sequence[CrossRowMatch], anchors: Mapping[str, str]) -> Table:
    """A line for each structure that two rows see, the one that they place furthest apart first."""
    names = ("thing", "'in row", "'is", "'in row", "x, cm", "y, cm", "z, cm", "in \u03c3")
    lines = tuple(_tie_line(tie, anchors) for tie in sorted(ties, key=largest_residual, reverse=True))
    caption = "What two rows share: what is left between its two places, along the site\u2019s axes"
    return Table("ties", caption, heads(*names), lines, "only those off by more than 3 \u03c3")


def _pair_line(pair: tuple[str, str], ties: Sequence[CrossRowMatch]) -> Line:
    residuals = np.array([tie.residual_m for tie in ties])
    off = sum(1 for tie in ties if is_tie_off(tie))
    cells = (
        Cell(" \u2013 ".join(pair)),
        count_cell(len(ties)),
        *(centimetre_cell(_root_mean_square(residuals[:, axis])) for axis in range(3)),
        number_cell(max(largest_residual(tie) for tie in ties), 2),
        count_cell(off),
    )
    return Line(cells, "off" if off else "")


def _tie_line(tie: CrossRowMatch, anchors: Mapping[str, str]) -> Line:
    row_a, row_b = (Cell(name, link=f"#{anchors[name]}" if name in anchors else "") for name in (tie.row_a, tie.row_b))
    axes = (None if np.isnan(value) else float(value) for value in tie.residual_m)
    residuals = (centimetre_cell(value, True) for value in axes)
    cells = (Cell(tie.id_a), row_a, Cell(tie.id_b), row_b, *residuals, number_cell(largest_residual(tie), 2))
    return Line(cells, "off" if is_tie_off(tie) else "")


def _root_mean_square(values: Floats) -> float | None:
    known = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else None
