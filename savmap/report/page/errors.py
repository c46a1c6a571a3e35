"""Errors against the survey: tables by class and by row."""

from collections.abc import Mapping, Sequence

from savmap.report.evaluation import all_errors, named_counts, statistics
from savmap.report.numbers import centimetres
from savmap.report.page.summary import Summary
from savmap.report.page.tables import Cell, Line, Part, Table, centimetre_cell, count_cell, heads, row_cell
from savmap.types import Distances, Floats, Score

_STATISTICS = ("count", "mean, cm", "mean abs, cm", "95 %, cm", "largest, cm")


def class_table(score: Score) -> Table:
    """By class of measure: count, mean, mean absolute error, 95th percentile and largest of its size."""
    classes = [_class_line(name, errors) for name, errors in score.errors.items()]
    total = [_class_line("all of these", all_errors(score), "sum")] if len(score.errors) > 1 else []
    edges = [_class_line(f"{name} (place in the row)", errors) for name, errors in score.coordinates.items()]
    lines = (*classes, *total, *edges)
    return Table("errors-by-class", "Truth \u2212 estimate by class", heads("class", *_STATISTICS), lines)


def distance_table(distances: Mapping[str, Distances]) -> Table:
    """Points scored by their distance to the survey's."""
    names = ("what", "matched", "mean, cm", "95 %, cm", "largest, cm", "missing", "spurious")
    lines = tuple(_distance_line(name, part) for name, part in distances.items())
    return Table("errors-apart", "Distance to the surveyed place", heads(*names), lines)


def row_errors(rows: Sequence[Summary]) -> Table:
    """Each scored row's mean absolute error as a bar, its statistics, and what is missing or spurious."""
    scored = [(row, row.score) for row in rows if row.score]
    largest = max((row.error_m or 0.0 for row, _ in scored), default=0.0)
    names = ("row", "'mean absolute error", "cm", "95 %, cm", "count", "'missing", "'spurious")
    lines = tuple(_row_line(row, score, largest) for row, score in scored)
    return Table("errors-by-row", "Errors by row", heads(*names), lines)


def _class_line(name: str, errors: Floats, style: str = "") -> Line:
    given = statistics(errors)
    sizes = (given.mean_absolute, given.percentile_95, given.largest)
    cells = (centimetre_cell(given.mean, True), *map(centimetre_cell, sizes))
    return Line((Cell(name), count_cell(given.count), *cells), style)


def _distance_line(name: str, distances: Distances) -> Line:
    given = statistics(distances.distances_m)
    sizes = map(centimetre_cell, (given.mean, given.percentile_95, given.largest))
    unmatched = map(count_cell, (distances.missing, distances.spurious))
    return Line((Cell(name), count_cell(given.count), *sizes, *unmatched))


def _row_line(row: Summary, score: Score, largest_m: float) -> Line:
    given, error = statistics(all_errors(score)), row.error_m
    share = (error or 0.0) / largest_m if largest_m else 0.0
    cells = (
        row_cell(row),
        Cell("", error, bar=(Part(share, "error", f"{centimetres(error)} cm"),)),
        centimetre_cell(error),
        centimetre_cell(given.percentile_95),
        count_cell(given.count),
        Cell(named_counts(score.missing)),
        Cell(named_counts(score.spurious)),
    )
    return Line(cells, "off" if any(score.missing.values()) or any(score.spurious.values()) else "")
