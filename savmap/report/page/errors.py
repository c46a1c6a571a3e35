"""Errors against the survey: tables by class and by row."""

from collections.abc import Mapping, Sequence

import numpy as np

from savmap.evaluation import Distances, Evaluation, Score, mean_absolute_error, pool
from savmap.report.page.numbers import centimetres, counted
from savmap.report.page.summary import Summary
from savmap.report.page.tables import Cell, Line, Part, Table, heads, number
from savmap.types import Floats

_FIGURES = ("count", "mean, cm", "mean abs, cm", "95 %, cm", "largest, cm")


def class_table(evaluation: Evaluation) -> Table:
    """By class of measure over all rows: count, mean, mean absolute error, 95th percentile and largest of its size."""
    score = pool(evaluation.rows.values())
    every = np.concatenate([np.zeros(0), *score.errors.values()])
    all_of_them = [_figures("all of these", every, "sum")] if len(score.errors) > 1 else []
    edges = [_figures(f"{name} (place in the row)", errors) for name, errors in score.coordinates.items()]
    lines = (*(_figures(name, errors) for name, errors in score.errors.items()), *all_of_them, *edges)
    return Table("errors-by-class", "Truth \u2212 estimate by class", heads("class", *_FIGURES), lines)


def distance_table(distances: Mapping[str, Distances]) -> Table:
    """Points scored by their distance to the survey's."""
    names = ("what", "matched", "mean, cm", "95 %, cm", "largest, cm", "missing", "spurious")
    return Table(
        "errors-apart",
        "Distance to the surveyed place",
        heads(*names),
        tuple(_apart(name, own) for name, own in distances.items()),
    )


def row_errors(rows: Sequence[Summary]) -> Table:
    """Each scored row's mean absolute error as a bar, its figures, and what is missing or spurious."""
    scored = [(row, row.score) for row in rows if row.score]
    largest = max((row.error_m or 0.0 for row, _ in scored), default=0.0)
    names = ("row", "'mean absolute error", "cm", "95 %, cm", "count", "'missing", "'spurious")
    lines = tuple(_row(row, score, largest) for row, score in scored)
    return Table("errors-by-row", "Errors by row", heads(*names), lines)


def headline(score: Score) -> str:
    """The mean absolute error and what is missing or spurious, in a sentence."""
    error = mean_absolute_error(score)
    figure = f"Mean absolute error {centimetres(error)} cm." if error is not None else "Nothing matched."
    return f"{figure} Missing: {counted(score.missing)}. Spurious: {counted(score.spurious)}."


def _figures(name: str, errors: Floats, look: str = "") -> Line:
    size = np.abs(errors)
    values = (errors.mean(), size.mean(), np.percentile(size, 95), size.max()) if len(errors) else (None,) * 4
    known = [None if value is None else float(value) for value in values]
    mean, *others = known
    cells = (
        Cell(name),
        number(len(errors), str(len(errors))),
        number(mean, centimetres(mean, True)),
        *(number(value, centimetres(value)) for value in others),
    )
    return Line(cells, look)


def _apart(name: str, own: Distances) -> Line:
    found = own.distances_m
    values = (
        [float(value) for value in (found.mean(), np.percentile(found, 95), found.max())] if len(found) else [None] * 3
    )
    counts = [number(value, str(value)) for value in (own.missing, own.spurious)]
    figures = [number(value, centimetres(value)) for value in values]
    return Line((Cell(name), number(len(found), str(len(found))), *figures, *counts))


def _row(row: Summary, score: Score, largest_m: float) -> Line:
    sizes = np.abs(np.concatenate([np.zeros(0), *score.errors.values()]))
    error = row.error_m
    high = float(np.percentile(sizes, 95)) if len(sizes) else None
    share = (error or 0.0) / largest_m if largest_m else 0.0
    cells = (
        Cell(row.name, link=f"#{row.anchor}"),
        Cell("", error, bar=(Part(share, "error", f"{centimetres(error)} cm"),)),
        number(error, centimetres(error)),
        number(high, centimetres(high)),
        number(len(sizes), str(len(sizes))),
        Cell(counted(score.missing)),
        Cell(counted(score.spurious)),
    )
    return Line(cells, "off" if any(score.missing.values()) or any(score.spurious.values()) else "")
