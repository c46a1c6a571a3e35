"""Surveys out of the files that surveyors and their spreadsheets write: elements, of tables (`table`), drawings
(`drawing`) and building models (`model`), are put into their rows' frames, and each plugin makes its part of each row's
entry of them.

Where rows stand in the frame of a survey is known by a map with its alignment, or by the place of each row's origin in
the user's world.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from savmap.apps.exchange.imports.records import FileElements, ImportOptions, SurveyElement, listed
from savmap.errors import OutputError, SiteError
from savmap.maps.exports.frames import Z_UP, transformed, world_from_row
from savmap.types import Alignment, Floats, RowMap, SiteMap, Structure, Survey, SurveyEntry
from savmap.types.written import FARTHEST_M

DRAWINGS = (".dxf",)
MODELS = (".ifc",)
TABLES = (".csv", ".tsv", ".txt", ".asc", ".xyz")
NEAR_M = 2.0
"""What is further from all that was mapped of a row does not belong to it."""
EntryHook = Callable[[str, Sequence[Structure]], SurveyEntry]


def elements_of(path: Path, options: ImportOptions, labels: Mapping[str, str]) -> FileElements:
    """The elements that a file holds, by its ending. `labels`: those of the plugins, by themselves and by classes of
    building models in lower case. Raises OutputError with one line: file, place, problem."""
    ending = path.suffix.lower()
    if ending in DRAWINGS:
        from savmap.apps.exchange.imports.drawing import read_drawing  # only here: it is slow to load

        return read_drawing(path, options, labels)
    if ending in MODELS:
        from savmap.apps.exchange.imports.model import read_model

        return read_model(path, options, labels)
    if ending in TABLES:
        from savmap.apps.exchange.imports.table import read_table

        return FileElements(tuple(read_table(path, options, labels)))
    raise OutputError(f"{path}: surveys are read from {', '.join((*TABLES, *DRAWINGS, *MODELS))}")


@dataclass(frozen=True, eq=False)
class RowPlaces:
    """Where rows stand: in a map (`site`), and of those named in `given`, world_from_row (4, 4)."""

    site: SiteMap | None = None
    given: Mapping[str, Floats] = field(default_factory=dict)

    def __bool__(self) -> bool:
        """Whether anything says where rows stand."""
        return self.site is not None or bool(self.given)

    @property
    def rows(self) -> list[str]:
        """The rows of which the place is known."""
        return list(dict.fromkeys((*self.given, *(self.site.rows if self.site else ()))))

    @cached_property
    def boxes(self) -> Mapping[str, Floats]:
        """The lowest and the highest coordinates (2, 3) m of what was mapped of each row, in its frame; of nothing, a
        box from which all is infinitely far."""
        return {name: _box(row) for name, row in (self.site.rows if self.site else {}).items()}

    @cached_property
    def placed(self) -> list[str]:
        """The map's rows that are placed among others."""
        return [name for name in self.site.rows if name in self.site.placements] if self.site else []

    @cached_property
    def placed_from(self) -> Mapping[str, Floats]:
        """By frame, "site" or "world", the transforms (r, 4, 4) to the frames of the rows that are placed."""
        return {frame: np.array([self.row_from(frame, row) for row in self.placed]) for frame in ("site", "world")}

    def row_from(self, frame: str, row: str) -> Floats:
        """Transform (4, 4) from a frame to a row's. Raises OutputError where the row's place in it is not known."""
        if frame == "row":
            return np.eye(4)
        if frame == "world" and row in self.given:
            return inverse(self.given[row])
        site = self.site
        if site is None or row not in site.rows:
            known_rows = f"known are {listed(self.rows)}" if self else "say --map MAP"
            more = "" if frame == "site" else f", or --place '{listed([row])}=X,Y,HEADING'"
            raise OutputError(
                f"positions are in the {frame}'s frame, in which row {listed([row])} has no place: {known_rows}{more}"
            )
        if row not in site.placements and (len(site.rows) > 1 or frame == "site"):
            raise OutputError(f"the map does not say where row {listed([row])} stands in the {frame}'s frame")
        return inverse(world_from_row(site, row) if frame == "world" else site.placements[row].site_from_row)


