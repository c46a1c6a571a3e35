"""Entities and attributes of DXF that change a place: each is read right, or named as not read."""

from collections.abc import Callable
from math import cos, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.apps.exchange.imports.records import FileElements, ImportOptions
from savmap.apps.exchange.imports.survey import elements_of
from savmap.errors import OutputError

pytestmark = pytest.mark.extra("cad")
FLAT = 7777
"""A scale that stands for 0, which ezdxf reads, but does not write."""
LABELS = {"post": "post", "bar": "bar"}
POST, BAR, ZERO = {"layer": "post"}, {"layer": "bar"}, {"layer": "0"}
TURNED, DOWN = {"rotation": 90}, {"extrusion": (0, 0, -1)}
SQUARE = [(0, 0), (1, 0), (1, 2), (0, 2)]
SQUARE_3D = [[0, 0, 0], [0, 2, 0], [1, 0, 0], [1, 2, 0]]
Draw = Callable[[Any, Any], object]


def read(folder: Path, draw: Draw, version: str = "R2010") -> FileElements:
    import ezdxf

    document = ezdxf.new(version, units=6)
    draw(document, document.modelspace())
    document.saveas(folder / "plan.dxf")
    text = (folder / "plan.dxf").read_text(encoding="utf-8")
    (folder / "plan.dxf").write_text(text.replace(f"{FLAT}.0\n", "0.0\n"), encoding="utf-8")
    return elements_of(folder / "plan.dxf", ImportOptions(unit="m"), LABELS)


def corners(found: FileElements) -> list[list[list[float]]]:
    return [sorted((np.round(one.structure.vertices, 3) + 0.0).tolist()) for one in found.elements]


def block(document: Any, name: str = "b", **attributes: Any) -> Any:
    """A block with an L of two lines on layer 0."""
    made = document.blocks.new(name, **attributes)
    made.add_line((0, 0), (1, 0))
    made.add_line((0, 0), (0, 2, 3))
    return made


def inserted(**attributes: Any) -> Draw:
    return lambda document, space: (block(document), space.add_blockref("b", (10, 0), dxfattribs=POST | attributes))


def nested(outer: dict[str, Any], inner: dict[str, Any], layer: dict[str, str] = POST) -> Draw:
    def draw(document: Any, space: Any) -> None:
        block(document)
        document.blocks.new("outer").add_blockref("b", (1, 0), dxfattribs=inner)
        space.add_blockref("outer", (10, 0), dxfattribs=layer | outer)

    return draw


def polyface(document: Any, space: Any) -> None:
    face = space.add_polyface(dxfattribs=POST)
    face.append_faces([[(5, 0, 0), (6, 0, 0), (6, 2, 0)], [(5, 0, 0), (6, 2, 0), (5, 2, 1)]])


def polymesh(document: Any, space: Any) -> None:
    mesh = space.add_polymesh((2, 2), dxfattribs=POST)
    for m in range(2):
        for n in range(2):
            mesh.set_mesh_vertex((m, n), (5 + m, 2 * n, 1))


def smooth_polymesh(document: Any, space: Any) -> None:
    """A mesh of lines that was smoothed: the points that control it are not on it."""
    polymesh(document, space)
    mesh = space[0]
    mesh.dxf.flags |= 4
    mesh.append_vertices([(9, 9, 9)], dxfattribs={"flags": 64 | 16})


def mesh(levels: int) -> Draw:
    def draw(document: Any, space: Any) -> None:
        made = space.add_mesh(dxfattribs=POST | {"subdivision_levels": levels})
        with made.edit_data() as data:
            data.vertices, data.faces = [(0, 0, 0), (1, 0, 0), (1, 2, 0), (0, 2, 0)], [(0, 1, 2, 3)]

    return draw


def fitted(document: Any, space: Any) -> None:
    """A polyline that a spline was fitted to: the points that control it are not on it."""
    line = space.add_polyline2d([(0, 0), (0.5, 1), (1, 0)], dxfattribs=POST | {"flags": 4})
    line.append_vertices([(0.5, 9)], dxfattribs={"flags": 16})


