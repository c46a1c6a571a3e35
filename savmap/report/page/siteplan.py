"""The plan of the whole site: every row where it stands, from above, x to the right and z down the page, in millimetres."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from savmap.report.drawing import Drawing
from savmap.report.page.figures import MM, Figure, Label, Layer, Shape, frame_of, joined, metre_grid, path
from savmap.report.page.numbers import shortened
from savmap.report.page.rowviews import camera_paths
from savmap.report.page.summary import Summary
from savmap.report.page.ties import is_tie_off, tie_words
from savmap.report.plots import drawn_in
from savmap.types import CrossRowMatch, Floats, Placement, SiteMap

_MARGIN, _BETWEEN_M = 2500.0, 1.5


def site_plan(rows: Sequence[Summary], site: SiteMap) -> Figure | None:
    """Rows by their places in the site's frame; those without one stacked beneath; None where there is nothing to show."""
    drawn = {row.name: row for row in rows if row.row and drawn_in(row.drawings, "plan")}
    places = {name: own for name, own in site.placements.items() if name in drawn or name in site.failed}
    if not drawn and not places:
        return None
    places |= _stacked([row for name, row in drawn.items() if name not in places], _reach(drawn, places))
    points = [_moved(own, places[name]) for name, row in drawn.items() for own in _outline(row)]
    frame = frame_of(np.concatenate([*points, *(_origin(own)[None] for own in places.values())]), _MARGIN, (0.15, 0.0))
    grid, marks = metre_grid(frame, flipped=False)
    layers = [layer for name, row in drawn.items() for layer in _row_layers(row, places[name])]
    ties = _tie_layer(site, places)
    lost = [row for row in rows if row.row is None and row.name in places]
    return Figure(
        id="site-plan",
        title="Plan of the site",
        description=f"{len(drawn)} rows from above, {frame[2] / MM:.0f} m by {frame[3] / MM:.0f} m.",
        frame=frame,
        layers=(grid, *layers, *ties, *(_lost(row, places[row.name]) for row in lost)),
        labels=(*marks, *(_name(row, places[row.name]) for row in (*drawn.values(), *lost))),
        legend=_legend(drawn.values(), bool(lost), ties),
        axes=("x", "z", 1),
    )


def without_place(rows: Sequence[Summary], site: SiteMap) -> list[str]:
    """Names of the rows whose place in the site's frame is not known."""
    return [row.name for row in rows if row.name not in site.placements]


def _outline(row: Summary) -> list[Floats]:
    """What of a row the plan must hold: points (n, 3) m in its frame."""
    drawings = [own.points for own in _mapped(row)]
    return [*drawings, *(camera_paths(row.row) if row.row else [])]


def _mapped(row: Summary) -> list[Drawing]:
    return [own for own in drawn_in(row.drawings, "plan") if own.role != "survey"]


def _moved(points: Floats, place: Placement) -> Floats:
    """Points (n, 2) mm in the plan of points (n, 3) m in a row's frame."""
    flat: Floats = MM * place.points(points)[:, [0, 2]]
    return flat


def _origin(place: Placement) -> Floats:
    origin: Floats = _moved(np.zeros((1, 3)), place)[0]
    return origin


def _reach(drawn: Mapping[str, Summary], places: Mapping[str, Placement]) -> tuple[float, float]:
    """Left end and lower end, m, of the rows that have a place."""
    points = [_moved(own, places[name]) for name, row in drawn.items() if name in places for own in _outline(row)]
    if not points:
        return 0.0, 0.0
    every = np.concatenate(points) / MM
    return float(every[:, 0].min()), float(every[:, 1].max()) + 2 * _BETWEEN_M


def _stacked(rows: Sequence[Summary], corner: tuple[float, float]) -> dict[str, Placement]:
    """Places for rows that have none: side by side from a corner (x, z) m on."""
    found, (left, low) = {}, corner
    for row in rows:
        z = np.concatenate(_outline(row))[:, 2]
        found[row.name] = Placement(left, low - float(z.min()), 0.0, np.zeros((3, 3)))
        low += float(np.ptp(z)) + _BETWEEN_M
    return found


