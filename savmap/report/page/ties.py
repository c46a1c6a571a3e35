"""What two rows both see, and how well they agree on where it is."""

from collections.abc import Mapping, Sequence

import numpy as np

from savmap.report.page.numbers import centimetres, fixed, natural
from savmap.report.page.summary import OFF_SIGMAS
from savmap.report.page.tables import Cell, Line, Table, heads, number
from savmap.types import CrossRowMatch

_AXES = "xyz"


def worst(tie: CrossRowMatch) -> float:
    """The largest of its residuals in standard deviations; 0 where nothing is told."""
    known = ~np.isnan(tie.residual_m) & ~np.isnan(tie.sigma_m) & (tie.sigma_m > 0)
    return float(np.abs(tie.residual_m[known] / tie.sigma_m[known]).max(initial=0.0))


def is_tie_off(tie: CrossRowMatch) -> bool:
    """Whether the two rows contradict each other there."""
    return worst(tie) > OFF_SIGMAS


def tie_words(tie: CrossRowMatch) -> str:
    """Such as "A: upright 1 = B: upright 9, x +0.4 cm, z -1.0 cm (1.3 sigmas)"."""
    residuals = [
        f"{axis} {centimetres(float(value), True)} cm"
        for axis, value in zip(_AXES, tie.residual_m, strict=True)
        if not np.isnan(value)
    ]
    return f"{tie.row_a}: {tie.id_a} = {tie.row_b}: {tie.id_b}, " + ", ".join(residuals) + f" ({worst(tie):.2f} \u03c3)"


def pair_table(ties: Sequence[CrossRowMatch]) -> Table:
    """A line for each two rows that see the same things."""
    pairs: dict[tuple[str, str], list[CrossRowMatch]] = {}
    for own in ties:
        pairs.setdefault((own.row_a, own.row_b), []).append(own)
    order = {name: k for k, name in enumerate(natural({name for pair in pairs for name in pair}))}
    lines = tuple(_pair(pair, pairs[pair]) for pair in sorted(pairs, key=lambda pair: (order[pair[0]], order[pair[1]])))
    names = ("rows", "shared", "root mean square x, cm", "y, cm", "z, cm", "largest, \u03c3", "off by > 3 \u03c3")
    return Table("ties-by-pair", "Rows that share something, and what is left between them", heads(*names), lines)


def tie_table(ties: Sequence[CrossRowMatch], anchors: Mapping[str, str]) -> Table:
    """A line for each thing that two rows see, the worst first."""
    names = ("thing", "'in row", "'is", "'in row", "x, cm", "y, cm", "z, cm", "in \u03c3")
    lines = tuple(_line(own, anchors) for own in sorted(ties, key=worst, reverse=True))
    return Table(
        "ties",
        "What two rows share: what is left between its two places",
        heads(*names),
        lines,
        "only those off by more than 3 \u03c3",
    )


def _pair(pair: tuple[str, str], ties: Sequence[CrossRowMatch]) -> Line:
    residuals = np.array([own.residual_m for own in ties])
    off = sum(1 for own in ties if is_tie_off(own))
    largest = max(worst(own) for own in ties)
    axes = [_root_mean_square(residuals[:, axis]) for axis in range(3)]
    cells = (
        Cell(" \u2013 ".join(pair)),
        number(len(ties), str(len(ties))),
        *(number(value, centimetres(value)) for value in axes),
        number(largest, fixed(largest, 2)),
        number(off, str(off)),
    )
    return Line(cells, "off" if off else "")


def _line(own: CrossRowMatch, anchors: Mapping[str, str]) -> Line:
    rows = [Cell(name, link=f"#{anchors[name]}" if name in anchors else "") for name in (own.row_a, own.row_b)]
    axes = [None if np.isnan(value) else float(value) for value in own.residual_m]
    cells = (
        Cell(own.id_a),
        rows[0],
        Cell(own.id_b),
        rows[1],
        *(number(value, centimetres(value, True)) for value in axes),
        number(worst(own), fixed(worst(own), 2)),
    )
    return Line(cells, "off" if is_tie_off(own) else "")


def _root_mean_square(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float | None:
    known = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else None