def inverse(transform: Floats) -> Floats:
    """A rigid transform (4, 4) the other way."""
    result = np.eye(4)
    turn = transform[:3, :3].T
    result[:3, :3], result[:3, 3] = turn, -turn @ transform[:3, 3]
    return result


def in_rows(
    elements: Sequence[SurveyElement], places: RowPlaces, row: str | None
) -> tuple[list[SurveyElement], list[str]]:
    """The elements in their rows' frames, and a note of those that belong to no row: they are far from all, or, where
    the map has a single row and nothing says that they are of it, from its face, near which others are. `row`: that of
    what names none. Raises OutputError."""
    moved, astray = list[SurveyElement](), list[str]()
    across = [_is_across(element, places, row) for element in elements]
    for element, elsewhere in zip(elements, across, strict=True):
        placed = None if elsewhere and not all(across) else _in_row(element, places, row)
        if placed is None:
            astray.append(element.structure.id)
        else:
            moved.append(placed)
    notes = [f"further than {NEAR_M:g} m from every row, left out: {len(astray)} ({listed(astray)})"] if astray else []
    return moved, notes


def _is_across(element: SurveyElement, places: RowPlaces, row: str | None) -> bool:
    """Whether an element that names no row is across an aisle, or behind the rack, of the only one."""
    if element.row or row or element.frame == "row" or len(places.rows) > 1 or not places.boxes:
        return False
    (name,) = places.rows
    middle = _moved(element, name, places).structure.vertices.mean(axis=0)
    return bool(_beyond_m(middle[None], places.boxes[name][None])[0, 2] > NEAR_M)


def _in_row(element: SurveyElement, places: RowPlaces, row: str | None) -> SurveyElement | None:
    """An element in its row, which is named, the only one, or that to whose mapped structures it is nearest; None where
    none is near."""
    if element.row or row or len(places.rows) == 1:
        return _moved(element, element.row or row or places.rows[0], places)
    if element.frame == "row" or places.site is None or places.given:
        raise OutputError(f"nothing says of which row {listed([element.structure.id])} is: say it with --row ROW")
    names = places.placed
    if not names:
        raise OutputError("the map does not say where its rows stand: say with --row of which row the survey is")
    transforms, boxes = places.placed_from[element.frame], np.array([places.boxes[name] for name in names])
    middles = transforms[:, :3] @ np.append(element.structure.vertices.mean(axis=0), 1.0)
    distances = np.linalg.norm(_beyond_m(middles, boxes), axis=1)
    best = int(np.argmin(distances))
    return _moved(element, names[best], places) if distances[best] <= NEAR_M else None


def _beyond_m(points: Floats, boxes: Floats) -> Floats:
    """How far points (n, 3) are from boxes (n, 2, 3) along each axis (n, 3), m."""
    beyond: Floats = np.maximum(np.maximum(boxes[:, 0] - points, points - boxes[:, 1]), 0.0)
    return beyond


def _box(row: RowMap) -> Floats:
    """The lowest and the highest coordinates (2, 3) m of a row's structures."""
    points = [np.zeros((0, 3)), *(part.vertices for group in row.structures.values() for part in group)]
    mapped = np.concatenate(points)
    return np.stack([mapped.min(axis=0, initial=np.inf), mapped.max(axis=0, initial=-np.inf)])


def _moved(element: SurveyElement, row: str, places: RowPlaces) -> SurveyElement:
    vertices = transformed(element.structure.vertices, places.row_from(element.frame, row))
    return SurveyElement(row, "row", replace(element.structure, vertices=vertices))