def _row_layers(row: Summary, place: Placement) -> list[Layer]:
    """A row's fixtures, camera and structure, and over them a strip that leads to its section."""
    link = f"#{row.anchor}"
    looks: dict[str, list[tuple[Floats, bool]]] = {}
    for own in _mapped(row):
        entry = (_moved(own.points, place), own.kind == "polygon")
        looks.setdefault(f"{own.role} {own.tone} {own.kind}", []).append(entry)
    cameras = [(_moved(track, place), False) for track in (camera_paths(row.row) if row.row else [])]
    found = [Layer(look, (Shape(joined(every)),)) for look, every in looks.items()]
    camera = [Layer("camera", (Shape(joined(cameras)),))] if cameras else []
    face = _face(row)
    strip = path(_moved(face, place))
    base = [Layer("base", (Shape(strip),))] if len(face) > 1 else []
    return [*camera, *base, *found, Layer("strip", (Shape(strip, _said(row)),), link)]


def _face(row: Summary) -> Floats:
    """The ends (2, 3) of the structure, or of whatever is drawn, along the row's x axis on its face."""
    structure = [own.points for own in _mapped(row) if own.tone == "structure"] or _outline(row)
    x = np.concatenate(structure)[:, 0]
    return np.array([[x.min(), 0.0, 0.0], [x.max(), 0.0, 0.0]])


def _said(row: Summary) -> str:
    counts = ", ".join(f"{count} {label}" for label, count in row.counts.items())
    error = f"mean absolute error {100 * row.error_m:.2f} cm" if row.error_m is not None else ""
    return f"Row {row.name}: " + "; ".join(part for part in (row.status, counts, error, *row.remarks) if part)


def _lost(row: Summary, place: Placement) -> Layer:
    x, z = (round(float(value)) for value in _origin(place))
    cross = f"M{x - 500} {z - 500}l1000 1000M{x - 500} {z + 500}l1000-1000"
    return Layer("lost", (Shape(cross, f"Row {row.name} failed: {row.error}"),), f"#{row.anchor}")


def _name(row: Summary, place: Placement) -> Label:
    """The row's name before its beginning, on the side away from the row."""
    before = np.array([[_face(row)[0, 0] - 0.8 if row.row else -0.8, 0.0, 0.0]])
    x, z = (round(float(value)) for value in _moved(before, place)[0])
    along = place.site_from_row[0, 0]
    side = "end" if along > 0.4 else "start" if along < -0.4 else "middle"
    look = "failed" if row.row is None else "attention" if row.remarks else ""
    return Label(x, z, shortened(row.name, 18), f"name {side} {look}".strip(), f"#{row.anchor}")


def _tie_layer(site: SiteMap, places: Mapping[str, Placement]) -> list[Layer]:
    looks: dict[str, list[Shape]] = {"tie": [], "tie off": []}
    for own in site.matches:
        at = _tied(site, own)
        if at is not None and own.row_a in places:
            dot = path(_moved(at, places[own.row_a]))
            looks["tie off" if is_tie_off(own) else "tie"].append(Shape(dot, tie_words(own)))
    return [Layer(look, tuple(shapes)) for look, shapes in looks.items() if shapes]


def _tied(site: SiteMap, tie: CrossRowMatch) -> Floats | None:
    """Where a shared thing is in its first row: the middle (1, 3) of its vertices there."""
    row = site.rows.get(tie.row_a)
    every = (own for structures in row.structures.values() for own in structures) if row else ()
    return next((own.vertices.mean(axis=0, keepdims=True) for own in every if own.id == tie.id_a), None)


def _legend(rows: Iterable[Summary], lost: bool, ties: Sequence[Layer]) -> tuple[tuple[str, str], ...]:
    said = {"tie": "seen from two rows", "tie off": "seen from two rows, off by more than 3 \u03c3"}
    fixed = (("base line", "row"), ("camera line", "camera's path"))
    drawn = {f"mapped {own.tone} {own.kind}": own.legend for row in rows for own in _mapped(row)}
    shared = tuple((f"{layer.look} point", said[layer.look]) for layer in ties)
    return (*fixed, *drawn.items(), *shared, *([("lost", "row that failed")] if lost else []))
