"""Points of a survey as total stations and spreadsheets write them: a table with a point a line, whose columns stand in
any order.

Comma, semicolon or tab part the columns, names may hold the unit ("x_m", "Easting [mm]"), and decimals may follow a
comma. What has the same row and the same id is one element; without a column of ids, its code is both ("upright 3": the
label "upright").
"""

import csv
import io
import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from savmap.apps.exchange.imports.records import (
    FRAMES,
    MOST_POINTS,
    UNITS,
    Frame,
    ImportOptions,
    SurveyElement,
    bytes_of,
    element,
    listed,
)
from savmap.errors import OutputError
from savmap.files.texts import READINGS, readings
from savmap.types import Floats

ALIASES: Mapping[str, tuple[str, ...]] = {
    "row": ("row", "aisle"),
    "frame": ("frame",),
    "id": ("id", "structure", "element", "object", "name"),
    "label": ("label", "class", "code", "layer", "type", "feature", "description"),
    "vertex": ("vertex", "corner", "point", "point id", "pointid", "pt", "nr", "no", "number"),
    "text": ("text",),
}
"""Names of columns, in lower case, the first that is there being taken."""
HEIGHTS = ("height", "elevation", "elev", "up", "h", "höhe", "hoehe")
IN_WORLD: Mapping[str, tuple[str, ...]] = {
    "x": ("x", "east", "easting", "e", "rechtswert"),
    "y": ("y", "north", "northing", "n", "hochwert"),
    "z": ("z", *HEIGHTS),
}
IN_ROW: Mapping[str, tuple[str, ...]] = {"x": ("x", "along"), "y": ("y", *HEIGHTS), "z": ("z", "depth", "out")}
"""The same of the axes, in the world's frame, whose z points up, and in those of rows and sites, whose y does."""
AXES = ("x", "y", "z")
WITH_UNIT = re.compile(r"(?P<name>.*?)(?:[\s_/,-]+(?:in\s+)?|\s*(?=[\[(]))[\[(]?(?P<unit>[a-z]{1,2})[\])]?", re.DOTALL)
NUMBERED = re.compile(r"^(?P<label>.*?)[\s_.#-]*\d+$", re.DOTALL)
DELIMITERS = ";\t,"
FORMULA = re.compile(r"^'(?=\s*[=+\-@])")
"""What spreadsheets, and savmap's own tables, put before a text that begins like a formula."""


@dataclass(frozen=True)
class Line:
    """A line of the table: its number in the file and its cells."""

    number: int
    cells: Sequence[str]


@dataclass(frozen=True)
class Columns:
    """Where things stand: places of columns by their meaning, and metres of a unit of each axis."""

    places: Mapping[str, int]
    metres: Mapping[str, float]

    def text(self, line: Line, meaning: str) -> str:
        """A cell without what protects it; nothing where the column, or the cell, is not there."""
        place = self.places.get(meaning, -1)
        return FORMULA.sub("", line.cells[place].strip()) if 0 <= place < len(line.cells) else ""


def read_table(path: Path, options: ImportOptions, labels: Mapping[str, str]) -> list[SurveyElement]:
    """The elements of a table. `labels`: those of the plugins, by themselves in lower case. Raises OutputError."""
    lines, delimiter = _lines(path)
    if not lines:
        raise OutputError(f"{path}: holds no table")
    columns, begins = _columns(path, lines[0].cells, options)
    points = [line for line in lines[begins:] if any(columns.text(line, axis) for axis in AXES)]
    if not points:
        raise OutputError(f"{path}: holds no points")
    places = _places(path, points, columns, delimiter)
    return _elements(path, points, places, columns, options, labels)


