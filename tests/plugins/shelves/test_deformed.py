"""Racks out of shape in the simulator: boxes, survey and observations follow the same curves; straight ones are as ever."""

from typing import Any

import numpy as np
import pytest

from savmap.lab.scenes import SceneError
from savmap.lab.sim.drive.cart import drive
from savmap.lab.sim.observations import MaskErrors
from savmap.lab.sim.scene.build import Built, build
from savmap.lab.sim.scene.files import parse_scene
from savmap.types import Feature, ViewSpec
from savmap_shelves.lab.observed import members, observed_parts
from savmap_shelves.lab.rack import Curve, Rack
from savmap_shelves.lab.random_racks import deformed
from savmap_shelves.lab.scene import survey_of
from savmap_shelves.report.evaluation import read_row

VIEW = ViewSpec("shelf", yaw_deg=-90.0, hfov_deg=130.0, width=1280, height=1600)
STRAIGHT: dict[str, Any] = {
    "bays": [{"width": 2.7, "beams": [0.3, 1.5, 2.7]}, {"width": 2.7, "beams": [0.3, 1.5, 2.7]}],
    "height": 3.0,
    "labels": 0.0,
}
BENT = {
    **STRAIGHT,
    "leans": [0.0, 10.0, 0.0],
    "bows": [0.02, 0.0, 0.0],
    "bays": [{**STRAIGHT["bays"][0], "tilts": [0.0, 2.0, 0.0], "sags": [0.0, 0.0, 0.03]}, STRAIGHT["bays"][1]],
}


def built(rack: dict[str, Any]) -> Built:
    cart = {"start": [-0.5, 1.5], "end": [6.0, 1.5], "height": 1.6, "frames": 6}
    return build(
        parse_scene({"cart": cart, "goods": {"density": 0.0}, "structures": {"shelves": {"rows": {"A": rack}}}})
    )


def fronts(made: Built, label: str) -> list[np.ndarray]:
    return [box.center for box in made.boxes if box.face_labels == {"+z": label}]


def test_a_curve_is_off_by_its_slope_and_its_bow() -> None:
    curve = Curve(1.0, 4.0, 0.01, 0.02)
    assert [float(curve.at(at)) for at in (1.0, 3.0, 5.0)] == pytest.approx([0.0, 0.04, 0.04])
    assert curve.mean == pytest.approx(float(np.mean(curve.at(np.linspace(1.0, 5.0, 10001)))), abs=1e-5)
    assert len([*curve.pieces]) == 12
    assert [*Curve(1.0, 4.0, 0.01).pieces] == [(1.0, 5.0)]


def test_what_is_straight_is_one_box_and_has_no_shapes() -> None:
    made = built(STRAIGHT)
    assert len(fronts(made, "upright")) == 3
    assert all(np.array_equal(box.rotation, np.eye(3)) for box in made.boxes if "+z" in box.face_labels)
    assert "shapes" not in made.survey["rows"]["A"]
    zeros = {**STRAIGHT, "leans": [0.0] * 3, "bows": [0.0] * 3}
    for one, other in zip(made.boxes, built(zeros).boxes, strict=True):
        assert np.array_equal(one.center, other.center)
        assert np.array_equal(one.size, other.size)


def test_boxes_lean_are_bowed_and_sag() -> None:
    made = built(BENT)
    uprights = np.array(fronts(made, "upright"))
    leaning = uprights[np.abs(uprights[:, 0] - 2.85) < 0.1]
    assert leaning[:, 0] == pytest.approx([2.85 + 1.5 * 0.01])
    bowed = uprights[uprights[:, 0] < 0.2]
    middle = bowed[np.abs(bowed[:, 1] - 1.5) < 0.2]
    assert middle[:, 0] == pytest.approx(np.full(2, 0.05 + 0.02), abs=3e-4)
    sagging = np.array([at for at in fronts(made, "beam") if at[1] > 2.6 and at[0] < 2.8])
    assert len(sagging) == 12
    assert sagging[:, 1].min() == pytest.approx(2.75 - 0.03, abs=5e-4)
    assert sagging[:, 1].max() > 2.74


def test_beams_reach_from_upright_to_upright_where_these_stand_at_their_height() -> None:
    beams = [member for member in members(built(BENT), "A") if member.truth.label == "beam"]
    top_left, top_right = beams[2].curve, beams[5].curve
    assert top_left.start + top_left.length == pytest.approx(2.8 + 0.01 * 2.7)
    assert top_right.start == pytest.approx(2.9 + 0.01 * 2.7)


def test_the_survey_has_members_where_they_are_on_average_and_their_shapes() -> None:
    entry = built(BENT).survey["rows"]["A"]
    assert entry["uprights"][1][0] == pytest.approx(2.8 + 0.015)
    assert entry["uprights"][0][0] == pytest.approx(2 / 3 * 0.02)
    assert entry["sections"][0]["beams"][2][0] == pytest.approx(2.7 - 2 / 3 * 0.03)
    assert entry["shapes"]["leans_permille"] == (0.0, 10.0, 0.0)
    assert len(read_row(entry).sections) == 2


@pytest.mark.parametrize("wrong", [{"leans": [1.0]}, {"bays": [{**STRAIGHT["bays"][0], "sags": [0.01]}]}])
def test_one_value_for_each_member_or_none(wrong: dict[str, Any]) -> None:
    with pytest.raises(SceneError, match="one value for each"):
        built({**STRAIGHT, **wrong})


def test_observed_parts_lie_on_the_curves() -> None:
    made = built(BENT)
    path = drive(made.scene.cart, 1)
    pixel = np.zeros((1, 2)), np.eye(2)[None]
    features = [
        Feature(frame, VIEW.name, member.truth.label, "left", number, *pixel, object=member.truth.object)
        for frame in range(len(path.origins))
        for number, member in enumerate(members(made, "A"))
    ]
    parts = [*observed_parts(made, "A", path, VIEW, MaskErrors(sigma_px=0.0), 1, features)]
    assert {part.part for part in parts} == {"left part", "right part", "lower part", "upper part"}
    assert all(part.score == 0.0 for part in parts)
    bowed = next(member for member in members(made, "A") if member.truth.object == "upright 1")
    left = [part for part in parts if part.object == "upright 1" and part.part == "left part" and part.frame == 0]
    turn, origin = path.world_from_rig[0] @ VIEW.rig_from_view, path.origins[0]
    for part in left:
        ray = turn @ np.array([*(part.pixels[0] - VIEW.camera[:2, 2]) / VIEW.camera[0, 0], 1.0])
        x, y = (origin - origin[2] / ray[2] * ray)[:2]
        assert x == pytest.approx(float(bowed.points(np.array([y]))[0, 0, 0]), abs=1e-6)
    assert len(left) >= 4


def test_deformed_racks_have_straight_members_beside_others() -> None:
    rack = deformed({**STRAIGHT, "bays": STRAIGHT["bays"] * 4}, np.random.default_rng(3))
    assert sum(lean != 0 for lean in rack["leans"]) == 5
    assert 0 < sum(sag > 0 for bay in rack["bays"] for sag in bay["sags"]) < 24
    assert "shapes" in survey_of(Rack.model_validate(rack))
