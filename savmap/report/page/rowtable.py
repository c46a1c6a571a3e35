"""The table of rows, and the table of their references."""

from collections.abc import Sequence

from savmap.report.page.numbers import NOTHING, centimetres, fixed
from savmap.report.page.summary import Summary, all_counts, in_sigmas, is_off
from savmap.report.page.tables import Cell, Head, Line, Table, heads, number
from savmap.types import ReferenceUse

FILTER_ROWS, FILTER_OFF = "only rows that failed or deserve a look", "only those off by more than 3 \u03c3"


def row_table(rows: Sequence[Summary]) -> Table:
    """A line for each row: state, counts, length, references, errors, remarks."""
    labels = list(all_counts(rows))
    scored = any(row.score for row in rows)
    names = (
        "row",
        "'state",
        *labels,
        "length, m",
        "references",
        "worst, \u03c3",
        *(["mean abs error, cm"] if scored else []),
        "'remarks",
    )
    lines = tuple(_line(row, labels, scored) for row in rows)
    return Table("rows-table", "Rows; those that failed first", heads(*names), lines, FILTER_ROWS)


def reference_table(rows: Sequence[Summary]) -> Table:
    """A line for each reference of each row."""
    names: tuple[Head, ...] = heads("reference", "'row", "given", "\u03c3", "solved", "residual", "in \u03c3", "'unit")
    lines = tuple(_reference(row, own) for row in rows for own in row.references)
    return Table("references-table", "References: residual is solved \u2212 given", names, lines, FILTER_OFF)


def _line(row: Summary, labels: Sequence[str], scored: bool) -> Line:
    worst = max((abs(in_sigmas(own)) for own in row.references), default=None)
    length, mapped = row.length_m, row.row is not None
    counts = [number(row.counts.get(label, 0), str(row.counts.get(label, 0))) for label in labels]
    error = number(row.error_m, centimetres(row.error_m))
    cells = (
        Cell(row.name, link=f"#{row.anchor}"),
        Cell(row.status, look=f"badge {row.status}"),
        *(counts if mapped else [Cell(NOTHING)] * len(labels)),
        number(length, fixed(length, 2)),
        number(len(row.references), str(len(row.references))) if mapped else Cell(NOTHING),
        number(worst, fixed(worst, 1)),
        *([error] if scored else []),
        Cell(row.error or "; ".join(row.remarks), look="words"),
    )
    return Line(cells, "failed" if not mapped else "off" if row.remarks else "")


def _reference(row: Summary, own: ReferenceUse) -> Line:
    residual = own.solved - own.value
    cells = (
        Cell(own.name),
        Cell(row.name, link=f"#{row.anchor}"),
        number(own.value, fixed(own.value, 4)),
        number(own.sigma, fixed(own.sigma, 4)),
        number(own.solved, fixed(own.solved, 4)),
        number(residual, fixed(residual, 4, True)),
        number(abs(in_sigmas(own)), fixed(in_sigmas(own), 2, True)),
        Cell(own.unit),
    )
    return Line(cells, "off" if is_off(own) else "")
