"""The plan of the whole site: all rows where they stand, from above, x to the right and z down the page, in
millimetres."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from savmap.report.numbers import shortened
from savmap.report.page.summary import Summary
from savmap.report.page.tables import is_tie_off, tie_hint
from savmap.report.row_views import camera_paths, drawn_in
from savmap.report.scene import MM, Figure, Label, Layer, Shape, frame_of, joined, metre_grid, path
from savmap.types import CrossRowMatch, Drawing, Floats, Placement, SiteMap

_MARGIN, _BETWEEN_M = 2500.0, 1.5
_TIES = {"tie": "seen from two rows", "tie off": "seen from two rows, off by more than 3 \u03c3"}


def site_plan(rows: Sequence[Summary], site: SiteMap) -> Figure | None:
    """Rows by their places in the site's frame; those without one stacked beneath; None where there is nothing to
    show."""
    drawn = {row.name: row for row in rows if row.row and drawn_in(row.drawings, "plan")}
    places = {name: place for name, place in site.placements.items() if name in drawn or name in site.failed}
    if not drawn and not places:
        return None
    places |= _stacked([row for name, row in drawn.items() if name not in places], _corner(drawn, places))
    points = [_in_plan(outline, places[name]) for name, row in drawn.items() for outline in _outlines(row)]
    origins = [_origin(place)[None] for place in places.values()]
    frame = frame_of(np.concatenate([*points, *origins]), _MARGIN, (0.15, 0.0))
    grid, labels = metre_grid(frame, down=1)
    layers = [layer for name, row in drawn.items() for layer in _row_layers(row, places[name])]
    styles: dict[str, list[Shape]] = {style: [] for style in _TIES}
    for tie in site.matches:
        point = _tie_point(site, tie)
        if point is not None and tie.row_a in places:
            dot = path(_in_plan(point, places[tie.row_a]))
            styles["tie off" if is_tie_off(tie) else "tie"].append(Shape(dot, tie_hint(tie)))
    ties = [Layer(style, tuple(shapes)) for style, shapes in styles.items() if shapes]
    failed = [row for row in rows if row.row is None and row.name in places]
    return Figure(
        id="site-plan",
        title="Plan of the site",
        description=f"{len(drawn)} rows from above, {frame[2] / MM:.0f} m by {frame[3] / MM:.0f} m.",
        frame=frame,
        layers=(grid, *layers, *ties, *(_cross(row, places[row.name]) for row in failed)),
        labels=(*labels, *(_name(row, places[row.name]) for row in (*drawn.values(), *failed))),
        legend=_legend(drawn.values(), bool(failed), ties),
        axes=("x", "z", 1),
    )


def _outlines(row: Summary) -> list[Floats]:
    """What of a row the plan must hold: points (n, 3) m in its frame."""
    return [*(drawing.points for drawing in _mapped(row)), *_cameras(row)]


def _mapped(row: Summary) -> list[Drawing]:
    return [drawing for drawing in drawn_in(row.drawings, "plan") if drawing.role != "survey"]


def _cameras(row: Summary) -> list[Floats]:
    return list(camera_paths(row.row).values()) if row.row else []


def _in_plan(points: Floats, place: Placement) -> Floats:
    """Points (n, 2) mm in the plan of points (n, 3) m in a row's frame."""
    flat: Floats = MM * place.points(points)[:, [0, 2]]
    return flat


def _origin(place: Placement) -> Floats:
    origin: Floats = _in_plan(np.zeros((1, 3)), place)[0]
    return origin


def _corner(drawn: Mapping[str, Summary], places: Mapping[str, Placement]) -> tuple[float, float]:
    """The left lower corner (x, z), m, beneath the rows that have a place."""
    points = [_in_plan(outline, places[name]) for name in drawn if name in places for outline in _outlines(drawn[name])]
    if not points:
        return 0.0, 0.0
    x, z = np.concatenate(points).T / MM
    return float(x.min()), float(z.max()) + 2 * _BETWEEN_M


