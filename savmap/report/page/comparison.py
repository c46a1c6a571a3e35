"""The page of a comparison: both dates of each row over one another, their orthophotos side by side, and a table of
what changed."""

import base64
import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from markupsafe import Markup

from savmap.files.atomic import write_bytes
from savmap.maps.comparison import CHANGES, Comparison, ElementChange, RowComparison, State
from savmap.maps.comparison.texts import (
    change_name,
    change_text,
    counts_text,
    motion_text,
    remarks,
    renamed_lines,
    scale_text,
)
from savmap.report.numbers import anchors
from savmap.report.orthophotos import photo_view
from savmap.report.page.tables import Cell, Line, Table, heads
from savmap.report.scene import MM, Figure, Layer, Shape, frame_of, joined, metre_grid
from savmap.report.templating import rendered, resource
from savmap.types import Drawing, Floats, Orthophoto, RowMap, SiteMap, Structure

Key = tuple[str, str]
"""Plugin and id: plugins do not know one another's ids."""
MARGIN_MM, PARTS = 500.0, (0.03, 0.03)
LEGEND = (
    ("before line", "old date"),
    ("mapped structure", "new date"),
    ("off line", "moved or changed"),
    ("gone line", "missing"),
    ("added line", "was not there"),
)
STYLES: Mapping[State, str] = {"moved": "off line", "changed": "off line", "missing": "gone line", "new": "added line"}


@dataclass(frozen=True, eq=False)
class Dates:
    """Two maps, what changed from one to the other, orthophotos by row of either date, where there are any, and the
    address of the viewer's page of both dates, where there is one."""

    old: SiteMap
    new: SiteMap
    comparison: Comparison
    old_photos: Mapping[str, Orthophoto] = field(default_factory=dict)
    new_photos: Mapping[str, Orthophoto] = field(default_factory=dict)
    title: str = "Comparison of two dates"
    viewer: str = ""


@dataclass(frozen=True, eq=False)
class RowSection:
    """A row of the page: name, anchor, what is said of it, pictures, orthophotos and the table."""

    name: str
    anchor: str
    motion: str
    scale: str
    counts: str
    warnings: tuple[str, ...]
    figures: tuple[Figure, ...]
    photos: tuple[Figure, ...]
    table: Table


def write_comparison(dates: Dates, path: Path) -> None:
    """Write the page as one HTML file, whole or not at all. Raises OutputError."""
    write_bytes(path, comparison_page(dates).encode())


def comparison_page(dates: Dates) -> str:
    """The page. It loads nothing, and only its own script may run in it (by its digest)."""
    script = resource("page.js")
    names = anchors([row.new for row in dates.comparison.rows])
    return rendered(
        "comparison.html.jinja",
        dates=dates,
        style=Markup(resource("figure.css") + resource("page.css")),
        script=Markup(script),
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        sections=[_section(dates, row, names[row.new]) for row in dates.comparison.rows],
        tiles=_tiles(dates.comparison),
        renamed=list(renamed_lines(dates.comparison)),
    )


def _tiles(comparison: Comparison) -> list[tuple[str, str]]:
    """What the reader wants to know first."""
    elements = [one for row in comparison.rows for one in row.elements]
    openings = [one for row in comparison.rows for one in row.openings]
    tiles = [("rows compared", str(sum(row.motion is not None for row in comparison.rows)))]
    tiles += [("rows missing", str(len(comparison.missing)))] if comparison.missing else []
    tiles += [("rows new", str(len(comparison.new)))] if comparison.new else []
    scaled = sum(row.scale_differs for row in comparison.rows)
    tiles += [("rows of another scale", str(scaled))] if scaled else []
    for state in ("same", *CHANGES, "not seen"):
        tiles.append((state, str(sum(one.state == state for one in elements))))
    return [*tiles, ("openings changed", str(sum(one.state in CHANGES for one in openings)))]


def _section(dates: Dates, row: RowComparison, anchor: str) -> RowSection:
    drawn = row.motion is not None
    return RowSection(
        row.new,
        anchor,
        motion_text(row.motion),
        scale_text(row),
        counts_text(row),
        remarks(row),
        (_elevation(dates, row, anchor),) if drawn else (),
        tuple(_photos(dates, row, anchor)),
        change_table(row, f"{anchor}-changes"),
    )


def _structures(row: RowMap) -> dict[Key, Structure]:
    return {(plugin, one.id): one for plugin, group in row.structures.items() for one in group}