def place_of(text: str) -> tuple[str, Floats]:
    """A row and world_from_row (4, 4) of "A=12.40,3.05,3.8": x and y of its origin in the world, m, and which way its x
    axis runs there, degrees counter-clockwise from the world's; a fourth number is the height of its floor. Raises
    SiteError."""
    row, _, numbers = text.rpartition("=")
    try:
        x, y, heading, *rest = [float(number) for number in numbers.split(",")]
        (z,) = rest or (0.0,)
        if not row or not np.isfinite([x, y, z, heading]).all():
            raise ValueError
    except ValueError:
        raise SiteError(
            f"--place {listed([text])}: should be ROW=X,Y,HEADING or ROW=X,Y,HEADING,Z, in metres and degrees"
        ) from None
    transform = np.eye(4)
    transform[:3, :3] = Z_UP
    return row, Alignment(x, y, heading, np.zeros((3, 3)), z).world_from_level @ transform


@dataclass(frozen=True)
class ImportedSurvey:
    """A survey, how many elements of each label went into each row, and what was left out."""

    survey: Survey
    counts: Mapping[str, Mapping[str, int]]
    notes: tuple[str, ...] = ()

    def lines(self) -> Iterator[str]:
        """What was read, row by row, then the notes."""
        for row, counts in self.counts.items():
            yield f"row {row}: " + ", ".join(f"{count} {label}" for label, count in counts.items())
        yield from (f"note: {note}" for note in self.notes)


def survey_of(
    elements: Sequence[SurveyElement], plugins: Mapping[str, Sequence[str]], entry_of: EntryHook
) -> ImportedSurvey:
    """A survey of elements in their rows' frames. `plugins`: the labels that each takes. `entry_of(plugin, elements)`
    asks one. Raises OutputError where no element has a label that a plugin takes, or a plugin refuses them."""
    plugin_of = {label.casefold(): (plugin, label) for plugin, labels in plugins.items() for label in labels}
    taken = dict[str, dict[str, list[Structure]]]()
    others = Counter[str]()
    for element in elements:
        plugin, label = plugin_of.get(element.structure.label.casefold(), ("", ""))
        if plugin:
            structure = replace(element.structure, label=label)
            taken.setdefault(element.row, {}).setdefault(plugin, []).append(structure)
        else:
            others[element.structure.label] += 1
    if not taken:
        names = listed(label for _, label in plugin_of.values())
        raise OutputError(f"nothing in it is called {names}, but {listed(others)}: say --layer NAME=LABEL")
    notes = []
    if others:
        left = listed(f"{count} {name}" for name, count in others.items())
        notes.append(f"labels that no plugin takes, left out: {left}")
    rows, counts = dict[str, dict[str, object]](), dict[str, dict[str, int]]()
    for row, by_plugin in taken.items():
        rows[row], counts[row] = {}, {}
        for plugin in (name for name in plugins if name in by_plugin):
            structures = by_plugin[plugin]
            entry = _entry(row, plugin, structures, entry_of)
            rows[row] |= entry.values
            notes += _left_out(row, entry.left_out)
            counts[row] |= Counter(structure.label for structure in structures if structure.id not in entry.left_out)
    return ImportedSurvey(Survey(rows), counts, tuple(notes))


def _left_out(row: str, reasons: Mapping[str, str]) -> Iterator[str]:
    """A line for each reason why elements, by their ids, are left out."""
    for why in dict.fromkeys(reasons.values()):
        names = [name for name, reason in reasons.items() if reason == why]
        yield f"row {row}: {listed(names)} {'is' if len(names) == 1 else 'are'} left out: {why}"


def _entry(row: str, plugin: str, structures: Sequence[Structure], entry_of: EntryHook) -> SurveyEntry:
    far = [structure.id for structure in structures if not (np.abs(structure.vertices) <= FARTHEST_M).all()]
    if far:
        raise OutputError(
            f"row {listed([row])}: {listed(far[:1])} is more than {FARTHEST_M:g} m from the row: wrong unit or frame?"
        )
    try:
        return entry_of(plugin, structures)
    except OutputError as error:
        raise OutputError(f"row {listed([row])}: {error}") from error
