"""Tables of the page as records (cells with their text and what they are sorted by), and the tables of rows, footage,
openings and references."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.maps.search import PART
from savmap.report.numbers import NOTHING, centimetres, fixed
from savmap.report.page.summary import OFF, Summary, total_counts
from savmap.types import ReferenceUse, RowMap, Structure

ASSUMED = "assumed"
"""The attribute in which a place says which of its sizes rest on what nothing measured."""


@dataclass(frozen=True)
class Part:
    """A piece of a bar: its share of the whole bar's width (0..1), its style, and its hint."""

    share: float
    style: str
    title: str


@dataclass(frozen=True)
class Cell:
    """A cell: its text, the number it is sorted by (its text where there is none), a style, a link, a smaller text
    behind it, and a bar or a small histogram (heights 0..1) instead of the text."""

    text: str
    value: float | None = None
    style: str = ""
    link: str = ""
    bar: tuple[Part, ...] = ()
    heights: tuple[float, ...] = ()
    note: str = ""


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


def footage_table(rows: Sequence[Summary]) -> Table:
    """A line for each pass of each row: its file, the size of its pictures, how many frames were used and read, and of
    which time of the video."""
    names = ("row", "'pass", "'file", "'pictures, px", "frames used", "frames read", "from, s", "to, s", "length, s")
    lines = tuple(line for row in rows if row.row for line in _pass_lines(row, row.row))
    return Table("footage-table", "Footage; times are those of the file", heads(*names), lines)


def openings_table(row: Summary) -> Table | None:
    """A line for each place of a row that has sizes, such as a bay, with a column for each part of it, such as a level;
    None where there is none."""
    parts: dict[str, dict[str, Structure]] = {}
    for place in row.places:
        whole, _, part = place.id.partition(PART)
        parts.setdefault(whole, {})[part] = place
    wholes = {name: own for name, own in parts.items() if "" in own and any(any(one.sizes()) for one in own.values())}
    if not wholes:
        return None
    sizes = list(dict.fromkeys(size for own in wholes.values() for size, _, _ in own[""].sizes()))
    columns = dict.fromkeys(
        (part, size)
        for own in wholes.values()
        for part, place in own.items()
        for size, _, _ in place.sizes()
        if part and size not in sizes
    )
    label = next(iter(wholes.values()))[""].label
    names = (label, *(f"{size}, m" for size in sizes), *(f"{part}: {size}, m" for part, size in columns))
    lines = tuple(
        Line(
            (Cell(name), *(_size_cell(own.get(part), size) for part, size in [*(("", one) for one in sizes), *columns]))
        )
        for name, own in wholes.items()
    )
    caption = "Openings, \u00b1 a standard deviation; \u2013: open, or not known"
    return Table(f"{row.anchor}-openings", caption, heads(*names), lines)


def reference_table(rows: Sequence[Summary]) -> Table:
    """A line for each reference of each row."""
    sigmas = ("\u03c3 given", "\u03c3 used", "in \u03c3 given")
    names = ("reference", "'row", "given", "solved", "residual", *sigmas, "'state", "'unit")
    lines = tuple(_reference_line(row, reference) for row in rows for reference in row.references)
    caption = "References: residual is solved \u2212 given"
    return Table("references-table", caption, heads(*names), lines, "only those contradicted or left out")


def _row_line(row: Summary, labels: Sequence[str], scored: bool) -> Line:
    worst = max((abs(reference.deviation) for reference in row.references), default=None)
    mapped, nothing = row.row is not None, Cell(NOTHING)
    state = "check" if row.doubts else row.status
    cells = (
        row_cell(row),
        Cell(state, style=f"badge {state}"),
        *(count_cell(row.counts.get(label, 0)) if mapped else nothing for label in labels),
        number_cell(row.length_m, 2),
        count_cell(len(row.references)) if mapped else nothing,
        number_cell(worst, 1),
        *([centimetre_cell(row.error_m)] if scored else []),
        Cell(row.error or "; ".join(row.remarks), style="words"),
    )
    return Line(cells, "failed" if not mapped else "off" if row.remarks else "")


def _pass_lines(row: Summary, mapped: RowMap) -> Iterator[Line]:
    passes, files = np.array(mapped.frames.passes, dtype=object), row.run.footage if row.run else {}
    used = passes[mapped.trajectory.frames]
    for name in dict.fromkeys(mapped.frames.passes):
        stamps, file = mapped.frames.stamps_s[passes == name], files.get(name)
        start, end = float(stamps.min()), float(stamps.max())
        size = f"{file.width} \u00d7 {file.height}" if file and file.width else NOTHING
        cells = (
            row_cell(row),
            Cell(name),
            Cell(file.name if file else NOTHING),
            Cell(size, file.width if file else None),
            count_cell(int((used == name).sum())),
            count_cell(len(stamps)),
            *(number_cell(value, 1) for value in (start, end, end - start)),
        )
        yield Line(cells)


def _size_cell(place: Structure | None, size: str) -> Cell:
    """A size of a place with its standard deviation; one that rests on something that nothing measured looks so."""
    found = next(((value, sigma) for name, value, sigma in place.sizes() if name == size), None) if place else None
    if place is None or found is None:
        return Cell(NOTHING)
    style = "assumed" if size in str(place.attributes.get(ASSUMED, "")) else ""
    return Cell(fixed(found[0], 3), found[0], style, note=f"\u00b1 {fixed(found[1], 3)}")


def _reference_line(row: Summary, reference: ReferenceUse) -> Line:
    cells = (
        Cell(reference.name),
        row_cell(row),
        number_cell(reference.value, 4),
        number_cell(reference.solved, 4),
        number_cell(reference.solved - reference.value, 4, True),
        number_cell(reference.sigma, 4),
        number_cell(reference.sigma_used, 4),
        Cell(fixed(reference.deviation, 2, True), abs(reference.deviation)),
        Cell(reference.state),
        Cell(reference.unit),
    )
    return Line(cells, "off" if reference.state in OFF else "")
