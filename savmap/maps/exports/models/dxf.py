"""A map as a drawing, DXF R2010, by the library `ezdxf`: metres.

In the model space: the wireframe of all rows at its place in the world, on layers "3D LABEL"; below it, rows side by
side, each row's elevation with dimensions, and its plan, on layers "ELEVATION LABEL", "PLAN LABEL", "TEXT" and
"DIMENSIONS". What is known of a structure is in the extended data (`SAVMAP`) of its lines.
"""

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from savmap.errors import visible
from savmap.files.atomic import write_text
from savmap.maps.exports import require_library
from savmap.maps.exports.marks import bytes_of, colours, sigmas, unique
from savmap.maps.exports.models.drawings import Dimension, Shape, dimensions, elevation, plan, reach
from savmap.maps.exports.models.parts import Part, RowParts, depth_note, parts_of
from savmap.types import Floats, RowMap, SiteMap, Structure

APP = "SAVMAP"
METRES = 6
MARGIN_M, APART_M = 5.0, 3.0
"""Between the world and the drawings below it, and between drawings."""
TEXT_M, TITLE_M = 0.05, 0.3
"""Heights of letters."""
CHAIN_M = 0.4
"""Between a row and its chains of dimensions."""
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
        drawing.sheets([(row, site.rows[row.name]) for row in rows], _below(rows))
        for kind in sorted(document.entitydb.dxf_types_in_use()):
            document.classes.add_class(kind)  # ezdxf itself would add them in an order of its own in each process
        stream = io.StringIO()
        document.write(stream)
    return stream.getvalue()


def drawn_text(text: str, longest: int = LONGEST_TEXT) -> str:
    """A text as drawings show it: one line, nothing of which is taken for a code."""
    shown = visible(text)
    cut = shown if len(shown) <= longest else f"{shown[: longest - 1]}…"
    return CODED.sub(r"\\U+005C", cut.replace("%%", "%%%%%%").replace("^", "^ "))


@contextmanager
def _without_dates(options: Any) -> Iterator[None]:
    """The same map gives the same file: ezdxf writes no dates and no random identifiers."""
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


def _below(rows: Sequence[RowParts]) -> Floats:
    """Where drawings begin (2,): at the left end of the world, below it."""
    points = [part.structure.vertices for row in rows for part in row.parts if len(part.structure.vertices)]
    if not points:
        return np.zeros(2)
    lowest: Floats = np.concatenate(points)[:, :2].min(axis=0)
    return lowest - [0.0, MARGIN_M]


class _Drawing:
    """A DXF document as it grows."""

    def __init__(self, document: Any, labels: Sequence[str]) -> None:
        self.document, self.space = document, document.modelspace()
        document.appids.new(APP)
        document.dimstyles.new(APP, dxfattribs=STYLE)
        palette = colours(labels)
        names = unique([_layer_name(label) for label in palette], str.casefold, "{} {}")
        self.layers = dict(zip(palette, names, strict=True))
        for kind in ("3D", "ELEVATION", "PLAN"):
            for label, name in self.layers.items():
                layer = document.layers.add(f"{kind} {name}")
                layer.rgb = bytes_of(palette[label])
        for name in ("TEXT", "DIMENSIONS"):
            document.layers.add(name)

    def wireframe(self, part: Part) -> None:
        """A structure at its place in the world: its solid's edges, or its own, or its vertices."""
        thing, on = part.structure, self._layer("3D", part.structure)
        if part.body is not None:
            count = len(part.body.outline)
            around = [(k, (k + 1) % count) for k in range(count)]
            edges = [*around, *((a + count, b + count) for a, b in around), *((k, k + count) for k in range(count))]
            points = part.body.points
        else:
            edges, points = thing.edges.tolist(), thing.vertices
        for a, b in edges:
            self._told(self.space.add_line(points[a], points[b], dxfattribs=on), part)
        if not len(edges):
            for point in points:
                self._told(self.space.add_point(point, dxfattribs=on), part)

    def sheets(self, rows: Sequence[tuple[RowParts, RowMap]], corner: Floats) -> None:
        """The drawings of all rows, side by side, right of and below a corner (2,)."""
        for parts, row in rows:
            corner = corner + np.array([self._sheet(parts, row, corner) + APART_M, 0.0])

    def _sheet(self, parts: RowParts, row: RowMap, corner: Floats) -> float:
        """The drawings of a row: title, elevation, plan with what of its depths is assumed. How wide they are, m."""
        front, above = elevation(row), plan(row)
        (low, high), (near, far) = reach(front), reach(above)
        left = min(low[0], near[0])
        start = corner - [left, high[1] + TITLE_M + CHAIN_M]
        self._text(f"row {parts.name}", TITLE_M, corner - [0.0, TITLE_M])
        for shape in front:
            self._outline("ELEVATION", shape, start)
            self._caption(shape, start)
        for dimension in dimensions(row, min(low[1], 0.0) - CHAIN_M, CHAIN_M):
            self._dimension(dimension, start)
        beneath = start + np.array([0.0, min(low[1], 0.0) - 2 * CHAIN_M - APART_M - far[1]])
        for shape in above:
            self._outline("PLAN", shape, beneath)
        if note := depth_note([parts]):
            self._text(note, 2 * TEXT_M, beneath + np.array([left, near[1] - 4 * TEXT_M]), LONGEST_NOTE)
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

    def _caption(self, shape: Shape, start: Floats) -> None:
        low, high = shape.points.min(axis=0), shape.points.max(axis=0)
        place = tuple(start + (low + high) / 2)
        text = self.space.add_text(drawn_text(shape.structure.id), dxfattribs={"layer": "TEXT", "height": TEXT_M})
        text.dxf.update({"halign": 1, "valign": 2, "insert": place, "align_point": place})

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

    def _told(self, entity: Any, part: Part) -> None:
        """Say of an entity what it is part of: row, plugin, id, label, whether the depth is assumed, and the largest
        sigma, m."""
        texts = [part.row, part.plugin, part.structure.id, part.structure.label]
        spread = sigmas(part.structure)
        data: list[tuple[int, str | int | float]] = [(1000, _data(text)) for text in texts]
        data += [(1070, int(part.assumed)), (1040, float(spread.max()) if spread.size else 0.0)]
        if text := str(part.structure.attributes.get("text", "")):
            data.append((1000, _data(text)))
        entity.set_xdata(APP, data)


def _layer_name(label: str) -> str:
    return NO_LAYER_LETTERS.sub("_", visible(label))[:LONGEST_LAYER] or "_"


def _data(text: str) -> str:
    return drawn_text(text, LONGEST_DATA).encode()[:LONGEST_DATA].decode("utf-8", "ignore")