def rack(document: Any, space: Any) -> None:
    """A rack as one block on layer 0, its posts as blocks and its bar as lines that touch."""
    document.blocks.new("p").add_lwpolyline(SQUARE, close=True)
    made = document.blocks.new("rack")
    for x in (0, 4):
        made.add_blockref("p", (x, 0), dxfattribs=POST)
    made.add_line((1, 1), (2, 1), dxfattribs=BAR)
    made.add_line((2, 1), (4, 1), dxfattribs=BAR)
    space.add_blockref("rack", (10, 0), dxfattribs=ZERO)


def layer(**attributes: Any) -> Draw:
    def draw(document: Any, space: Any) -> None:
        document.layers.add("post").update_dxf_attribs(attributes)
        space.add_lwpolyline(SQUARE, close=True, dxfattribs=POST)
        space.add_point((1, 2, 3), dxfattribs=BAR)

    return draw


def frozen(document: Any, space: Any) -> None:
    """A block on a frozen layer, and one on a layer that is off; both hold a bar."""
    for name, x in (("cold", 0), ("dark", 10)):
        document.layers.add(name)
        made = document.blocks.new(f"b {name}")
        made.add_point((1, 2, 3), dxfattribs=BAR)
        made.add_point((1, 2, 4), dxfattribs=ZERO)
        space.add_blockref(f"b {name}", (x, 0), dxfattribs={"layer": name})
    document.layers.get("cold").freeze()
    document.layers.get("dark").off()


def twice(draw: Callable[[Any], object]) -> Draw:
    """What is drawn in a block and mirrored, beside a point."""

    def both(document: Any, space: Any) -> None:
        draw(document.blocks.new("b"))
        space.add_blockref("b", (10, 0), dxfattribs=POST | {"xscale": -1})

    return both


def other_file(document: Any, space: Any) -> None:
    document.add_xref_def("other.dxf", "other")
    space.add_blockref("other", (0, 0), dxfattribs=ZERO)
    space.add_point((1, 2, 3), dxfattribs=BAR)


def clipped(document: Any, space: Any) -> None:
    from ezdxf.xclip import XClip

    block(document)
    XClip(space.add_blockref("b", (10, 0), dxfattribs=POST)).set_block_clipping_path([(0, 0), (0.5, 0.5)])


def solid(space: Any, attributes: dict[str, str]) -> None:
    space.add_3dsolid(dxfattribs=attributes).sat = ["400 0 1 0"]


def in_paper(document: Any, space: Any) -> None:
    space.add_point((1, 2, 3), dxfattribs=BAR)
    document.layout("Layout1").add_line((0, 0), (1, 1), dxfattribs=POST)