def _stacked(rows: Sequence[Summary], corner: tuple[float, float]) -> dict[str, Placement]:
    """Places for rows that have none: one beneath the other from a corner (x, z) m on."""
    places, (left, low) = {}, corner
    for row in rows:
        z = np.concatenate(_outlines(row))[:, 2]
        places[row.name] = Placement(left, low - float(z.min()), 0.0, np.zeros((3, 3)))
        low += float(np.ptp(z)) + _BETWEEN_M
    return places


def _row_layers(row: Summary, place: Placement) -> list[Layer]:
    """A row's camera, fixtures and structure, and over them a strip that leads to its section."""
    styles: dict[str, list[tuple[Floats, bool]]] = {
        "camera": [(_in_plan(track, place), False) for track in _cameras(row)]
    }
    face = _face(row)
    strip = path(_in_plan(face, place))
    for drawing in _mapped(row):
        outline = (_in_plan(drawing.points, place), drawing.kind == "polygon")
        styles.setdefault(f"{drawing.role} {drawing.tone} {drawing.kind}", []).append(outline)
    layers = [Layer(style, (Shape(joined(outlines)),)) for style, outlines in styles.items() if outlines]
    link = Layer("strip", (Shape(strip, _hint(row)),), f"#{row.anchor}")
    return [Layer("base", (Shape(strip),)), *layers, link]


def _face(row: Summary) -> Floats:
    """The ends (2, 3) of the structure, or of whatever is drawn, along the row's x axis on its face."""
    structure = [drawing.points for drawing in _mapped(row) if drawing.tone == "structure"] or _outlines(row)
    x = np.concatenate(structure)[:, 0]
    return np.array([[x.min(), 0.0, 0.0], [x.max(), 0.0, 0.0]])


def _hint(row: Summary) -> str:
    counts = ", ".join(f"{count} {label}" for label, count in row.counts.items())
    error = f"mean absolute error {100 * row.error_m:.2f} cm" if row.error_m is not None else ""
    return f"Row {row.name}: " + "; ".join(part for part in (row.status, counts, error, *row.remarks) if part)


def _cross(row: Summary, place: Placement) -> Layer:
    """A cross of a metre where a row that failed stands."""
    x, z = (round(float(value)) for value in _origin(place))
    cross = f"M{x - 500} {z - 500}l1000 1000M{x - 500} {z + 500}l1000-1000"
    return Layer("failed", (Shape(cross, f"Row {row.name} failed: {row.error}"),), f"#{row.anchor}")


def _name(row: Summary, place: Placement) -> Label:
    """The row's name before its beginning, on the side away from the row."""
    before = np.array([[_face(row)[0, 0] - 0.8 if row.row else -0.8, 0.0, 0.0]])
    x, z = (round(float(value)) for value in _in_plan(before, place)[0])
    along = place.site_from_row[0, 0]
    side = "end" if along > 0.4 else "start" if along < -0.4 else "middle"
    state = "failed" if row.row is None else "attention" if row.remarks else ""
    return Label(x, z, shortened(row.name, 18), f"name {side} {state}".strip(), f"#{row.anchor}", dy=0.35)


def _tie_point(site: SiteMap, tie: CrossRowMatch) -> Floats | None:
    """Where a structure that two rows see is in the first one: the middle (1, 3) of its vertices there."""
    row = site.rows.get(tie.row_a)
    structures = (structure for group in row.structures.values() for structure in group) if row else ()
    vertices = (structure.vertices for structure in structures if structure.id == tie.id_a)
    return next((points.mean(axis=0, keepdims=True) for points in vertices), None)


def _legend(rows: Iterable[Summary], failed: bool, ties: Sequence[Layer]) -> tuple[tuple[str, str], ...]:
    always = (("base line", "row"), ("camera line", "camera's path"))
    drawn = {f"mapped {drawing.tone} {drawing.kind}": drawing.legend for row in rows for drawing in _mapped(row)}
    shared = tuple((f"{layer.style} point", _TIES[layer.style]) for layer in ties)
    return (*always, *drawn.items(), *shared, *([("failed", "row that failed")] if failed else []))