def _lines(path: Path) -> tuple[list[Line], str]:
    """The lines that hold anything, of which notes (#) do not, and what parts their cells. Raises OutputError."""
    text = _text(path)
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    delimiter = max(DELIMITERS, key=lambda letter: (first.count(letter), -DELIMITERS.index(letter)))
    table = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    lines = list[Line]()
    try:
        for cells in table:
            if any(cell.strip() for cell in cells) and not cells[0].startswith("#"):
                lines.append(Line(table.line_num, cells))
            if len(lines) > MOST_POINTS:
                raise OutputError(f"{path}: holds more than {MOST_POINTS} lines, which is the most that is read")
    except csv.Error as error:
        raise OutputError(f"{path}: is not a table (line {table.line_num}: {error})") from error
    return lines, delimiter


def _text(path: Path) -> str:
    """The file's text: UTF-8, UTF-16 with its mark, or what older spreadsheets write (Windows 1252)."""
    content = bytes_of(path)
    codings = ("utf-16",) if content[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig", "cp1252")
    for coding in codings:
        with suppress(UnicodeDecodeError):
            return content.decode(coding).replace("\0", "\ufffd")
    raise OutputError(f"{path}: is not a text file")


def _columns(path: Path, header: Sequence[str], options: ImportOptions) -> tuple[Columns, int]:
    """What the table's first line says of its columns, and with which line its points begin: the first where that is no
    header."""
    named = [_named(cell) for cell in header]
    names = [name for name, _ in named]
    places = dict[str, int]()
    for meaning, aliases in {**ALIASES, **(IN_WORLD if options.usual_frame == "world" else IN_ROW)}.items():
        if meaning in options.columns:
            places[meaning] = _chosen(path, meaning, options.columns[meaning], header)
        elif alias := next((alias for alias in aliases if alias in names), ""):
            places[meaning] = names.index(alias)
    needed = AXES[:2] if options.usual_frame == "row" and "frame" not in places else AXES
    lacking = [axis for axis in needed if axis not in places]
    if lacking:
        world = set(IN_WORLD["x"][1:] + IN_WORLD["y"][1:])
        hint = "; places of the world need --map or --place" if world & set(names) else ""
        raise OutputError(
            f"{path}: no column is {lacking[0]}; there are {listed(header)}: say --columns {lacking[0]}=NAME, "
            f"or its number{hint}"
        )
    units = {axis: named[places[axis]][1] for axis in AXES if axis in places}
    unit = options.unit or next(filter(None, units.values()), "m")
    metres = {axis: UNITS[options.unit or units.get(axis) or unit] for axis in AXES}
    headless = all(readings(header[places[axis]].strip()) for axis in needed)
    return Columns(places, metres), 0 if headless else 1


def _named(cell: str) -> tuple[str, str]:
    """A column's name in lower case, and its unit where it says one."""
    name = " ".join(cell.strip().lower().replace("\ufeff", "").split())[:200]
    match = WITH_UNIT.fullmatch(name)
    if match and match["unit"] in UNITS:
        return match["name"].strip(), match["unit"]
    return name, ""


def _chosen(path: Path, meaning: str, wanted: str, header: Sequence[str]) -> int:
    """The place of the column that the options name, by its name, or by its number."""
    names = [cell.strip().casefold() for cell in header]
    if wanted.strip().casefold() in names:
        return names.index(wanted.strip().casefold())
    if wanted.isascii() and wanted.isdigit() and len(wanted) < 6 and 0 < int(wanted) <= len(header):
        return int(wanted) - 1
    raise OutputError(f"{path}: has no column {listed([wanted])} (--columns {meaning}); there are {listed(header)}")


def _places(path: Path, points: Sequence[Line], columns: Columns, delimiter: str) -> Floats:
    """Positions (n, 3) m of the lines' points; along an axis that the table does not have, 0."""
    axes = [axis for axis in AXES if axis in columns.places]
    cells = {(line.number, axis): columns.text(line, axis) for line in points for axis in axes}
    in_mm = any(columns.metres[axis] == UNITS["mm"] for axis in axes)
    mark = _decimal_mark(path, cells.values(), in_mm, delimiter)
    values = np.zeros((len(points), 3))
    for k, line in enumerate(points):
        for axis in axes:
            cell = cells[line.number, axis]
            value = readings(cell).get(mark, np.nan)
            if not np.isfinite(value):
                said = listed([cell]) if cell else "empty"
                raise OutputError(f"{path}: line {line.number}: {axis} is {said}, not a number")
            values[k, AXES.index(axis)] = value * columns.metres[axis]
    return values


def _decimal_mark(path: Path, cells: Collection[str], in_mm: bool, delimiter: str) -> str:
    """What decimals follow, the point or the comma: what is so in numbers that can be read in one way only. Where all
    can be read in two, such as 1,234, it is the point, or the comma where cells are parted by semicolons, as
    spreadsheets then do. Raises OutputError where nothing tells: nobody writes thousandths of a millimetre either."""
    options = {cell: readings(cell) for cell in cells}
    certain = {mark for values in options.values() if len(values) == 1 for mark in values}
    doubtful = [cell for cell, values in options.items() if len(set(values.values())) == 2]
    marks = certain or {mark for mark in READINGS for cell in doubtful if mark in cell}
    if len(marks) == 2:
        raise OutputError(f"{path}: decimals follow a comma in some numbers, and a point in others")
    mark = next(iter(marks), ".")
    if not certain and doubtful and (in_mm or (mark == "," and delimiter != ";")):
        meanings = " or ".join(f"{value:.12g}" for value in options[doubtful[0]].values())
        raise OutputError(
            f"{path}: {doubtful[0]} may be {meanings}: write digits without groups, decimals with a point"
        )
    return mark


def _elements(
    path: Path,
    points: Sequence[Line],
    places: Floats,
    columns: Columns,
    options: ImportOptions,
    labels: Mapping[str, str],
) -> list[SurveyElement]:
    """The points of each row and id, or of each code, in one element."""
    if not {"id", "label"} & columns.places.keys():
        raise OutputError(f"{path}: no column says what each point is of: name it with --columns id=NAME or label=NAME")
    groups = dict[tuple[str, str], list[int]]()
    for k, line in enumerate(points):
        groups.setdefault((columns.text(line, "row"), _key(line, columns)), []).append(k)
    elements = []
    for (row, name), group in groups.items():
        line = points[group[0]]
        text, vertices = columns.text(line, "text"), [columns.text(points[k], "vertex") for k in group]
        label = _label(line, columns, name, options, labels)
        structure = element(name, label, places[group], vertices, {"text": text} if text else {})
        elements.append(SurveyElement(row, _frame(path, line, columns, options), structure))
    return elements


def _key(line: Line, columns: Columns) -> str:
    """What all points of an element have in common: its id; else a code with a number. A point whose code has no number
    is an element by itself."""
    name, code = columns.text(line, "id"), columns.text(line, "label")
    if name or NUMBERED.fullmatch(code):
        return name or code
    return f"{code or 'point'} of line {line.number}"


def _label(line: Line, columns: Columns, name: str, options: ImportOptions, labels: Mapping[str, str]) -> str:
    """The label of an element: what the options call its code, or its code without the number; without a code, its
    id's."""
    code = columns.text(line, "label") or name
    numbered = NUMBERED.fullmatch(code)
    bare = numbered["label"] if numbered else code
    given = {theirs.casefold(): ours for theirs, ours in options.labels.items()}
    return next(
        (given[text.casefold()] for text in (code, bare) if text.casefold() in given), labels.get(code.casefold(), bare)
    )


def _frame(path: Path, line: Line, columns: Columns, options: ImportOptions) -> Frame:
    """The frame that the options, or else the line, say."""
    said = columns.text(line, "frame").casefold()
    if options.frame is not None or not said:
        return options.usual_frame
    if said not in FRAMES:
        raise OutputError(f"{path}: line {line.number}: frame is {listed([said])}, not one of {', '.join(FRAMES)}")
    return FRAMES[said]