L = [[10, 0, 0], [10, 2, 3], [11, 0, 0]]
DRAWN: dict[str, tuple[Draw, list[list[list[float]]]]] = {
    "line": (lambda d, s: s.add_line((0, 0, 1), (1, 0, 2), dxfattribs=POST), [[[0, 0, 1], [1, 0, 2]]]),
    "line, thick": (
        lambda d, s: s.add_line((0, 0), (1, 0), dxfattribs=POST | {"thickness": 5}),
        [[[0, 0, 0], [0, 0, 5], [1, 0, 0], [1, 0, 5]]],
    ),
    "line, thick along y": (
        lambda d, s: s.add_line((0, 0), (1, 0), dxfattribs=POST | {"thickness": 5, "extrusion": (0, 1, 0)}),
        [[[0, 0, 0], [0, 5, 0], [1, 0, 0], [1, 5, 0]]],
    ),
    "point": (lambda d, s: s.add_point((1, 2, 3), dxfattribs=POST), [[[1, 2, 3]]]),
    "outline": (lambda d, s: s.add_lwpolyline(SQUARE, close=True, dxfattribs=POST), [SQUARE_3D]),
    "outline at a height, mirrored": (
        lambda d, s: s.add_lwpolyline(SQUARE, close=True, dxfattribs=POST | DOWN | {"elevation": -3}),
        [[[-1, 0, 3], [-1, 2, 3], [0, 0, 3], [0, 2, 3]]],
    ),
    "outline upright": (
        lambda d, s: s.add_lwpolyline(SQUARE, close=True, dxfattribs=POST | {"extrusion": (0, -1, 0)}),
        [[[0, 0, 0], [0, 0, 2], [1, 0, 0], [1, 0, 2]]],
    ),
    "outline, thick": (
        lambda d, s: s.add_lwpolyline(SQUARE, close=True, dxfattribs=POST | {"thickness": 5}),
        [sorted([[*xy, z] for *xy, _ in SQUARE_3D for z in (0, 5)])],
    ),
    "wide line": (
        lambda d, s: s.add_lwpolyline([(0, 0), (0, 2)], dxfattribs=POST | {"const_width": 0.2}),
        [[[-0.1, 0, 0], [-0.1, 2, 0], [0, 0, 0], [0, 2, 0], [0.1, 0, 0], [0.1, 2, 0]]],
    ),
    "outline with arcs": (
        lambda d, s: s.add_lwpolyline([(0, 0, 1), (0, 2, 1)], "xyb", close=True, dxfattribs=POST),
        [[[-1, 1, 0], [0, 0, 0], [0, 2, 0], [1, 1, 0]]],
    ),
    "old outline": (lambda d, s: s.add_polyline2d(SQUARE, close=True, dxfattribs=POST), [SQUARE_3D]),
    "old outline at a height, mirrored": (
        lambda d, s: s.add_polyline2d(SQUARE, close=True, dxfattribs=POST | DOWN | {"elevation": (0, 0, -3)}),
        [[[-1, 0, 3], [-1, 2, 3], [0, 0, 3], [0, 2, 3]]],
    ),
    "old line that was fitted": (fitted, [[[0, 0, 0], [0.5, 1, 0], [1, 0, 0]]]),
    "lines in space that touch": (
        lambda d, s: [s.add_polyline3d(SQUARE_3D[k : k + 2], dxfattribs=POST) for k in range(3)],
        [SQUARE_3D],
    ),
    "open outlines that touch": (
        lambda d, s: [s.add_lwpolyline(points, dxfattribs=POST) for points in (SQUARE[:3], SQUARE[2:])],
        [SQUARE_3D],
    ),
    "lines and an arc that touch": (
        lambda d, s: (
            s.add_line((1, 0), (1, 2), dxfattribs=POST),
            s.add_arc((0, 2), 1, 0, 180, dxfattribs=POST),
        ),
        [[[-1, 2, 0], [0, 3, 0], [1, 0, 0], [1, 2, 0]]],
    ),
    "polyface": (polyface, [[[5, 0, 0], [5, 2, 1], [6, 0, 0], [6, 2, 0]]]),
    "polymesh": (polymesh, [[[5, 0, 1], [5, 2, 1], [6, 0, 1], [6, 2, 1]]]),
    "polymesh, smoothed": (smooth_polymesh, [[[5, 0, 1], [5, 2, 1], [6, 0, 1], [6, 2, 1]]]),
    "mesh": (mesh(0), [SQUARE_3D]),
    "faces that touch": (
        lambda d, s: [s.add_3dface([(0, 0, 0), (1, 0, 0), point], dxfattribs=POST) for point in ((1, 2, 0), (0, 2, 0))],
        [SQUARE_3D],
    ),
    "solid, thick and mirrored": (
        lambda d, s: s.add_solid([(0, 0), (1, 0), (0, 2)], dxfattribs=POST | DOWN | {"thickness": 5}),
        [[[-1, 0, -5], [-1, 0, 0], [0, 0, -5], [0, 0, 0], [0, 2, -5], [0, 2, 0]]],
    ),
    "trace": (lambda d, s: s.add_trace([(0, 0), (1, 0), (0, 2), (1, 2)], dxfattribs=POST), [SQUARE_3D]),
    "circle": (
        lambda d, s: s.add_circle((5, 0, 1), 2, dxfattribs=POST),
        [[[3, 0, 1], [5, -2, 1], [5, 2, 1], [7, 0, 1]]],
    ),
    "circle far away": (
        lambda d, s: s.add_circle((32e6, 5e6, 1), 2, dxfattribs=POST),
        [[[31999998, 5e6, 1], [32e6, 4999998, 1], [32e6, 5000002, 1], [32000002, 5e6, 1]]],
    ),
    "circle, mirrored": (
        lambda d, s: s.add_circle((5, 0, 1), 2, dxfattribs=POST | DOWN),
        [[[-7, 0, -1], [-5, -2, -1], [-5, 2, -1], [-3, 0, -1]]],
    ),
    "ellipse": (
        lambda d, s: s.add_ellipse((5, 0), (0, 3), 0.5, dxfattribs=POST),
        [[[3.5, 0, 0], [5, -3, 0], [5, 3, 0], [6.5, 0, 0]]],
    ),
    "spline": (
        lambda d, s: s.add_open_spline([(0, 0, 0), (0, 2, 0), (2, 2, 0), (2, 0, 0)], dxfattribs=POST),
        [[[0, 0, 0], [1, 1.5, 0], [2, 0, 0]]],
    ),
    "double line": (
        lambda d, s: s.add_mline([(0, 0), (0, 2)], dxfattribs=POST),
        [[[0, 0, 0], [0, 2, 0], [1, 0, 0], [1, 2, 0]]],
    ),
    "block": (inserted(), [L]),
    "block, scaled": (inserted(xscale=2, yscale=3, zscale=-1), [[[10, 0, 0], [10, 6, -3], [12, 0, 0]]]),
    "block, flat": (inserted(zscale=FLAT), [[[10, 0, 0], [10, 2, 0], [11, 0, 0]]]),
    "block, mirrored": (inserted(xscale=-1), [[[9, 0, 0], [10, 0, 0], [10, 2, 3]]]),
    "block, turned": (inserted(rotation=90), [[[8, 0, 3], [10, 0, 0], [10, 1, 0]]]),
    "block, from below": (inserted(**DOWN), [[[-11, 0, 0], [-10, 0, 0], [-10, 2, -3]]]),
    "block with a base": (
        lambda d, s: (block(d, base_point=(1, 0)), s.add_blockref("b", (10, 0), dxfattribs=POST | TURNED)),
        [[[8, -1, 3], [10, -1, 0], [10, 0, 0]]],
    ),
    "blocks in rows": (
        lambda d, s: (block(d), s.add_blockref("b", (10, 0), dxfattribs=POST | TURNED).grid((2, 1), (5, 7))),
        [[[8, 0, 3], [10, 0, 0], [10, 1, 0]], [[3, 0, 3], [5, 0, 0], [5, 1, 0]]],
    ),
    "block in a flat block": (nested({"zscale": FLAT}, {}), [[[11, 0, 0], [11, 2, 0], [12, 0, 0]]]),
    "flat block in a block": (nested({}, {"zscale": FLAT}), [[[11, 0, 0], [11, 2, 0], [12, 0, 0]]]),
    "flat block in a turned, flat block": (
        nested({"zscale": FLAT, "rotation": 90}, {"zscale": FLAT}),
        [[[8, 1, 0], [10, 1, 0], [10, 2, 0]]],
    ),
    "turned block in a scaled block": (
        nested({"xscale": 2}, {"rotation": 45}),
        [
            sorted(
                [
                    [12, 0, 0],
                    [round(12 + 2 * cos(radians(45)), 3), round(sin(radians(45)), 3), 0],
                    [round(12 - 4 * cos(radians(45)), 3), round(2 * sin(radians(45)), 3), 3],
                ]
            )
        ],
    ),
    "circle in a scaled block": (
        lambda d, s: (
            d.blocks.new("b").add_circle((0, 0), 1),
            s.add_blockref("b", (10, 0), dxfattribs=POST | {"yscale": 3}),
        ),
        [[[9, 0, 0], [10, -3, 0], [10, 3, 0], [11, 0, 0]]],
    ),
    "outline in a mirrored block": (
        twice(lambda made: made.add_lwpolyline(SQUARE, close=True, dxfattribs={"elevation": 4})),
        [[[9, 0, 4], [9, 2, 4], [10, 0, 4], [10, 2, 4]]],
    ),
    "block on layer 0 in a block with a label": (nested({}, ZERO), [[[11, 0, 0], [11, 2, 3], [12, 0, 0]]]),
    "block with a label in a block on layer 0": (nested({}, POST, ZERO), [[[11, 0, 0], [11, 2, 3], [12, 0, 0]]]),
    "rack in a block": (
        rack,
        [
            [[10, 0, 0], [10, 2, 0], [11, 0, 0], [11, 2, 0]],
            [[14, 0, 0], [14, 2, 0], [15, 0, 0], [15, 2, 0]],
            [[11, 1, 0], [12, 1, 0], [14, 1, 0]],
        ],
    ),
    "attributes of a block": (
        lambda d, s: (block(d), s.add_blockref("b", (10, 0), dxfattribs=POST).add_attrib("T", "x", (99, 99))),
        [L],
    ),
}
LEFT_OUT: dict[str, tuple[Draw, list[list[list[float]]], str]] = {
    "layer that is off": (layer(color=-1), [[[1, 2, 3]]], "1 hidden LWPOLYLINE on layer post"),
    "layer that is frozen": (layer(flags=1), [[[1, 2, 3]]], "1 hidden LWPOLYLINE on layer post"),
    "blocks on such layers": (frozen, [[[11, 2, 3]]], "1 hidden INSERT on layer cold"),
    "entity that is hidden": (
        lambda d, s: (
            s.add_point((1, 2, 3), dxfattribs=BAR),
            s.add_point((1, 2, 3), dxfattribs=POST | {"invisible": 1}),
        ),
        [[[1, 2, 3]]],
        "1 hidden POINT on layer post",
    ),
    "paper space": (in_paper, [[[1, 2, 3]]], "1 LINE in paper space"),
    "another file": (other_file, [[[1, 2, 3]]], "1 block other in another file (XREF)"),
    "block that is missing": (
        lambda d, s: (s.add_blockref("none", (0, 0), dxfattribs=POST), s.add_point((1, 2, 3), dxfattribs=BAR)),
        [[[1, 2, 3]]],
        "1 damaged, or of a missing block",
    ),
    "clipped block": (clipped, [L], "1 clipping (XCLIP) of block b"),
    "smooth mesh": (
        lambda d, s: (mesh(2)(d, s), s.add_point((1, 2, 3), dxfattribs=BAR)),
        [[[1, 2, 3]]],
        "1 MESH on layer post",
    ),
    "hatch, ray, body": (
        lambda d, s: (
            s.add_hatch(dxfattribs=POST).paths.add_polyline_path(SQUARE),
            s.add_ray((0, 0), (1, 0), dxfattribs=POST),
            solid(s, BAR),
            s.add_point((1, 2, 3), dxfattribs=BAR),
        ),
        [[[1, 2, 3]]],
        "1 HATCH on layer post, 1 RAY on layer post, 1 3DSOLID on layer bar",
    ),
    "periodic spline": (
        lambda d, s: (
            s.add_spline(dxfattribs=POST).set_closed([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]),
            s.add_point((1, 2, 3), dxfattribs=BAR),
        ),
        [[[1, 2, 3]]],
        "1 SPLINE on layer post",
    ),
}


