"""What is read out of a surveyor's file, and how it is to be read."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from savmap.errors import OutputError, SiteError
from savmap.files.atomic import reason
from savmap.files.texts import MOST_MB, bounded_bytes
from savmap.types import Attribute, Floats, Structure

Frame = Literal["row", "site", "world"]
FRAMES: Mapping[str, Frame] = {"row": "row", "site": "site", "world": "world"}
UNITS: Mapping[str, float] = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
"""Metres of each unit of length that is read."""
MOST_POINTS = 1_000_000
"""Of a file: a hall's rows have some ten thousand."""
MOST_NAMED, LONGEST_NAME = 8, 40
"""How many names, and how many letters of each, a message holds."""


@dataclass(frozen=True)
class ImportOptions:
    """How files are read.

    columns: of a table, for "row", "id", "label", "vertex", "x", "y", "z" and "text", the name or the number (from 1)
    of its column. labels: what a layer or a code of the file is called here. unit: that of all lengths (None: what the
    file says, or metres). row: the row of what names none. frame: of all positions (None: what the file says; else the
    world's where `placed` says that rows' places are known, else the row's).
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)
    unit: str | None = None
    row: str | None = None
    frame: Frame | None = None
    placed: bool = False

    @property
    def usual_frame(self) -> Frame:
        """Of positions whose file says none."""
        return self.frame or ("world" if self.placed else "row")


MEANINGS = ("row", "frame", "id", "label", "vertex", "x", "y", "z", "text")
"""Of a table's columns."""


def options_of(
    columns: Mapping[str, str],
    labels: Mapping[str, str],
    unit: str | None,
    row: str | None,
    frame: str | None,
    placed: bool,
) -> ImportOptions:
    """The options, checked. Raises SiteError for one that names no column, unit or frame."""
    unknown = [name for name in columns if name not in MEANINGS]
    if unknown:
        raise SiteError(f"--columns {listed(unknown)}: columns are {', '.join(MEANINGS)}")
    if unit not in (None, *UNITS):
        raise SiteError(f"--unit {listed([str(unit)])}: units are {', '.join(UNITS)}")
    if frame not in (None, *FRAMES):
        raise SiteError(f"--frame {listed([str(frame)])}: frames are {', '.join(FRAMES)}")
    return ImportOptions(columns, labels, unit, row, None if frame is None else FRAMES[frame], placed)


@dataclass(frozen=True, eq=False)
class SurveyElement:
    """An element of a file: its row ("" where the file names none), the frame of its vertices, and what is known of it,
    m."""

    row: str
    frame: Frame
    structure: Structure


@dataclass(frozen=True, eq=False)
class FileElements:
    """The elements of a file, and notes on what was left out."""

    elements: tuple[SurveyElement, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ModelRequest:
    """How a building model is to be read. `labels`: those of the plugins, by themselves and by classes of IFC in lower
    case."""

    options: ImportOptions
    labels: Mapping[str, str]


def element(
    name: str,
    label: str,
    points: Floats,
    vertices: Sequence[str] = (),
    attributes: Mapping[str, Attribute] | None = None,
) -> Structure:
    """An element with points (n, 3) m, whose errors are not known."""
    count = len(points)
    labels, no_edges = tuple(vertices) or ("",) * count, np.zeros((0, 2), np.int64)
    return Structure(name, label, points, np.zeros((count, 3, 3)), labels, no_edges, dict(attributes or {}))


def bytes_of(path: Path, most_mb: float = MOST_MB) -> bytes:
    """What a file holds. Raises OutputError."""
    try:
        return bounded_bytes(path, most_mb)
    except OSError as error:
        raise OutputError(f"{path}: cannot be read ({reason(error)})") from error
    except ValueError as error:
        raise OutputError(f"{path}: {error}") from error


def listed(names: Iterable[str]) -> str:
    """Some of the names, shortened, for a message."""
    given = list(dict.fromkeys(names))
    shown = [name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…" for name in given[:MOST_NAMED]]
    more = f" and {len(given) - MOST_NAMED} more" if len(given) > MOST_NAMED else ""
    return ", ".join(shown) + more if shown else "none"
