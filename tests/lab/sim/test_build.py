"""Scenes: strict files, boxes that agree with the survey, labels on mapped fronts alone."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from savmap.lab.scenes import SceneError
from savmap.lab.sim.drive.views import sample_camera
from savmap.lab.sim.random_scene import random_scene
from savmap.lab.sim.render.raycast import Caster
from savmap.lab.sim.scene.build import Built, build, face_size, mapped_rows, row_fronts
from savmap.lab.sim.scene.files import Scene, load_scene, parse_scene
from savmap.types import Floats

EXAMPLES = Path(__file__).parents[3] / "examples" / "scenes"


def test_fronts_of_every_mapped_row_are_where_the_survey_says(built: Built) -> None:
    assert mapped_rows(built) == ["A", "B"] == list(built.survey["rows"])
    for name, entry in built.survey["rows"].items():
        fronts = row_fronts(built, name)
        uprights = sorted((front.low[0], front.high[0]) for front in fronts if front.label == "upright")
        np.testing.assert_allclose(uprights, entry["uprights"], atol=1e-9)
        for index, section in enumerate(entry["sections"]):
            left, right = entry["uprights"][index][1], entry["uprights"][index + 1][0]
            beams = [
                (front.low, front.high)
                for front in fronts
                if front.label == "beam" and left - 1e-9 <= front.low[0] < right
            ]
            np.testing.assert_allclose(sorted((lo[1], hi[1]) for lo, hi in beams), section["beams"], atol=1e-9)
            np.testing.assert_allclose([(lo[0], hi[0]) for lo, hi in beams], [(left, right)] * len(beams), atol=1e-9)
            np.testing.assert_allclose([hi[2] for _, hi in beams], -0.005, atol=1e-9)
        assert face_size(built, name) == pytest.approx((3.8, 3.0))


def test_rays_to_surveyed_points_hit_their_class(built: Built) -> None:
    caster = Caster(built.boxes)
    for name in ("A", "B"):
        frame, entry = built.frames[name], built.survey["rows"][name]
        targets = [([(a + b) / 2, 2.9, 0.0], 1) for a, b in entry["uprights"]]
        targets += [([1.1, (a + b) / 2, -0.005], 2) for a, b in entry["sections"][0]["beams"]]
        targets += [(np.mean(lamp["ends"], axis=0), 3) for lamp in entry["lights"]]
        origin = frame.to_world(np.array([1.1, 2.0, 1.15]))
        rays = frame.to_world(np.array([point for point, _ in targets])) - origin
        hits = caster.cast(origin, rays / np.linalg.norm(rays, axis=1, keepdims=True))
        assert caster.labels(hits, ("upright", "beam", "light")).tolist() == [label for _, label in targets]


def test_rows_that_are_not_mapped_carry_no_labels(built: Built) -> None:
    behind = [box for box in built.boxes if box.center[2] < -1.15]
    assert len(behind) > 20
    assert not any(box.face_labels for box in behind)


def test_identical_goods_are_the_same_in_every_bay() -> None:
    scene = load_scene(EXAMPLES / "identical-row.yaml")
    pitch = 2.8

    def goods(bay: int, identical: bool) -> Floats:
        chosen = scene.model_copy(update={"goods": scene.goods.model_copy(update={"identical": identical})})
        cartons = [box for box in build(chosen).boxes if box.material.texture == "carton"]
        places = [box.center - [bay * pitch, 0, 0] for box in cartons]
        return np.array(sorted(place.tolist() for place in places if 0.1 < place[0] < 2.8))

    assert len(goods(0, True)) >= 5
    np.testing.assert_allclose(goods(3, True), goods(0, True), atol=1e-9)
    assert goods(3, False).shape != goods(0, False).shape or not np.allclose(goods(3, False), goods(0, False))


@pytest.mark.parametrize("seed", range(4))
def test_random_scenes_are_sound(seed: int) -> None:
    built = build(random_scene(seed))
    sizes = np.array([box.size for box in built.boxes])
    assert np.isfinite(sizes).all()
    assert (sizes > 0).all()
    camera = sample_camera(built, np.random.default_rng(seed))
    np.testing.assert_allclose(camera.world_from_view.T @ camera.world_from_view, np.eye(3), atol=1e-12)
    assert 0 < camera.origin[1] < built.scene.hall.height
    assert built.aisle_z[0] < camera.origin[2] < built.aisle_z[1]


def test_a_misspelt_key_is_named(scene_with: Callable[..., Scene]) -> None:
    with pytest.raises(SceneError, match=r"hall\.heigth"):
        parse_scene({"hall": {"heigth": 3}})
    with pytest.raises(SceneError, match=r"structures.shelves.*beam_hight"):
        build(scene_with(structures={"shelves": {"rows": {"A": {"bays": [{"width": 2.0}], "beam_hight": 0.1}}}}))


def test_a_row_without_a_place_and_a_structure_without_a_plugin_are_named(scene_with: Callable[..., Scene]) -> None:
    with pytest.raises(SceneError, match="does not place a row Z"):
        build(scene_with(structures={"shelves": {"rows": {"Z": {"bays": [{"width": 2.0}]}}}}))
    with pytest.raises(SceneError, match=r"structures\.cranes"):
        build(scene_with(structures={"cranes": {}}))


def test_the_examples_are_scenes() -> None:
    paper = build(load_scene(EXAMPLES / "paper-row.yaml")).survey["rows"]["A"]
    levels = [len(section["beams"]) for section in paper["sections"]]
    assert (len(levels), min(sorted(levels)[1:]), max(levels)) == (15, 5, 11)
    assert paper["uprights"][-1][1] == pytest.approx(55, abs=0.5)
    assert len(build(load_scene(EXAMPLES / "short-row.yaml")).survey["rows"]["A"]["sections"]) == 4
