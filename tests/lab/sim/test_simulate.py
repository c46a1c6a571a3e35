"""Simulated footage: what the folder holds, that pictures agree with masks and poses, and that all repeats."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.geometry.sphere import panorama_pixels_from_rays
from savmap.lab.sim.dataset import IGNORED, main, view_mask, write
from savmap.lab.sim.drive.views import sample_camera
from savmap.lab.sim.render.panorama import encode, panorama
from savmap.lab.sim.render.raycast import Caster
from savmap.lab.sim.render.shade import Renderer, renderer
from savmap.lab.sim.scene.build import Built
from savmap.lab.sim.scene.files import Cart, Scene
from savmap.lab.sim.simulate import classes_in, simulate
from savmap.types import ViewSpec

CLASSES = ("upright", "beam", "light")

FACE = ViewSpec("face", yaw_deg=-90.0, hfov_deg=100.0, width=64, height=48)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, scene_with: Callable[..., Scene]) -> Path:
    folder = tmp_path_factory.mktemp("simulated") / "out"
    simulate(scene_with(), folder, masks=[FACE])
    return folder


def test_the_folder_holds_footage_and_truth(folder: Path) -> None:
    assert {item.name for item in folder.iterdir()} == {
        "footage.mp4", "survey.json", "references.json", "site.yaml", "poses.json", "goods.json", "scene.yaml", "masks",
    }  # fmt: skip
    with av.open(str(folder / "footage.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.width, stream.height) == ("h264", 256, 128)
        assert stream.average_rate == 15
        images = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(images) == 3
    assert 60 < np.mean(images) < 200
    assert not list(folder.parent.glob(".*"))


def test_footage_is_written_under_any_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("10:00").mkdir()
    encode([np.zeros((64, 128, 3), np.uint8)] * 3, Cart(width=128), Path("10:00/footage.mp4"))
    assert Path("10:00/footage.mp4").stat().st_size > 0


def test_truth_is_consistent(folder: Path) -> None:
    survey, known, poses = (json.loads((folder / f"{n}.json").read_text()) for n in ("survey", "references", "poses"))
    assert (survey["format"], survey["version"], list(survey["rows"])) == ("savmap-survey", 1, ["A", "B"])
    assert known["row_A"]["lowest_beam_bottom_height_m"]["values"] == [0.2, 1.8]
    assert known["row_A"]["first_to_last_upright_outer_edges_m"]["value"] == pytest.approx(3.8)
    heights = [frame["world_from_rig"][1][3] for frame in poses["frames"]]
    assert known["camera_height_m"]["value"] == pytest.approx(np.mean(heights), abs=1e-3)
    assert known["camera_travel_m"]["value"] == 2.5


def test_goods_stand_in_the_rows(folder: Path) -> None:
    goods = json.loads((folder / "goods.json").read_text())
    assert (goods["format"], list(goods["rows"])) == ("savmap-goods", ["A", "B"])
    low, high = np.moveaxis(np.array(goods["rows"]["A"]), 1, 0)
    assert len(low) > 0
    assert (high > low).all()
    assert low[:, 0].min() > 0
    assert high[:, 0].max() < 3.8
    assert low[:, 1].min() > 0


def test_masks_show_the_surveyed_structures(folder: Path) -> None:
    poses = json.loads((folder / "poses.json").read_text())
    matrix = np.array(poses["frames"][1]["world_from_rig"])
    mask = cv2.imread(str(folder / "masks" / "face" / "000001.png"), cv2.IMREAD_UNCHANGED)
    assert mask.shape == (48, 64)
    assert set(np.unique(mask)) <= {0, 1, 2, 3}
    middle = np.array([0.1 / 2 + 2.1, 1.4, 0.0])
    in_view = FACE.rig_from_view.T @ matrix[:3, :3].T @ (middle - matrix[:3, 3])
    u, v, w = FACE.camera @ in_view
    assert mask[round(v / w), round(u / w)] == 1


def test_the_same_scene_gives_the_same_files(folder: Path, tmp_path: Path, scene_with: Callable[..., Scene]) -> None:
    simulate(scene_with(), tmp_path / "again", workers=1)
    for name in ("footage.mp4", "poses.json", "survey.json"):
        first, second = ((place / name).read_bytes() for place in (folder, tmp_path / "again"))
        assert hashlib.sha256(first).digest() == hashlib.sha256(second).digest(), name


def test_a_folder_that_cannot_be_written_leaves_nothing(tmp_path: Path, scene_with: Callable[..., Scene]) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="cannot be written"):
        simulate(scene_with(), tmp_path / "file" / "out")
    assert [item.name for item in tmp_path.iterdir()] == ["file"]


@pytest.fixture(scope="module")
def scene(built: Built) -> Renderer:
    return renderer(built)


def test_lamps_are_the_brightest_and_where_the_survey_says(built: Built, scene: Renderer) -> None:
    turn, origin = np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]]), np.array([1.5, 1.5, 1.2])
    look = built.scene.look.model_copy(update={"noise": 0.0})
    image = panorama(scene, origin, turn, 256, look)
    lamps = [np.mean(lamp["ends"], axis=0) for lamp in built.survey["rows"]["A"]["lights"]]
    pixels = panorama_pixels_from_rays((np.array(lamps) - origin) @ turn, 256).round().astype(int)
    assert len(lamps) > 4
    assert image[pixels[:, 1], pixels[:, 0] % 512].min() > 240
    assert np.median(image) < 200


def test_bands_join_without_a_seam(built: Built, scene: Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    look = built.scene.look.model_copy(update={"noise": 0.0})
    place = np.array([1.5, 1.5, 1.2])
    whole = panorama(scene, place, np.eye(3), 64, look)
    monkeypatch.setattr("savmap.lab.sim.render.panorama._BAND_PIXELS", 128 * 7)
    np.testing.assert_array_equal(panorama(scene, place, np.eye(3), 64, look), whole)


def test_masks_have_the_classes_of_other_plugins_after_ours(built: Built, folder: Path) -> None:
    assert json.loads((folder / "masks" / "classes.json").read_text()) == {"classes": list(CLASSES)}
    crates = [replace(built.boxes[0], face_labels={"+z": name}) for name in ("crate", "bin", "beam")]
    assert classes_in(replace(built, boxes=[*built.boxes, *crates])) == [*CLASSES, "bin", "crate"]


def test_a_data_set_of_other_classes_is_not_mixed_in(tmp_path: Path, scene_with: Callable[..., Scene]) -> None:
    write(tmp_path, 4, 0, "row", ("light",), lambda seed: scene_with(seed=seed))
    write(tmp_path, 5, 0, "row", ("light",), lambda seed: scene_with(seed=seed))
    with pytest.raises(OutputError, match=r"dataset\.json: is of pictures with other classes"):
        write(tmp_path, 4, 0, "row", ("upright", "light"), lambda seed: scene_with(seed=seed))
    assert json.loads((tmp_path / "dataset.json").read_text())["classes"] == ["light"]


@pytest.mark.parametrize("wrong", [["--seed", "-1", "--count", "1"], ["--count", "0"]])
def test_numbers_that_a_data_set_cannot_have(
    wrong: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main([*wrong, "-o", str(tmp_path / "out")])
    assert end.value.code == 2
    assert "--seed is 0 or more, --count 1 or more" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_data_set_is_labelled(tmp_path: Path, scene_with: Callable[..., Scene]) -> None:
    write(tmp_path, 4, 1, "row", scene_of=lambda seed: scene_with(seed=seed))
    (picture,), (mask,) = (list((tmp_path / kind).iterdir()) for kind in ("images", "masks"))
    assert picture.stem == mask.stem
    assert cv2.imread(str(picture)).shape == (480, 640, 3)
    classes = cv2.imread(str(mask), cv2.IMREAD_UNCHANGED)
    assert set(np.unique(classes)) <= {0, 1, 2, 3, IGNORED}
    assert (classes == 1).any() or (classes == 2).any()
    assert json.loads((tmp_path / "dataset.json").read_text())["classes"] == list(CLASSES)


def test_fronts_too_far_away_are_not_judged(built: Built) -> None:
    camera = sample_camera(built, np.random.default_rng(2))
    mask = view_mask(Caster(built.boxes), camera, CLASSES, 80, 60)
    assert mask.shape == (60, 80)
    far = type(camera)(
        built.frames["A"].to_world(np.array([1.0, 1.5, 16.0])),
        camera.world_from_view * 0 + np.diag([1.0, -1, -1]),
        40.0,
    )
    racks = [box for box in built.boxes if set(box.face_labels) == {"+z"} and box.center[2] < 0]
    assert set(np.unique(view_mask(Caster(racks), far, CLASSES, 80, 60))) == {0, IGNORED}
