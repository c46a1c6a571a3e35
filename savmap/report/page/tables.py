"""Tables of the page as records (cells with their text and what they are sorted by), and the tables of rows and references."""

from collections.abc import Sequence
from dataclasses import dataclass

from savmap.report.numbers import NOTHING, centimetres, fixed
from savmap.report.page.summary import OFF, Summary, total_counts
from savmap.types import ReferenceUse


@dataclass(frozen=True)
class Part:
    """A piece of a bar: its share of the whole bar's width (0..1), its style, and its hint."""

    share: float
    style: str
    title: str


@dataclass(frozen=True)
class Cell:
    """A cell: its text, the number it is sorted by (its text where there is none), a style, a link, and a bar or a small
    histogram (heights 0..1) instead of the text."""

    text: str
    value: float | None = None
    style: str = ""
    link: str = ""
    bar: tuple[Part, ...] = ()
    heights: tuple[float, ...] = ()


@dataclass(frozen=True)
class Head:
    """A column's heading; numbers stand to the right."""

    text: str
    number: bool = True


@dataclass(frozen=True)
class Line:
    """A line of a table; the first cell is its heading. `style`: "failed", "off", "sum", or nothing."""

    cells: tuple[Cell, ...]
    style: str = ""


@dataclass(frozen=True)
class Table:
    """A table. `filters`: the label of the box that leaves only marked lines; nothing: there is no filter."""

    id: str
    caption: str
    heads: tuple[Head, ...]
    lines: tuple[Line, ...]
    filters: str = ""

    @property
    def marked(self) -> int:
        """How many lines have a style."""
        return sum(1 for line in self.lines if line.style)


def heads(*names: str) -> tuple[Head, ...]:
    """Headings of a column of names and of columns of numbers; those with a leading `'` are of words too."""
    return tuple(Head(name.lstrip("'"), bool(k) and not name.startswith("'")) for k, name in enumerate(names))


def count_cell(count: int) -> Cell:
    """A cell of a whole number."""
    return Cell(str(count), count)


def number_cell(value: float | None, decimals: int, plus: bool = False) -> Cell:
    """A cell of a number with so many decimals."""
    return Cell(fixed(value, decimals, plus), value)


def centimetre_cell(value_m: float | None, plus: bool = False) -> Cell:
    """A cell of metres, written as centimetres."""
    return Cell(centimetres(value_m, plus), value_m)


def row_cell(row: Summary) -> Cell:
    """A row's name, which leads to its section."""
    return Cell(row.name, link=f"#{row.anchor}")


def row_table(rows: Sequence[Summary]) -> Table:
    """A line for each row: state, counts, length, references, errors, remarks."""
    labels = list(total_counts(rows))
    scored = any(row.score for row in rows)
    error = ["mean abs error, cm"] if scored else []
    names = ("row", "'state", *labels, "length, m", "references", "worst, \u03c3", *error, "'remarks")
    lines = tuple(_row_line(row, labels, scored) for row in rows)
    caption = "Rows; those that failed first"
    return Table("rows-table", caption, heads(*names), lines, "only rows that failed or deserve attention")


def reference_table(rows: Sequence[Summary]) -> Table:
    """A line for each reference of each row."""
    names = (
        "reference",
        "'row",
        "'state",
        "given",
        "solved",
        "residual",
        "\u03c3 given",
        "\u03c3 used",
        "in \u03c3 given",
        "'unit",
    )
    lines = tuple(_reference_line(row, reference) for row in rows for reference in row.references)
    caption = "References: residual is solved \u2212 given"
    return Table("references-table", caption, heads(*names), lines, "only those contradicted or left out")


def _row_line(row: Summary, labels: Sequence[str], scored: bool) -> Line:
    worst = max((abs(reference.deviation) for reference in row.references), default=None)
    mapped, nothing = row.row is not None, Cell(NOTHING)
    cells = (
        row_cell(row),
        Cell(row.status, style=f"badge {row.status}"),
        *(count_cell(row.counts.get(label, 0)) if mapped else nothing for label in labels),
        number_cell(row.length_m, 2),
        count_cell(len(row.references)) if mapped else nothing,
        number_cell(worst, 1),
        *([centimetre_cell(row.error_m)] if scored else []),
        Cell(row.error or "; ".join(row.remarks), style="words"),
    )
    return Line(cells, "failed" if not mapped else "off" if row.remarks else "")


def _reference_line(row: Summary, reference: ReferenceUse) -> Line:
    cells = (
        Cell(reference.name),
        row_cell(row),
        Cell(reference.state),
        number_cell(reference.value, 4),
        number_cell(reference.solved, 4),
        number_cell(reference.solved - reference.value, 4, True),
        number_cell(reference.sigma, 4),
        number_cell(reference.sigma_used, 4),
        Cell(fixed(reference.deviation, 2, True), abs(reference.deviation)),
        Cell(reference.unit),
    )
    return Line(cells, "off" if reference.state in OFF else "")
