"""A map as a drawing, DXF R2010, by the library `ezdxf`: metres.

In the model space: the wireframe of all rows at its place in the world, on layers "3D LABEL"; below it, rows side by
side, each row's elevation, which looks at its face, with dimensions, and its plan, which looks down, on layers
"ELEVATION LABEL", "PLAN LABEL", "TEXT" and "DIMENSIONS". Both have x along the row. In the elevation y points up; in
the plan, away from who faces the row. What is known of a structure is in the extended data (`SAVMAP`) of its lines.
"""

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from savmap.errors import visible
from savmap.files.atomic import write_text
from savmap.maps.exports import require_library
from savmap.maps.exports.hull import hull
from savmap.maps.exports.marks import bytes_of, colours, remarks, sigmas, unique
from savmap.maps.exports.models.bodies import Part, RowParts, depth_note, parts_of
from savmap.types import Floats, RowMap, SiteMap, Structure
from savmap.types.common import array_record

APP = "SAVMAP"
METRES = 6
MARGIN_M, BETWEEN_M = 5.0, 3.0
"""Between the world and the drawings below it, and between drawings."""
TEXT_M, TITLE_M = 0.05, 0.3
"""Heights of letters."""
CHAIN_M = 0.4
"""Between a row and its chains of dimensions."""
SAME_M = 0.005
"""Heights that differ by less are one in a chain of dimensions."""
SKEW = 1e-3
"""What is askew by less is seen straight on."""
COLUMN, BEAM = "IfcColumn", "IfcBeam"
LONGEST_TEXT, LONGEST_NOTE, LONGEST_LAYER, LONGEST_DATA = 60, 200, 100, 250
"""Letters, of captions and of notes; bytes of a text of extended data, of which DXF allows 255."""
NO_LAYER_LETTERS = re.compile(r"[<>/\\\\\":;?*|=,`'%^\s]+")
CODED = re.compile(r"\\(?=[UM]\+)")
STYLE = {
    "dimtxt": 0.1,
    "dimasz": 0.08,
    "dimexe": 0.05,
    "dimexo": 0.05,
    "dimgap": 0.03,
    "dimtad": 1,
    "dimdec": 3,
    "dimzin": 0,
    "dimlunit": 2,
    "dimdsep": ord("."),
}
"""Dimensions to the millimetre, with letters of 10 cm."""


def write_dxf(site: SiteMap, path: Path) -> None:
    """The map as one drawing. Raises OutputError where rows have no common frame, or `ezdxf` is missing."""
    require_library("ezdxf", "cad")
    write_text(path, dxf_text(site))


def dxf_text(site: SiteMap) -> str:
    """The file's text."""
    import ezdxf

    rows = parts_of(site)
    with _without_dates(ezdxf.options):
        document = ezdxf.new("R2010", units=METRES)
        drawing = _Drawing(document, [part.structure.label for row in rows for part in row.parts])
        for row in rows:
            for part in row.parts:
                drawing.wireframe(part)
        points = [np.zeros((0, 3)), *(part.structure.vertices for row in rows for part in row.parts)]
        world = np.concatenate(points)[:, :2]
        corner = world.min(axis=0) - [0.0, MARGIN_M] if len(world) else np.zeros(2)
        for row in rows:
            corner = corner + np.array([drawing.sheet(row, site.rows[row.name], corner) + BETWEEN_M, 0.0])
        for kind in sorted(document.entitydb.dxf_types_in_use()):
            document.classes.add_class(kind)  # ezdxf itself would add them in another order in each process
        stream = io.StringIO()
        document.write(stream)
    return stream.getvalue()


@contextmanager
def _without_dates(options: Any) -> Iterator[None]:
    """The same map gives the same file: ezdxf writes no dates and no random identifiers."""
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


def drawn_text(text: str, longest: int = LONGEST_TEXT) -> str:
    """A text as drawings show it: one line, nothing of which is taken for a code."""
    shown = visible(text)
    cut = shown if len(shown) <= longest else f"{shown[: longest - 1]}…"
    return CODED.sub(r"\\U+005C", cut.replace("%%", "%%%%%%").replace("^", "^ "))


@dataclass(frozen=True, eq=False)
@array_record
class Shape:
    """Lines of a structure in a drawing: points (n, 2) m from the row's origin, closed or not."""

    structure: Structure
    points: Floats
    closed: bool


