"""DXF: lines stand where they are by their plain group codes, drawings and dimensions are right, and no text is taken for a code."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import savmap
from savmap.apps.exchange.dxf import dimensions, drawn_text
from savmap.types import Floats, SiteMap

from .made_up_models import DEPTH_NOTE, EVIL, NEAREST_M, distance_m, expected, hostile_site, made_up_site, row, things

pytestmark = pytest.mark.extra("cad")

Entity = list[tuple[int, str]]


def drawing(path: Path) -> Any:
    """A file as ezdxf reads it."""
    import ezdxf

    return ezdxf.readfile(path)


def plain_text(text: str) -> str:
    """What a program shows of a text."""
    from ezdxf.tools.text import plain_text

    return str(plain_text(text))


def entities(path: Path) -> Iterator[Entity]:
    """The entities of the model space, as a file's plain pairs of group codes and values."""
    lines = path.read_text(encoding="utf-8").split("\n")
    pairs = [(int(code), value) for code, value in zip(lines[::2], lines[1::2], strict=False)]
    start = pairs.index((2, "ENTITIES"))
    end = pairs.index((0, "ENDSEC"), start)
    entity: Entity = []
    for code, value in pairs[start + 1 : end]:
        if code == 0 and entity:
            yield entity
            entity = []
        entity.append((code, value))
    yield entity


def points(entity: Entity) -> Floats:
    """The ends of a line, or a point."""
    values = {code: float(value) for code, value in entity if code in (10, 20, 30, 11, 21, 31)}
    ends = [[values[axis + end] for axis in (10, 20, 30)] for end in (0, 1) if 10 + end in values]
    return np.array(ends)


def wireframe(path: Path) -> dict[tuple[str, str], Floats]:
    """By row and id, all ends of lines on the layers 3D."""
    found = dict[tuple[str, str], list[Floats]]()
    for entity in entities(path):
        layer = next((value for code, value in entity if code == 8), "")
        if layer.startswith("3D "):
            said = [value for code, value in entity if code == 1000]
            found.setdefault((said[0], said[2]), []).append(points(entity))
    return {key: np.concatenate(parts) for key, parts in found.items()}


def test_positions_are_those_of_the_map(tmp_path: Path) -> None:
    path = savmap.export(made_up_site(), tmp_path / "map.dxf")
    found, wanted = wireframe(path), expected(made_up_site())
    assert set(found) == set(wanted)
    assert max(distance_m(found[key], wanted[key]) for key in wanted) < NEAREST_M


def test_layers_are_those_of_the_labels(tmp_path: Path) -> None:
    document = drawing(savmap.export(made_up_site(), tmp_path / "map.dxf"))
    assert document.dxfversion == "AC1024"
    assert document.units == 6
    layers = {layer.dxf.name for layer in document.layers}
    labels = ("post", "bar", "plate", "block", "tube")
    assert layers >= {f"{kind} {label}" for kind in ("3D", "ELEVATION", "PLAN") for label in labels}
    assert len(document.modelspace().query('TEXT[layer=="TEXT"]')) == 2 * 10


def test_drawings_lie_side_by_side_below_the_world(tmp_path: Path) -> None:
    document = drawing(savmap.export(made_up_site(), tmp_path / "map.dxf"))
    space = document.modelspace()
    world = np.concatenate(list(expected(made_up_site()).values()))
    drawn = [np.array(line.get_points("xy")) for line in space.query('LWPOLYLINE[layer=="ELEVATION post"]')]
    assert len(drawn) == 4
    assert max(float(line[:, 1].max()) for line in drawn) < world[:, 1].min()
    assert max(drawn[1][:, 0]) < min(drawn[2][:, 0])
    assert np.ptp(drawn[0][:, 0]) == pytest.approx(0.1)
    assert np.ptp(drawn[0][:, 1]) == pytest.approx(5.0)
    above = [np.array(line.get_points("xy")) for line in space.query('LWPOLYLINE[layer=="PLAN post"]')]
    assert np.ptp(above[0][:, 1]) == pytest.approx(1.1)
    assert max(float(line[:, 1].max()) for line in above) < min(float(line[:, 1].min()) for line in drawn)


def test_clear_widths_and_heights_are_dimensioned(tmp_path: Path) -> None:
    site = SiteMap({"A": row("A", things())}, {})
    document = drawing(savmap.export(site, tmp_path / "map.dxf"))
    measured = [dimension.get_measurement() for dimension in document.modelspace().query("DIMENSION")]
    assert sorted(measured) == pytest.approx([2.12, 2.7, 2.9])
    assert dimensions(row("A", things()[3:]), 0.0, 0.0) == []


@pytest.mark.parametrize("site", [made_up_site(), hostile_site(), SiteMap({}, {})], ids=["plain", "hostile", "empty"])
def test_drawings_pass_the_audit(site: SiteMap, tmp_path: Path) -> None:
    auditor = drawing(savmap.export(site, tmp_path / "map.dxf")).audit()
    assert (list(auditor.errors), list(auditor.fixes)) == ([], [])


def test_texts_are_drawn_as_they_are(tmp_path: Path) -> None:
    document = drawing(savmap.export(hostile_site(), tmp_path / "map.dxf"))
    texts = [plain_text(text.dxf.text) for text in document.modelspace().query("TEXT")]
    assert not any("\n" in text or "\x1b" in text for text in texts)
    notes = [text for text in texts if text.startswith("assumed depth") or "must be checked" in text]
    assert len(notes) == 2
    assert all(len(text) <= (220 if text in notes else 70) for text in texts)
    assert EVIL[2] in texts
    assert EVIL[5] in texts


@pytest.mark.parametrize("text", ["100 %%d", "%%", "%%%", "^J", "a^b", "\\P{}", "é漢😀"])
def test_nothing_in_a_text_is_a_code(text: str, tmp_path: Path) -> None:
    site = SiteMap({"A": row("A", [replace(things()[0], id=text)])}, {})
    document = drawing(savmap.export(site, tmp_path / "map.dxf"))
    shown = [plain_text(entity.dxf.text) for entity in document.modelspace().query("TEXT")]
    assert shown[1] == text


@pytest.mark.parametrize("text", ["\\U+000A", "a\\M+1ABCDb", "\\\\U+000A", "\\U+005CU+000A"])
def test_no_text_stands_for_other_letters(text: str) -> None:
    from ezdxf.lldxf.encoding import decode_dxf_unicode

    assert decode_dxf_unicode(drawn_text(text)) == text
    assert drawn_text("a\nb") == "a\\nb"


def test_depths_that_are_assumed_are_told(tmp_path: Path) -> None:
    texts = [
        value
        for own in entities(savmap.export(made_up_site(), tmp_path / "map.dxf"))
        for code, value in own
        if code == 1
    ]
    assert texts.count(DEPTH_NOTE) == 2
