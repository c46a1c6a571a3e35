"""Building models (IFC): which elements have a label, where they stand, and how large they are."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import savmap
from savmap.apps.exchange.imports import model
from savmap.apps.exchange.imports.boxes import Mesh, box_of
from savmap.apps.exchange.imports.model_reader import read as read_model
from savmap.apps.exchange.imports.records import FileElements, ImportOptions, SurveyElement
from savmap.apps.exchange.imports.survey import elements_of
from savmap.errors import OutputError

from .made_up_building import PLACE, Building, bays

pytestmark = pytest.mark.extra("bim")
LABELS = {"post": "post", "ifccolumn": "post", "ifcbeam": "bar", "ifclightfixture": "tube"}
NEAREST_M = 1e-6


def read(folder: Path, building: Building, labels: Mapping[str, str] | None = None, **options: Any) -> FileElements:
    """The elements by the process that reads them, in this one."""
    path = building.write(folder / "hall.ifc")
    return read_model(path, ImportOptions(labels=labels or {}, **options), LABELS)


def in_storey(element: SurveyElement) -> np.ndarray:
    """The corners in the storey's frame, mm."""
    turn = np.deg2rad(30)
    axes = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    return 1000 * (element.structure.vertices - [5, 3, 0.3]) @ axes.T


def extent(element: SurveyElement) -> list[list[float]]:
    corners = in_storey(element)
    return np.round([corners.min(axis=0), corners.max(axis=0)], 3).tolist()


@pytest.mark.parametrize("schema", ["IFC4", "IFC2X3", "IFC4X3"])
def test_a_rack_of_somebody_elses_making_is_a_survey(schema: str, tmp_path: Path) -> None:
    path = bays(schema).write(tmp_path / "rack.ifc")
    result = savmap.import_survey(path, row="A", places=[PLACE])
    survey = result.survey.rows["A"]
    assert np.array(survey["uprights"]) == pytest.approx(np.array([[0, 0.1], [2.8, 2.9], [5.6, 5.7]]), abs=NEAREST_M)
    levels = np.array([[1.38, 1.5], [2.88, 3.0], [4.38, 4.5]])
    for bay in survey["sections"]:
        assert np.array(bay["beams"]) == pytest.approx(levels, abs=NEAREST_M)
    assert result.counts == {"A": {"upright": 3, "beam": 6}}
    assert result.notes[0] == "elements without a label, passed over: 1 IfcSlab"
    assert result.notes[1].endswith("and 1 more are left out: something else is nearer to the face")


def test_labels_are_those_of_names_types_layers_and_classes(tmp_path: Path) -> None:
    building = Building()
    block = building.block(100, 60, 2000)
    items = [
        building.add("IfcBuildingElementProxy", "POST", block, (0, 0, 0)),
        building.add("IfcMember", "M1", building.block(1, 1, 9), (0, 0, 0)),
        building.add("IfcMember", "M2", building.block(1, 1, 9), (0, 0, 0)),
        building.add("IfcBeam", "B", building.block(1, 1, 9), (0, 0, 0)),
        building.add("IfcWall", "W", building.block(1, 1, 9), (0, 0, 0)),
    ]
    building.typed(items[1], "IfcMemberType", "Rail 120", PredefinedType="MEMBER")
    building.make("IfcPresentationLayerAssignment", "S-LAMP", None, [items[2].Representation.Representations[0]])
    usual = read(tmp_path, building)
    assert [element.structure.label for element in usual.elements] == ["post", "bar"]
    assert usual.notes == ("elements without a label, passed over: 2 IfcMember, 1 IfcWall",)
    chosen = read(tmp_path, building, {"rail 120": "bar", "s-lamp": "tube", "IfcWall": "post"})
    assert {element.structure.id.split(" (")[0]: element.structure.label for element in chosen.elements} == {
        "IfcMember M1": "bar",
        "IfcMember M2": "tube",
        "IfcWall W": "post",
    }
    assert chosen.notes == ("elements without a label, passed over: 1 IfcBuildingElementProxy, 1 IfcBeam",)
    with pytest.raises(
        OutputError, match=r"no element has .* \(post, bar, tube\); .* IfcMember M1, .*say --layer NAME"
    ):
        read(tmp_path, building, {"rail": "bar"})


def test_a_class_that_a_schema_has_of_types_alone_is_that_of_the_type(tmp_path: Path) -> None:
    building = Building("IFC2X3")
    lamp = building.add("IfcFlowTerminal", "L", building.block(1400, 100, 80), (0, 0, 5000))
    building.typed(lamp, "IfcLightFixtureType", "LED", PredefinedType="POINTSOURCE")
    (element,) = read(tmp_path, building).elements
    assert (element.structure.label, element.frame, element.row) == ("tube", "world", "")
    assert extent(element) == [[-700, -50, 5000], [700, 50, 5080]]


def test_parts_of_an_assembly_with_a_label_are_a_single_element(tmp_path: Path) -> None:
    building = Building()
    legs = [building.add("IfcMember", "leg", building.block(100, 60, 5000), (0, y, 0)) for y in (0, 1000)]
    braces = [building.add("IfcMember", "brace", building.block(30, 940, 30), (0, 500, z)) for z in (1000, 2485)]
    building.assemble("Post", [*legs, *braces])
    (element,) = read(tmp_path, building).elements
    assert extent(element) == [[-50, -30, 0], [50, 1030, 5000]]