@dataclass(frozen=True)
class Dimension:
    """A length in a drawing, from one point to another, along x or upright; its line is at `line`: the other
    coordinate."""

    start: tuple[float, float]
    end: tuple[float, float]
    line: float
    upright: bool


def _shapes(row: RowMap, axes: tuple[int, int], way: float) -> Iterator[Shape]:
    """A row's solids, or the edges of what has none, along two of its axes, the other of which may be turned round. A
    solid is its outline where it is looked at along its depth, else all that it covers."""
    turn = np.array([1.0, way])
    for structure in _structures(row):
        if structure.solid is not None:
            outline, depth = structure.solid.outline, structure.solid.depth
            if np.abs(depth[[*axes]]).max() < SKEW * np.linalg.norm(depth):
                yield Shape(structure, outline[:, axes] * turn, closed=True)
            else:
                flat = np.concatenate([outline, outline + depth])[:, axes] * turn
                yield Shape(structure, hull(flat), closed=True)
            continue
        flat = structure.vertices[:, axes] * turn
        for points in [flat[edge] for edge in structure.edges] or [flat[k : k + 1] for k in range(len(flat))]:
            yield Shape(structure, points, closed=False)


def _structures(row: RowMap) -> list[Structure]:
    return [structure for group in row.structures.values() for structure in group]


def _corners(shapes: Sequence[Shape]) -> tuple[Floats, Floats]:
    """The lower left and the upper right corner (2,) of all shapes; the origin twice where there is none."""
    points = np.concatenate([np.zeros((0, 2)), *(shape.points for shape in shapes)])
    return (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))


def dimensions(row: RowMap, below: float, left: float) -> list[Dimension]:
    """What an elevation is dimensioned with: clear widths between neighbouring columns, from the first column's outer
    side to the last one's, and, in each width, the heights of the beams' upper sides. `below`, `left`: where the
    chains' lines begin."""
    reach: dict[str, list[tuple[float, float, float]]] = {COLUMN: [], BEAM: []}
    for structure in _structures(row):
        if structure.solid and structure.solid.ifc_class in reach:
            x, y = structure.solid.outline[:, 0], structure.solid.outline[:, 1]
            reach[structure.solid.ifc_class].append((float(x.min()), float(x.max()), float(y.max())))
    spans = sorted(reach[COLUMN])
    if not spans:
        return []
    gaps = [(a[1], b[0]) for a, b in pairwise(spans) if b[0] > a[1]]
    widths = [Dimension((a, 0.0), (b, 0.0), below, False) for a, b in gaps]
    total = Dimension((spans[0][0], 0.0), (max(span[1] for span in spans), 0.0), below - 0.4, False)
    heights = [
        Dimension((a + left, low), (a + left, high), a + left, True)
        for a, b in gaps
        for low, high in pairwise(_levels(top for start, end, top in reach[BEAM] if a <= (start + end) / 2 <= b))
    ]
    return [*widths, total, *heights]


def _levels(tops: Iterator[float]) -> list[float]:
    """The floor and the upper sides of beams, upwards."""
    levels = [0.0]
    for top in sorted(tops):
        if top - levels[-1] > SAME_M:
            levels.append(top)
    return levels


