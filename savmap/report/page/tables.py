"""Tables of the page: cells with what they say and what they are sorted by."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Part:
    """A piece of a bar: its share of the whole bar's width (0..1), its look, and what it stands for."""

    share: float
    look: str
    title: str


@dataclass(frozen=True)
class Cell:
    """A cell: its text, the number it is sorted by (its text where there is none), a look, a link, and a bar or a small
    histogram (heights 0..1) beside the text."""

    text: str
    value: float | None = None
    look: str = ""
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
    """A line of a table; the first cell is its heading. `look`: "failed", "off", or nothing."""

    cells: tuple[Cell, ...]
    look: str = ""


@dataclass(frozen=True)
class Table:
    """A table. `filters`: what the box that leaves only marked lines is called; nothing: there is no filter."""

    id: str
    caption: str
    heads: tuple[Head, ...]
    lines: tuple[Line, ...]
    filters: str = ""

    @property
    def marked(self) -> int:
        """How many lines have a look of their own."""
        return sum(1 for line in self.lines if line.look)


def number(value: float | None, text: str, look: str = "") -> Cell:
    """A cell of a number as it is written."""
    return Cell(text, value, look)


def heads(*names: str) -> tuple[Head, ...]:
    """Headings of a column of names and of columns of numbers; those with a leading `'` are of words too."""
    return tuple(Head(name.lstrip("'"), bool(k) and not name.startswith("'")) for k, name in enumerate(names))