def test_plates_at_the_ends_do_not_count_and_a_round_tube_is_as_wide_as_it_is(tmp_path: Path) -> None:
    building = Building()
    plate, bar = building.block(200, 150, 10), building.girder(120, 50, 2700)
    building.add("IfcBeam", "bar", building.shared(bar, plate)(), (0, 0, 1000), z=(1, 0, 0), x=(0, 1, 0))
    building.add("IfcColumn", "tube", building.tube(40, 3000), (500, 500, 0))
    beam, tube = read(tmp_path, building).elements
    assert extent(beam) == [[0, -25, 940], [2700, 25, 1060]]
    assert np.abs(np.array(extent(tube)) - [[460, 460, 0], [540, 540, 3000]]).max() < 1


def test_a_body_that_is_turned_in_its_placement_has_the_smallest_upright_box() -> None:
    turn = np.deg2rad(25)
    axes = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    corners = np.array([[x, y, z] for x in (0, 2.0) for y in (0, 0.1) for z in (0, 0.3)]) + np.array([100.0, 200, 1])
    mesh = Mesh(corners @ axes, np.array([[0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5]]), np.eye(4))
    assert box_of([mesh]) == pytest.approx(corners @ axes)


def test_units_are_the_files_or_those_that_are_given(tmp_path: Path) -> None:
    def building(unit: bool) -> Building:
        made = Building(unit=unit)
        made.add("IfcColumn", "P", made.block(100, 60, 2000), (0, 0, 0))
        return made

    with pytest.raises(OutputError, match="says no unit of length: say it, such as --unit mm"):
        read(tmp_path, building(False))
    sizes = [
        np.ptp(read(tmp_path, building(known), unit=unit).elements[0].structure.vertices[:, 2])
        for known, unit in ((True, None), (False, "mm"), (True, "cm"), (True, "m"))
    ]
    assert sizes == pytest.approx([2, 2, 20, 2000])


def test_a_model_may_lie_in_a_grid_whose_eastings_have_eight_digits(tmp_path: Path) -> None:
    shapes = [Building(east_mm=east) for east in (5000, 32_505_005_000)]
    for building in shapes:
        building.add("IfcColumn", "c", building.block(100, 60, 2000), (0, 0, 0))
    near, far = (read(tmp_path, building).elements[0].structure.vertices for building in shapes)
    assert far - near == pytest.approx(np.tile([32_505_000.0, 0, 0], (8, 1)), abs=1e-6)


def test_what_has_no_body_is_named(tmp_path: Path) -> None:
    building = Building()
    building.add("IfcColumn", "P1", building.block(100, 60, 2000), (0, 0, 0))
    building.add("IfcColumn", "P2", building.block(0, 0, 0), (0, 0, 0))
    result = read(tmp_path, building)
    assert len(result.elements) == 1
    assert "elements whose body is not there or cannot be made, left out: 1 (IfcColumn P2 (#" in result.notes[0]
    building.add("IfcColumn", "P3", building.block(100, 60, 2000), (1e13, 0, 0))
    with pytest.raises(OutputError, match=r"P3 .* is not finite, or too far away"):
        read(tmp_path, building)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is no IFC model in STEP's text"),
        (b"PK\x03\x04" + bytes(range(256)), "is no IFC model in STEP's text"),
        (b"ISO-10303-21;\nHEADER;\n", "is an IFC model that is cut off: its last line is missing"),
        (b"ISO-10303-21;\nDATA;\n\x00#1=\nEND-ISO-10303-21;", "is not an IFC model that can be read"),
    ],
)
def test_what_is_no_model_is_one_line(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "hall.ifc").write_bytes(content)
    with pytest.raises(OutputError, match=rf"hall\.ifc: {message}") as caught:
        elements_of(tmp_path / "hall.ifc", ImportOptions(), LABELS)
    assert "\n" not in str(caught.value)


def test_a_damaged_model_is_read_as_far_as_possible(tmp_path: Path) -> None:
    building = Building()
    building.add("IfcColumn", "P", building.block(100, 60, 2000), (0, 0, 0))
    building.add("IfcWall", "W", building.block(100, 60, 2000), (0, 0, 0))
    path = building.write(tmp_path / "hall.ifc")
    path.write_bytes(path.read_bytes().replace(b"IFCWALL(", b"IFCWOLL("))
    result = elements_of(path, ImportOptions(), LABELS)
    assert len(result.elements) == 1
    assert result.notes == ("the model is damaged in 1 places, and was read as far as possible",)


def test_a_reader_that_ends_or_takes_too_long_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = Building().write(tmp_path / "hall.ifc")
    monkeypatch.setattr(model, "MOST_S", 0.01)
    with pytest.raises(OutputError, match=r"hall\.ifc: takes more than 0\.01 s to read"):
        elements_of(path, ImportOptions(), LABELS)
    monkeypatch.setattr(model, "MOST_S", 60.0)
    monkeypatch.setattr(model.sys, "executable", "/bin/false")
    with pytest.raises(OutputError, match=r"hall\.ifc: is damaged: it ends the program that reads it"):
        elements_of(path, ImportOptions(), LABELS)
    monkeypatch.setattr(model, "MOST_MB", 1e-4)
    with pytest.raises(OutputError, match="is larger than"):
        elements_of(path, ImportOptions(), LABELS)
