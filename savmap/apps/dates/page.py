"""The page of a comparison: both dates of each row over one another, their orthophotos side by side, and a table of
what changed."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from savmap.apps.dates.comparison.records import CHANGES, Comparison, RowComparison, State
from savmap.apps.dates.comparison.texts import (
    change_name,
    change_text,
    counts_text,
    motion_text,
    posts_texts,
    remarks,
    renamed_lines,
    scale_text,
)
from savmap.files.atomic import write_bytes
from savmap.report.numbers import anchors
from savmap.report.orthophotos import photo_view
from savmap.report.page.tables import Cell, Line, Table, heads
from savmap.report.scene import MM, Figure, Layer, Shape, frame_of, joined, metre_grid
from savmap.report.templating import rendered, rendered_page
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
ORDER = ("missing", "new", "moved", "changed", "not seen")
"""Of the states in a table."""
STYLES: Mapping[State, str] = {"moved": "off line", "changed": "off line", "missing": "gone line", "new": "added line"}


@dataclass(frozen=True, eq=False)
class Dates:
    """Two maps, what changed from one to the other, orthophotos by row of either date, where there are any, the
    address of the viewer's page of both dates, where there is one, and what either map is called, with its date."""

    old: SiteMap
    new: SiteMap
    comparison: Comparison
    old_photos: Mapping[str, Orthophoto] = field(default_factory=dict)
    new_photos: Mapping[str, Orthophoto] = field(default_factory=dict)
    title: str = "Comparison of two dates"
    viewer: str = ""
    names: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class RowSection:
    """A row that both dates have: what is said of it and the table of what changed; on the page of a comparison, also
    its anchor, pictures and orthophotos."""

    name: str
    motion: str
    scale: str
    counts: str
    posts: tuple[str, ...]
    warnings: tuple[str, ...]
    table: Table
    anchor: str = ""
    figures: tuple[Figure, ...] = ()
    photos: tuple[Figure, ...] = ()


def write_comparison(dates: Dates, path: Path) -> None:
    """Write the page as one HTML file, whole or not at all. Raises OutputError."""
    write_bytes(path, comparison_page(dates).encode())


def comparison_page(dates: Dates) -> str:
    """The page as HTML."""
    names = anchors([row.new for row in dates.comparison.rows])
    return rendered_page(
        "comparison.html.jinja",
        __package__,
        dates=dates,
        sections=[_section(dates, row, names[row.new]) for row in dates.comparison.rows],
        tiles=_tiles(dates.comparison),
        renamed=list(renamed_lines(dates.comparison)),
    )


def _tiles(comparison: Comparison) -> list[tuple[str, str]]:
    """What the reader wants to know first."""
    elements = [change for row in comparison.rows for change in row.elements]
    openings = [change for row in comparison.rows for change in row.openings]
    tiles = [("rows compared", str(sum(row.motion is not None for row in comparison.rows)))]
    tiles += [("rows missing", str(len(comparison.missing)))] if comparison.missing else []
    tiles += [("rows new", str(len(comparison.new)))] if comparison.new else []
    scaled = sum(row.scale_differs for row in comparison.rows)
    tiles += [("rows of another scale", str(scaled))] if scaled else []
    for state in ("same", *CHANGES, "not seen"):
        tiles.append((state, str(sum(change.state == state for change in elements))))
    posts = [change for change in elements if change.is_post]
    for label in dict.fromkeys(change.label for change in posts):
        hits = sum(change.hit is not None for change in posts if change.label == label)
        tiles.append((f"{label}: stand or lean otherwise", str(hits)))
    return [*tiles, ("openings changed", str(sum(change.state in CHANGES for change in openings)))]


def _section(dates: Dates, row: RowComparison, anchor: str) -> RowSection:
    figures = (_elevation(dates, row, anchor),) if row.motion is not None else ()
    photos = tuple(_photos(dates, row, anchor))
    return replace(_changes(row, f"{anchor}-changes"), anchor=anchor, figures=figures, photos=photos)


def report_section(comparison: Comparison, viewer: str) -> str:
    """What a report says of a comparison, as HTML: the rows that both dates have, without pictures."""
    rows = [_changes(row, f"changes-{number}") for number, row in enumerate(comparison.rows, 1)]
    return rendered("changes.html.jinja", __package__, comparison=comparison, rows=rows, viewer=viewer)


def _changes(row: RowComparison, table_id: str) -> RowSection:
    texts = motion_text(row.motion), scale_text(row), counts_text(row)
    return RowSection(row.new, *texts, tuple(posts_texts(row)), remarks(row), change_table(row, table_id))


def _structures(row: RowMap) -> dict[Key, Structure]:
    return {(plugin, structure.id): structure for plugin, group in row.structures.items() for structure in group}


def _elevation(dates: Dates, row: RowComparison, anchor: str) -> Figure:
    """Both dates over one another, in the new row's frame, in millimetres, as one faces the row."""
    motion = row.motion
    old, new = _structures(dates.old.rows[row.old]), _structures(dates.new.rows[row.new])
    carried = {key: motion.points(part.vertices) if motion else part.vertices for key, part in old.items()}
    points = [_flat(part) for part in (*carried.values(), *(part.vertices for part in new.values()), np.zeros((1, 3)))]
    frame = frame_of(np.concatenate(points), MARGIN_MM, PARTS)
    grid, labels = metre_grid(frame, -1)
    before = Shape(joined(line for key, part in old.items() for line in _lines(carried[key], part)))
    after = Shape(joined(line for part in new.values() for line in _lines(part.vertices, part)))
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
    changes = [change for change in row.elements if change.state in CHANGES]
    for date, photo, structures in zip(("old", "new"), photos, maps, strict=True):
        ids = [(change.plugin, change.old_id if date == "old" else change.new_id) for change in changes]
        drawings = [_outline(structures[plugin, name]) for plugin, name in ids if name]
        if photo is not None:
            yield photo_view(f"{row.new}, {date}", photo, drawings, None, f"{anchor}-{date}")


def _outline(structure: Structure) -> Drawing:
    """The corners in order around the middle."""
    x, y = (structure.vertices - structure.vertices.mean(axis=0))[:, :2].T
    around = structure.vertices[np.argsort(np.arctan2(y, x))]
    return Drawing("polygon", around, "off", "structure", "changed", ("face",), name=structure.id)


def change_table(row: RowComparison, anchor: str) -> Table:
    """What changed, and of what no one can tell."""
    shown = [*row.changes, *(change for change in row.elements if change.state == "not seen")]
    shown.sort(key=lambda change: (ORDER.index(change.state), float(change.position_m[0])))
    lines = []
    for change in shown:
        cells = (Cell(change_name(change)), Cell(change.state), Cell(change_text(change), style="words"))
        sigmas = max((difference.sigmas for difference in change.significant), default=0.0)
        of_sigmas = Cell(f"{sigmas:.1f}", sigmas) if sigmas else Cell("")
        of_p = Cell(f"{change.p:.0e}", change.p) if change.differences else Cell("")
        lines.append(Line((*cells, of_sigmas, of_p), "off" if change.state in CHANGES else ""))
    return Table(
        anchor,
        "What is not as it was, or was not seen on one of the dates",
        heads("'element", "'state", "'what", "sigmas", "p"),
        tuple(lines),
    )