class _Drawing:
    """A DXF document as it grows."""

    def __init__(self, document: Any, labels: Sequence[str]) -> None:
        self.document, self.space = document, document.modelspace()
        document.appids.new(APP)
        document.dimstyles.new(APP, dxfattribs=STYLE)
        palette = colours(labels)
        shown = [NO_LAYER_LETTERS.sub("_", visible(label))[:LONGEST_LAYER] or "_" for label in palette]
        self.layers = dict(zip(palette, unique(shown, str.casefold, "{} {}"), strict=True))
        for kind in ("3D", "ELEVATION", "PLAN"):
            for label, name in self.layers.items():
                layer = document.layers.add(f"{kind} {name}")
                layer.rgb = bytes_of(palette[label])
        for name in ("TEXT", "DIMENSIONS"):
            document.layers.add(name)

    def wireframe(self, part: Part) -> None:
        """A structure at its place in the world: its solid's edges, or its edges, or its vertices."""
        on = self._layer("3D", part.structure)
        if part.body is not None:
            count = len(part.body.outline)
            around = [(k, (k + 1) % count) for k in range(count)]
            edges = [*around, *((a + count, b + count) for a, b in around), *((k, k + count) for k in range(count))]
            points = part.body.points
        else:
            edges, points = part.structure.edges.tolist(), part.structure.vertices
        entities = [self.space.add_line(points[a], points[b], dxfattribs=on) for a, b in edges]
        for entity in entities or [self.space.add_point(point, dxfattribs=on) for point in points]:
            entity.set_xdata(APP, _extended_data(part))

    def sheet(self, parts: RowParts, row: RowMap, corner: Floats) -> float:
        """The drawings of a row right of and below a corner (2,): title, elevation, plan, what of its depths is
        assumed, and what must be checked. How wide they are, m."""
        front, above = list(_shapes(row, (0, 1), 1.0)), list(_shapes(row, (0, 2), -1.0))
        (low, high), (near, far) = _corners(front), _corners(above)
        left = min(low[0], near[0])
        start = corner - [left, high[1] + TITLE_M + CHAIN_M]
        self._text(f"row {parts.name}", TITLE_M, corner - [0.0, TITLE_M])
        for shape in front:
            self._outline("ELEVATION", shape, start)
            place = tuple(start + (shape.points.min(axis=0) + shape.points.max(axis=0)) / 2)
            caption = drawn_text(shape.structure.id)
            text = self.space.add_text(caption, dxfattribs={"layer": "TEXT", "height": TEXT_M})
            text.dxf.update({"halign": 1, "valign": 2, "insert": place, "align_point": place})
        for dimension in dimensions(row, min(low[1], 0.0) - CHAIN_M, CHAIN_M):
            self._dimension(dimension, start)
        beneath = start + np.array([0.0, min(low[1], 0.0) - 2 * CHAIN_M - BETWEEN_M - far[1]])
        for shape in above:
            self._outline("PLAN", shape, beneath)
        for number, note in enumerate(filter(None, (depth_note([parts]), *remarks([row]))), 1):
            self._text(note, 2 * TEXT_M, beneath + np.array([left, near[1] - 4 * number * TEXT_M]), LONGEST_NOTE)
        return float(max(high[0], far[0]) - left)

    def _outline(self, kind: str, shape: Shape, start: Floats) -> None:
        points, on = [tuple(point) for point in shape.points + start], self._layer(kind, shape.structure)
        if len(points) == 1:
            self.space.add_point(points[0], dxfattribs=on)
        else:
            self.space.add_lwpolyline(points, close=shape.closed, dxfattribs=on)

    def _text(self, text: str, height: float, place: Floats, longest: int = LONGEST_TEXT) -> None:
        on = {"layer": "TEXT", "height": height}
        self.space.add_text(drawn_text(text, longest), dxfattribs=on).set_placement(tuple(place))

    def _dimension(self, dimension: Dimension, start: Floats) -> None:
        line = (dimension.line, 0.0) if dimension.upright else (0.0, dimension.line)
        self.space.add_linear_dim(
            base=tuple(start + line),
            p1=tuple(start + dimension.start),
            p2=tuple(start + dimension.end),
            angle=90.0 if dimension.upright else 0.0,
            dimstyle=APP,
            dxfattribs={"layer": "DIMENSIONS"},
        ).render()

    def _layer(self, kind: str, structure: Structure) -> dict[str, str]:
        return {"layer": f"{kind} {self.layers[structure.label]}"}


def _extended_data(part: Part) -> list[tuple[int, str | int | float]]:
    """What an entity is part of: row, plugin, id, label, whether the depth is assumed, the largest sigma, m, and what
    is written on it."""

    def data(text: str) -> tuple[int, str]:
        return 1000, drawn_text(text, LONGEST_DATA).encode()[:LONGEST_DATA].decode("utf-8", "ignore")

    structure, spread = part.structure, sigmas(part.structure)
    names = [data(text) for text in (part.row, part.plugin, structure.id, structure.label)]
    text = str(structure.attributes.get("text", ""))
    figures = [(1070, int(part.assumed)), (1040, float(spread.max()) if spread.size else 0.0)]
    return [*names, *figures, *([data(text)] if text else [])]
