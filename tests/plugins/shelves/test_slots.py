"""Openings of a perfect map: their sizes, their signs, their frame, and the files that are made of them."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from perfect_maps import structures_of, surveyed_row

from savmap import export, find
from savmap.cli.commands import results
from savmap.errors import OutputError
from savmap.maps.exports.frames import only_row, world_from_row
from savmap.maps.exports.vertices import write_csv as write_vertices
from savmap.maps.map_file import write_map
from savmap.types import (
    Alignment,
    FrameTable,
    JointCovariance,
    MapWarning,
    Placement,
    RowMap,
    SiteMap,
    Solid,
    Structure,
    Trajectory,
    Verdict,
)
from savmap.types.maps import UNCHECKED, warnings_of
from savmap_shelves.report.slot_files import COLUMNS, schema_text, write_csv, write_elements, write_json
from savmap_shelves.report.slots import slots_of

DOCS = Path(__file__).parents[3] / "docs"
HOSTILE = '=cmd|"a",b\nc\N{SNOWMAN}\u202e'


def row(name: str = "A", *signs: Structure, structures: list[Structure] | None = None) -> RowMap:
    table = FrameTable(np.zeros(0), ())
    shelves = tuple(structures_of(surveyed_row()) if structures is None else structures)
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    return RowMap(name, table, {}, path, {"shelves": shelves, "signs": signs}, ())


def sign(text: str, x: float, y: float, bay: str) -> Structure:
    corners = np.array([[x, y, 0.0], [x + 0.2, y, 0], [x + 0.2, y - 0.1, 0], [x, y - 0.1, 0]])
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    return Structure(
        "sign 1",
        "sign",
        corners,
        np.tile(1e-4 * np.eye(3), (4, 1, 1)),
        tuple("abcd"),
        edges,
        {"text": text, "bay": bay},
    )


def test_each_opening_has_its_sizes_and_sigmas() -> None:
    slots = slots_of(SiteMap({"A": row()}, {}), "shelves")
    assert [(slot.bay, slot.level) for slot in slots[:8]] == [*((1, level) for level in range(7)), (2, 0)]
    second = slots[1]
    assert second.clear_width is not None
    assert second.clear_height is not None
    assert second.clear_width.value == pytest.approx(3.6)
    assert second.clear_height.value == pytest.approx(0.8)
    assert second.load_height.value == pytest.approx(0.4)
    np.testing.assert_allclose(second.centre, [1.9, 0.0, 0.8], atol=1e-12)
    assert second.clear_width.sigma == pytest.approx(0.01 * np.sqrt(2))
    assert second.load_height.sigma == pytest.approx(0.01)
    np.testing.assert_allclose(np.sqrt(np.diag(second.covariance)), [0.01 / 2**0.5, 0.01, 0.01 / 2**0.5])
    assert (slots[0].clear_height.value, slots[0].load_height.sigma) == (pytest.approx(0.3), 0.0)  # type: ignore[union-attr]
    assert slots[6].clear_height is None
    assert slots[6].centre[2] == pytest.approx(5.6)


def test_what_two_edges_share_is_not_in_their_distance() -> None:
    part = row()
    uprights = part.structures["shelves"][:2]
    numbers = {one.id: np.full((4, 3), -1) for one in uprights}
    numbers["upright 1"][:, 0], numbers["upright 2"][:, 0] = 0, 1
    joint = JointCovariance({"shelves": numbers}, 1e-4 * np.array([[1.0, 0.9], [0.9, 1.0]]))
    slots = slots_of(SiteMap({"A": replace(part, joint=joint)}, {}), "shelves")
    assert slots[0].clear_width is not None
    assert slots[0].clear_width.sigma == pytest.approx(0.01 * np.sqrt(0.2))
    assert slots[7].clear_width is not None
    assert slots[7].clear_width.sigma == pytest.approx(0.01 * np.sqrt(2))


def test_a_slot_is_as_unchecked_as_what_is_around_it() -> None:
    off = {"upright 2": 0.1, "bay 1 / beam 2": 0.47}
    parts = [
        replace(part, attributes={**part.attributes, UNCHECKED: off[part.id]}) if part.id in off else part
        for part in structures_of(surveyed_row())
    ]
    slots = slots_of(SiteMap({"A": row(structures=parts)}, {}), "shelves")
    assert [slot.unchecked_m for slot in slots[:5]] == [0.1, 0.47, 0.47, 0.1, 0.1]
    assert slots[-1].unchecked_m is None


def test_an_upright_that_is_missing_leaves_the_width_open() -> None:
    parts = [part for part in structures_of(surveyed_row()) if part.id != "upright 2"]
    slots = slots_of(SiteMap({"A": row(structures=parts)}, {}), "shelves")
    assert [slot.bay for slot in slots if slot.clear_width is None] == [1] * 7 + [2] * 7
    assert slots[0].centre[0] == pytest.approx(1.9)


def test_depth_is_given_or_assumed() -> None:
    parts = structures_of(surveyed_row())
    outline = parts[0].vertices[[0, 1, 3, 2]]
    parts[0] = replace(parts[0], solid=Solid(outline, np.array([0, 0, -0.8]), assumed=False))
    slots = slots_of(SiteMap({"A": row(structures=parts)}, {}), "shelves")
    assert (slots[0].depth_m, slots[0].depth_assumed) == (0.8, False)
    assert (slots[-1].depth_m, slots[-1].depth_assumed) == (1.1, True)


def test_signs_name_the_level_on_whose_beam_they_hang() -> None:
    signs = (
        sign("B", 2.0, 1.3, "bay 1"),
        sign("A", 1.0, 1.3, "bay 1"),
        sign("bay", -0.05, 1.5, "bay 1"),
        sign("floor", 1.0, 0.2, "bay 1"),
        sign("other", 5.0, 1.3, "bay 2"),
    )
    slots = slots_of(SiteMap({"A": row("A", *signs)}, {}), "shelves")
    assert slots[2].signs == ("A", "B")
    assert slots[0].signs == ("floor",)
    assert {slot.bay_signs for slot in slots if slot.bay == 1} == {("bay",)}
    assert [slot.level for slot in slots if "other" in slot.signs] == [2]


@pytest.mark.parametrize("y", [0.2, 0.35, 1.0, 1.3, 9.0])
def test_a_sign_is_found_with_the_slot_that_has_it(
    y: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = SiteMap({"A": row("A", sign("A21-03", 1.0, y, "bay 1"))}, {})
    (slot,) = (slot for slot in slots_of(site, "shelves") if slot.signs)
    (hit,) = find(site, "A21-03")
    assert hit.slot is not None
    assert hit.slot.structure.attributes["level"] == slot.level
    assert hit.slot.structure.attributes.get("clear_height_m") == slot.clear_height
    x, up, z = hit.slot.position_m
    np.testing.assert_allclose((x, -z, up), slot.centre, atol=1e-9)
    write_map(site, tmp_path / "map.json")
    results.find(name="A21-03", map_file=[tmp_path / "map.json"])
    assert f"level {slot.level}: x 1.900, y " in capsys.readouterr().out.splitlines()[1]


def test_slots_of_placed_rows_stand_in_the_world() -> None:
    placement = Placement(10.0, -4.0, 180.0, np.diag([1e-4, 1e-4, 0.01]))
    aligned = Alignment(5.0, 6.0, 30.0, np.zeros((3, 3)), 0.5)
    site = SiteMap(
        {"A": row("A"), "B": row("B")},
        {},
        placements={"A": Placement(0, 0, 0, np.zeros((3, 3))), "B": placement},
        alignment=aligned,
    )
    slots = [slot for slot in slots_of(site, "shelves") if slot.row == "B"]
    expected = world_from_row(site, "B") @ np.array([1.9, 0.8, 0.0, 1.0])
    np.testing.assert_allclose(slots[1].centre, expected[:3], atol=1e-9)
    assert slots[1].frame == "world"
    assert np.sqrt(slots[1].covariance[0, 0]) > 0.01


def test_a_row_alone_is_in_the_world_where_it_is_aligned() -> None:
    aligned = Alignment(5.0, 6.0, 30.0, np.zeros((3, 3)), 0.5)
    placed = {"A": Placement(0, 0, 0, np.zeros((3, 3)))}
    site = SiteMap({"A": row("A"), "B": row("B")}, {}, placements=placed, alignment=aligned)
    chosen = slots_of(only_row(site, "B")[0], "shelves")
    assert {slot.frame for slot in chosen} == {"row"}
    np.testing.assert_allclose(chosen[1].centre, [1.9, 0.0, 0.8], atol=1e-12)
    kept = slots_of(replace(site, rows={"B": site.rows["B"]}), "shelves")
    assert [slot.frame for slot in kept] == [slot.frame for slot in chosen]
    alone = slots_of(SiteMap({"A": row("A")}, {}, alignment=aligned), "shelves")
    assert {slot.frame for slot in alone} == {"world"}


def lines_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


UNSURE = MapWarning("uncertain-element", ("bay 1 / beam 2",))


def warned_row() -> RowMap:
    return replace(row(), verdict=Verdict((UNSURE,)))


def test_openings_beside_what_is_warned_say_so(tmp_path: Path) -> None:
    site = SiteMap({"A": warned_row()}, {})
    warned = [(slot.bay, slot.level) for slot in slots_of(site, "shelves") if slot.warnings]
    assert warned == [(1, 1), (1, 2)]
    write_csv(site, tmp_path / "slots.csv", "shelves")
    lines = lines_of(tmp_path / "slots.csv")
    assert [line["warnings"] for line in lines[:3]] == ["", *[UNSURE.line] * 2]


def test_what_is_about_the_whole_row_is_on_all_of_it(tmp_path: Path) -> None:
    """A length typed 50 cm wrong stood on two of 26 openings."""
    warned = warned_row()
    assert warned.verdict is not None
    length = MapWarning("reference-conflict", ("length",), "0.51 m off", (1.0, 2.0, 0.0))
    missing = MapWarning("uncertain-element", ("bay 1 / beam 9",), place=(1.0, 2.0, 0.0))
    warned = replace(warned, verdict=Verdict((*warned.verdict.warnings, length, missing)))
    site = SiteMap({"A": warned, "B": row("B")}, {})
    assert warnings_of(warned, "upright 1") == (length,)
    assert warnings_of(warned, "bay 1 / beam 2") == (warned.verdict.warnings[0], length)
    for write, name in ((write_csv, "slots"), (write_elements, "elements")):
        write(site, tmp_path / name, "shelves")
        lines = lines_of(tmp_path / name)
        assert {line["row"] for line in lines} == {"A", "B"}
        assert all((length.line in line["warnings"]) == (line["row"] == "A") for line in lines)
    write_json(site, tmp_path / "slots.json", "shelves")
    slots = json.loads((tmp_path / "slots.json").read_text(encoding="utf-8"))["slots"]
    assert all((length.line in slot["warnings"]) == (slot["row"] == "A") for slot in slots)
    write_vertices(site, tmp_path / "map.csv")
    lines = lines_of(tmp_path / "map.csv")
    assert all((length.line in line["warnings"]) == (line["row"] == "A") for line in lines)


def test_elements_are_a_line_each(tmp_path: Path) -> None:
    write_elements(SiteMap({"A": warned_row()}, {}), tmp_path / "elements.csv", "shelves")
    lines = lines_of(tmp_path / "elements.csv")
    assert [line["element"] for line in lines[:2]] == ["upright 1", "upright 2"]
    beam = next(line for line in lines if line["element"] == "bay 1 / beam 2")
    assert (beam["bay"], beam["number"], beam["bottom_m"], beam["top_m"]) == ("1", "2", "1.2000", "1.3000")
    assert (beam["left_m"], beam["right_m"], beam["sigma_top_m"]) == ("0.1000", "3.7000", "0.01000")
    assert [line["element"] for line in lines if line["warnings"]] == ["bay 1 / beam 2"]


def unseen_edge_row() -> RowMap:
    """Of beam 2 of the first bay, whose upper edge carries level 2, that edge was not seen; of upright 1 the top."""
    ends = {"bay 1 / beam 2": {"edges": "upper edge not seen"}, "upright 1": {"ends": "top assumed"}}
    parts = []
    for one in structures_of(surveyed_row()):
        variances = np.tile(np.diag([1e-6, 1e-4, 1e-6]), (4, 1, 1))
        parts.append(replace(one, covariances=variances, attributes={**one.attributes, **ends.get(one.id, {})}))
    return row(structures=parts)


def test_tables_say_what_was_not_measured(tmp_path: Path) -> None:
    site = SiteMap({"A": unseen_edge_row()}, {})
    write_elements(site, tmp_path / "elements.csv", "shelves")
    elements = lines_of(tmp_path / "elements.csv")
    assert {line["element"]: line["assumed"] for line in elements if line["assumed"]} == {
        "upright 1": "top",
        "bay 1 / beam 2": "top",
    }
    write_csv(site, tmp_path / "slots.csv", "shelves")
    slots = lines_of(tmp_path / "slots.csv")
    assert [slot["assumed"] for slot in slots[:3]] == ["depth", "depth", "clear height | load height | depth"]
    (level,) = find(site, "bay 1 level 2")
    assert level.structure.attributes["assumed"] == "clear height, load height assumed"
    assert "assumed" not in find(site, "bay 1 level 1")[0].structure.attributes


def test_json_is_as_the_published_schema_says(tmp_path: Path) -> None:
    assert (DOCS / "slots.schema.json").read_text(encoding="utf-8") == schema_text()
    write_json(SiteMap({"A": row("A", sign(HOSTILE, 1.0, 1.3, "bay 1"))}, {}), tmp_path / "a.json", "shelves")
    text = (tmp_path / "a.json").read_text(encoding="utf-8")
    content = json.loads(text)
    jsonschema.validate(content, json.loads(schema_text()))
    assert content["slots"][2]["signs"] == [HOSTILE]
    assert "\u202e" not in text
    assert content["slots"][2]["clear_height_m"] == 1.0
    write_json(SiteMap({"A": row("A", sign(HOSTILE, 1.0, 1.3, "bay 1"))}, {}), tmp_path / "b.json", "shelves")
    assert (tmp_path / "b.json").read_bytes() == (tmp_path / "a.json").read_bytes()


def test_csv_has_units_and_no_formula(tmp_path: Path) -> None:
    write_csv(SiteMap({"=A": row("=A", sign(HOSTILE, 1.0, 1.3, "bay 1"))}, {}), tmp_path / "a.csv", "shelves")
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    assert list(lines[0]) == COLUMNS
    assert lines[2]["row"] == "'=A"
    assert lines[2]["sign"] == '\'=cmd|"a",b\\nc\N{SNOWMAN}\\u202e'
    assert (lines[2]["clear_width_m"], lines[2]["load_height_m"], lines[2]["depth"]) == ("3.6000", "1.3000", "assumed")
    assert lines[6]["clear_height_m"] == ""


def test_structures_of_another_kind_are_refused(tmp_path: Path) -> None:
    bad = replace(structures_of(surveyed_row())[-1], attributes={"bay": "x"})
    with pytest.raises(OutputError, match="'bay' should be a whole number"):
        slots_of(SiteMap({"A": row(structures=[bad])}, {}), "shelves")


def test_the_plugin_gives_its_formats(tmp_path: Path) -> None:
    for name in ("slots-csv", "slots-json", "elements-csv"):
        assert export(SiteMap({"A": row()}, {}), tmp_path / name, name).stat().st_size > 1000