@pytest.mark.parametrize("name", DRAWN)
def test_entity_is_where_it_is_drawn(tmp_path: Path, name: str) -> None:
    draw, expected = DRAWN[name]
    found = read(tmp_path, draw)
    assert corners(found) == [sorted(np.round(one, 3).tolist()) for one in expected]
    assert found.notes == ()


OLD = ["line, thick", "old outline at a height, mirrored", "polyface", "polymesh", "circle, mirrored", "blocks in rows"]


@pytest.mark.parametrize("name", OLD)
def test_old_drawings_are_read_alike(tmp_path: Path, name: str) -> None:
    assert corners(read(tmp_path, DRAWN[name][0], "R12")) == DRAWN[name][1]


@pytest.mark.parametrize("name", LEFT_OUT)
def test_entity_that_is_not_read_is_named(tmp_path: Path, name: str) -> None:
    draw, expected, note = LEFT_OUT[name]
    found = read(tmp_path, draw)
    assert corners(found) == expected
    assert len(found.notes) == 1
    assert note in found.notes[0]


def test_drawing_of_nothing_that_is_read_says_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(
        OutputError, match=r"nothing is drawn on its layers that is read.*; not read: 1 3DSOLID on layer post$"
    ):
        read(tmp_path, lambda document, space: solid(space, POST))
