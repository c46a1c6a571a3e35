"""Drawings (DXF): what lies on layers, blocks inserted, in any unit."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.apps.exchange.imports import drawing
from savmap.apps.exchange.imports.records import ImportOptions, SurveyElement
from savmap.apps.exchange.imports.survey import elements_of
from savmap.errors import OutputError

pytestmark = pytest.mark.extra("cad")
LABELS = {"post": "post", "bar": "bar", "tube": "tube"}
MM = 4


def empty(units: int = 6) -> Any:
    """An empty one, in metres unless told otherwise."""
    import ezdxf

    return ezdxf.new("R2010", units=units)


def read(folder: Path, document: Any, options: ImportOptions | None = None) -> list[SurveyElement]:
    document.saveas(folder / "plan.dxf")
    return list(elements_of(folder / "plan.dxf", options or ImportOptions(), LABELS).elements)


def corners(one: SurveyElement) -> list[list[float]]:
    return sorted(np.round(one.structure.vertices, 6).tolist())


def test_each_closed_line_point_and_mesh_is_an_element(tmp_path: Path) -> None:
    document = empty(MM)
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (100, 0), (100, 5000), (0, 5000)], close=True, dxfattribs={"layer": "POST"})
    space.add_point((2000, 8000, 1200), dxfattribs={"layer": "tube"})
    space.add_polyline3d([(0, 0, 0), (1, 0, 0), (1, 1, 1)], close=True, dxfattribs={"layer": "bar"})
    with space.add_mesh(dxfattribs={"layer": "bar"}).edit_data() as mesh:
        mesh.vertices = [(0, 0, 0), (1000, 0, 0), (0, 1000, 0)]
        mesh.faces = [(0, 1, 2)]
    space.add_circle((5000, 0, 100), 200, dxfattribs={"layer": "tube"})
    space.add_text("post", dxfattribs={"layer": "post"})
    space.add_line((0, 0), (9, 9), dxfattribs={"layer": "walls"})
    found = read(tmp_path, document)
    assert [one.structure.label for one in found] == ["post", "tube", "bar", "bar", "tube"]
    assert corners(found[0]) == [[0, 0, 0], [0, 5, 0], [0.1, 0, 0], [0.1, 5, 0]]
    assert corners(found[1]) == [[2, 8, 1.2]]
    assert found[4].structure.vertices.mean(axis=0) == pytest.approx([5, 0, 0.1])


def test_lines_that_touch_are_one_element(tmp_path: Path) -> None:
    document = empty()
    for x in (0.0005, 2.7005):
        ring = [(x, 0), (x + 0.1, 0), (x + 0.1, 5), (x, 5)]
        for k, start in enumerate(ring):
            end = (ring[(k + 1) % 4][0] + 1e-9, ring[(k + 1) % 4][1] - 1e-9)
            document.modelspace().add_line(start, end, dxfattribs={"layer": "post"})
    found = read(tmp_path, document)
    assert [corners(one)[0][0] for one in found] == pytest.approx([0.0005, 2.7005])
    assert {len(one.structure.vertices) for one in found} == {4}


def test_blocks_are_inserted_turned_and_scaled(tmp_path: Path) -> None:
    document = empty()
    inner = document.blocks.new("edge")
    inner.add_line((0, 0), (0, 5))
    frame = document.blocks.new("frame")
    frame.add_blockref("edge", (0, 0))
    frame.add_blockref("edge", (0.1, 0))
    frame.add_text("F")
    space = document.modelspace()
    space.add_blockref("frame", (3, 0), dxfattribs={"layer": "post"})
    space.add_blockref("frame", (0, 1), dxfattribs={"layer": "post", "rotation": 90, "xscale": 2})
    grid = space.add_blockref("frame", (10, 0), dxfattribs={"layer": "post"})
    grid.grid(size=(1, 3), spacing=(0, 2.7))
    found = read(tmp_path, document)
    assert len(found) == 5
    assert corners(found[0]) == [[3, 0, 0], [3, 5, 0], [3.1, 0, 0], [3.1, 5, 0]]
    assert corners(found[1]) == [[-5, 1, 0], [-5, 1.2, 0], [0, 1, 0], [0, 1.2, 0]]
    assert [corners(one)[0][0] for one in found[2:]] == pytest.approx([10, 12.7, 15.4])


def test_layers_get_labels_and_units_are_asked_for(tmp_path: Path) -> None:
    document = empty(0)
    document.modelspace().add_point((1, 2, 3), dxfattribs={"layer": "LICHT"})
    with pytest.raises(OutputError, match=r"\$INSUNITS is 0\): say it, such as --unit mm"):
        read(tmp_path, document)
    with pytest.raises(OutputError, match=r"no layer is called like a label .*there are LICHT: say --layer NAME=LABEL"):
        read(tmp_path, document, ImportOptions(unit="cm"))
    (one,) = read(tmp_path, document, ImportOptions(labels={"licht": "tube"}, unit="cm"))
    assert (one.structure.label, corners(one)) == ("tube", [[0.01, 0.02, 0.03]])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"0\nSECTION\n", ""),
        (b"0\nSECTION\n2\nENTITIES\n0\nLINE\n10\nx\n", ""),
        (b"", "is no DXF drawing"),
        (bytes(range(256)) * 20, "is no DXF drawing"),
        (b"a text that is\nno SECTION\n", "is no DXF drawing"),
        (b"AC1032\0\0\0" + bytes(range(256)), "is a DWG drawing, which is not read: save it as DXF"),
    ],
)
def test_what_is_no_drawing_is_one_line(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "plan.dxf").write_bytes(content)
    with pytest.raises(OutputError, match=rf"plan\.dxf: {message}") as caught:
        elements_of(tmp_path / "plan.dxf", ImportOptions(unit="m"), LABELS)
    assert "\n" not in str(caught.value)


def test_line_ends_may_be_any_and_a_binary_drawing_says_what_to_do(tmp_path: Path) -> None:
    document = empty()
    document.modelspace().add_point((1, 2, 3), dxfattribs={"layer": "tube"})
    plain = read(tmp_path, document)
    content = (tmp_path / "plan.dxf").read_bytes().replace(b"\r\n", b"\n")
    (tmp_path / "plan.dxf").write_bytes(content.replace(b"\n", b"\r\n"))
    ends = elements_of(tmp_path / "plan.dxf", ImportOptions(), LABELS).elements
    document.saveas(tmp_path / "plan.dxf", fmt="bin")
    with pytest.raises(OutputError, match="is a binary DXF drawing, which is not read: save it as DXF in text"):
        elements_of(tmp_path / "plan.dxf", ImportOptions(), LABELS)
    assert [corners(one[0]) for one in (plain, ends)] == [[[1, 2, 3]]] * 2


def test_a_drawing_within_bounds_alone_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document = empty()
    before = "base"
    document.blocks.new(before).add_line((0, 0), (0, 5))
    for depth in range(6):
        block = document.blocks.new(f"b{depth}")
        for k in range(10):
            block.add_blockref(before, (k, 0))
        before = f"b{depth}"
    document.modelspace().add_blockref(before, (0, 0), dxfattribs={"layer": "post"})
    monkeypatch.setattr(drawing, "MOST_ENTITIES", 2000)
    with pytest.raises(OutputError, match="more than 2000 entities"):
        read(tmp_path, document)
    monkeypatch.setattr(drawing, "MOST_MB", 0.001)
    with pytest.raises(OutputError, match="is larger than"):
        read(tmp_path, document)


def test_a_block_in_itself_and_a_corner_beyond_all_bounds_are_refused(tmp_path: Path) -> None:
    document = empty()
    document.blocks.new("loop").add_blockref("loop", (1, 0))
    document.modelspace().add_blockref("loop", (0, 0), dxfattribs={"layer": "post"})
    with pytest.raises(OutputError):
        read(tmp_path, document)
    document = empty()
    document.modelspace().add_point((1e300, 0, 0), dxfattribs={"layer": "post"})
    with pytest.raises(OutputError, match="not finite, or too far"):
        read(tmp_path, document)