def _elevation(dates: Dates, row: RowComparison, anchor: str) -> Figure:
    """Both dates over one another, in the new row's frame, in millimetres, as one faces the row."""
    motion = row.motion
    old, new = _structures(dates.old.rows[row.old]), _structures(dates.new.rows[row.new])
    carried = {key: motion.points(one.vertices) if motion else one.vertices for key, one in old.items()}
    points = [_flat(part) for part in (*carried.values(), *(one.vertices for one in new.values()), np.zeros((1, 3)))]
    frame = frame_of(np.concatenate(points), MARGIN_MM, PARTS)
    grid, labels = metre_grid(frame, -1)
    before = Shape(joined(line for key, one in old.items() for line in _lines(carried[key], one)))
    after = Shape(joined(line for one in new.values() for line in _lines(one.vertices, one)))
    layers = [grid, Layer("before line", (before,)), Layer("mapped structure", (after,))]
    for state, style in STYLES.items():
        shapes = tuple(_changed(row, state, old, carried, new))
        layers += [Layer(style, shapes)] if shapes else []
    return Figure(
        f"{anchor}-face",
        f"Row {row.new}: both dates",
        f"The row as one faces it, on both dates: {counts_text(row)}.",
        frame,
        tuple(layers),
        labels,
        LEGEND,
        ("x", "y", -1),
        "x along the row, y above the floor, in the new map's frame",
    )


def _changed(
    row: RowComparison,
    state: State,
    old: Mapping[Key, Structure],
    carried: Mapping[Key, Floats],
    new: Mapping[Key, Structure],
) -> Iterator[Shape]:
    """A shape with its hint for each element in a state."""
    for change in row.elements:
        if change.state == state:
            hint = f"{change_name(change)}: {state} {change_text(change)}"
            if change.new_id:
                structure = new[change.plugin, change.new_id]
                yield Shape(joined(_lines(structure.vertices, structure)), hint)
            elif change.old_id:
                key = change.plugin, change.old_id
                yield Shape(joined(_lines(carried[key], old[key])), hint)


def _flat(points: Floats) -> Floats:
    flat: Floats = points[:, :2] * np.array([MM, -MM])
    return flat


def _lines(vertices: Floats, structure: Structure) -> Iterable[tuple[Floats, bool]]:
    """A structure's edges, or its points where it has none."""
    flat = _flat(vertices)
    if len(structure.edges):
        return [(flat[edge], False) for edge in structure.edges]
    return [(flat[k : k + 1], False) for k in range(len(flat))]


def _photos(dates: Dates, row: RowComparison, anchor: str) -> Iterator[Figure]:
    """The orthophotos of both dates with the outlines of what changed."""
    photos = dates.old_photos.get(row.old), dates.new_photos.get(row.new)
    maps = _structures(dates.old.rows[row.old]), _structures(dates.new.rows[row.new])
    if photos[0] is None or photos[1] is None:
        return
    changes = [one for one in row.elements if one.state in CHANGES]
    for date, photo, structures in zip(("old", "new"), photos, maps, strict=True):
        keys = [(one.plugin, name) for one in changes if (name := one.old_id if date == "old" else one.new_id)]
        drawings = [_outline(structures[key]) for key in keys]
        if photo is not None:
            yield photo_view(f"{row.new}, {date}", photo, drawings, None, f"{anchor}-{date}")


def _outline(structure: Structure) -> Drawing:
    """The corners in order around the middle."""
    x, y = (structure.vertices - structure.vertices.mean(axis=0))[:, :2].T
    around = structure.vertices[np.argsort(np.arctan2(y, x))]
    return Drawing("polygon", around, "off", "structure", "changed", ("face",), name=structure.id)


@dataclass(frozen=True, eq=False)
class RowChanges:
    """What a report says of a row that an earlier map has, too."""

    name: str
    motion: str
    scale: str
    warnings: tuple[str, ...]
    counts: str
    table: Table


def row_changes(comparison: Comparison) -> list[RowChanges]:
    """The rows that both dates have, without pictures."""
    return [
        RowChanges(
            row.new,
            motion_text(row.motion),
            scale_text(row),
            remarks(row),
            counts_text(row),
            change_table(row, f"changes-{number}"),
        )
        for number, row in enumerate(comparison.rows, 1)
    ]


def change_table(row: RowComparison, anchor: str) -> Table:
    """What changed, and of what no one can tell."""
    shown = [*row.changes, *(one for one in row.elements if one.state == "not seen")]
    return Table(
        anchor,
        "What is not as it was, or was not seen on one of the dates",
        heads("'element", "'state", "'what", "sigmas", "p"),
        tuple(Line(tuple(_cells(one)), "off" if one.state in CHANGES else "") for one in _ordered(shown)),
    )


def _ordered(changes: Sequence[ElementChange]) -> list[ElementChange]:
    order = {state: k for k, state in enumerate(("missing", "new", "moved", "changed", "not seen"))}
    return sorted(changes, key=lambda one: (order.get(one.state, 9), float(one.position_m[0])))


def _cells(change: ElementChange) -> Iterator[Cell]:
    yield Cell(change_name(change))
    yield Cell(change.state)
    yield Cell(change_text(change), style="words")
    sigmas = max((one.sigmas for one in change.significant), default=0.0)
    yield Cell(f"{sigmas:.1f}", sigmas) if sigmas else Cell("")
    yield Cell(f"{change.p:.0e}", change.p) if change.differences else Cell("")
