"""Signs in simulated places."""

import numpy as np
import pytest

from savmap.lab.scenes import FACES, Box, Face, Material, SceneError
from savmap.lab.sim.random_scene import random_scene
from savmap.lab.sim.render.raycast import corners as face_corners
from savmap.lab.sim.render.surfaces import surfaces_of
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import parse_scene
from savmap_signs.lab.scene import Plate, corners


def scene(**plate: object) -> dict[str, object]:
    return {
        "rows": {"A": {}},
        "structures": {"signs": {"plates": [{"at": [1.0, 2.0, 0.5], "text": "A21-03", **plate}]}},
    }


def test_a_survey_has_the_corners_as_one_reads_them() -> None:
    survey = build(parse_scene(scene(facing="x", bay=2))).survey["rows"]["A"]["signs"]
    assert [sign["text"] for sign in survey] == ["A21-03", "A21-03"]
    left, right = (np.array(sign["corners"]) for sign in survey)
    assert left[0] == pytest.approx([0.998, 2.075, 0.35])
    assert right[0] == pytest.approx([1.002, 2.075, 0.65])
    assert survey[0]["bay"] == 2


@pytest.mark.parametrize("face", ["+z", "+x", "-x"])
@pytest.mark.parametrize("size", [(0.4, 0.2), (0.2, 0.4)])
def test_a_print_is_the_right_way_up_on_its_face(face: Face, size: tuple[float, float]) -> None:
    quarters = np.zeros((64, 64, 3), np.uint8)
    quarters[:32, :32], quarters[:32, 32:], quarters[32:, :32] = [255, 0, 0], [0, 255, 0], [0, 0, 255]
    wide, thin = size[0], 0.004
    shape = np.array([wide, size[1], thin] if face == "+z" else [thin, size[1], wide])
    surfaces = surfaces_of([Box(np.zeros(3), shape, Material((1, 1, 1)), prints={face: quarters})])
    expected = corners(Plate(at=(0, 0, 0), size=size, facing=face), face)  # type: ignore[arg-type]
    assert sorted(map(tuple, expected.round(6))) == sorted(
        map(tuple, face_corners(Box(np.zeros(3), shape, Material((1, 1, 1))))[FACES.index(face)].round(6))
    )
    inner = (expected.mean(axis=0) + 0.5 * (expected - expected.mean(axis=0))).astype(np.float32)
    number = np.full(4, FACES.index(face))
    found = surfaces.albedo(number, surfaces.place(number, inner), np.full(4, 0.001, np.float32))
    assert found == pytest.approx(np.array([[1, 0, 0], [0, 1, 0], [0, 0, 0], [0, 0, 1]]), abs=0.02)


def test_a_row_that_is_not_placed_is_told() -> None:
    with pytest.raises(SceneError, match="does not place a row Q"):
        build(parse_scene(scene(row="Q")))


def test_random_signs_hang_on_what_stands_there() -> None:
    built = build(random_scene(12, ["signs"]))
    plates = built.scene.structures["signs"]["plates"]
    assert random_scene(12, ["signs"]).structures["signs"]["plates"] == plates
    fronts = built.site.fronts["A"]
    on_rack = [plate for plate in plates if plate.get("row") == "A" and plate.get("facing", "+z") == "+z"]
    assert on_rack
    for plate in on_rack:
        x, y, z = plate["at"]
        held = [f for f in fronts if f.low[0] <= x <= f.high[0] and f.low[1] <= y <= f.high[1]]
        assert held
        assert z > max(front.high[2] for front in held) - 0.001
