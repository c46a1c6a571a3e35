"""Surveys out of the files that surveyors and their spreadsheets write: tables (`table`) and drawings (`drawing`) are
read to elements, which are put into their rows' frames (`places`), and the plugins make a survey's entries of them
(`survey`)."""

from collections.abc import Callable, Mapping
from pathlib import Path

from savmap.errors import OutputError
from savmap.maps.imports.records import Found, ImportOptions

DRAWINGS = (".dxf",)
TABLES = (".csv", ".tsv", ".txt", ".asc", ".xyz")
Reader = Callable[[Path, ImportOptions, Mapping[str, str]], list[Found]]


def elements_of(path: Path, options: ImportOptions, labels: Mapping[str, str]) -> list[Found]:
    """The elements that a file holds, by its ending. `labels`: those of the plugins, by themselves in lower case.
    Raises OutputError with one line: file, place, problem."""
    return _reader(path)(path, options, labels)


def _reader(path: Path) -> Reader:
    ending = path.suffix.lower()
    if ending in DRAWINGS:
        from savmap.maps.imports.drawing import read_drawing  # only here: each with its own weight

        return read_drawing
    if ending in TABLES:
        from savmap.maps.imports.table import read_table

        return read_table
    raise OutputError(f"{path}: surveys are read from {', '.join((*TABLES, *DRAWINGS))}")
