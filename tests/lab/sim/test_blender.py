"""Path-traced pictures: meshes, paints and masks everywhere; the renderer itself where the bpy wheel is installed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from savmap.geometry.pinhole import intrinsics, project
from savmap.lab.sim.blender.domain_randomization import domain_randomization, is_held_out, role
from savmap.lab.sim.blender.mesh import TEMPLATES, Part, meshes_by_shader
from savmap.lab.sim.blender.scene import MaskCaster, develop
from savmap.lab.sim.blender.style import Lens, Light, RenderStyle, Wear, area_lamps, draw_style
from savmap.lab.sim.drive.cart import world_from_level
from savmap.lab.sim.drive.views import CameraSample, view_rays
from savmap.lab.sim.render.raycast import Caster
from savmap.types.scenes import FACES, Box, Material

CLASSES = ("upright", "beam", "light")
LENS = Lens("Standard", "None", 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0, (1.0, 1.0, 1.0))
PLAIN = RenderStyle(
    2, Wear(0, 0, 0, 0, 1, 0.5, 0, (1, 1, 1), 0.0, 5.0, 0), Light(1, (1, 1, 1), 1.0, (1, 1, 1), ()), LENS
)
EYE = CameraSample(np.array([0.3, 1.2, 2.0]), world_from_level(np.array([0.0, 0.0, -1.0])), 70.0)
RED = Box(
    np.array([0.7, 1.45, -0.05]), np.array([0.4, 0.9, 0.1]), Material((0.7, 0.01, 0.01)), face_labels={"+z": "upright"}
)
WALL = Box(np.array([0.0, 1.0, -1.0]), np.array([20.0, 20.0, 0.2]), Material((0.3, 0.3, 0.3)))
LAMP = Box(
    np.array([0.0, 4.0, 1.0]),
    np.array([1.2, 0.05, 0.2]),
    Material((1.0, 1.0, 1.0), emission=10.0),
    face_labels=dict.fromkeys(FACES, "light"),
)
STRUCTURE = [
    Box(
        np.array([x, 1.0, -0.05]),
        np.array([0.1, 2.0, 0.1]),
        Material((0.02, 0.2, 0.4), "holes", seed=x),
        face_labels={"+z": "upright"},
    )
    for x in range(4)
]


@pytest.mark.parametrize("name", sorted(TEMPLATES))
def test_shapes_stay_inside_their_box_and_face_outwards(name: str) -> None:
    shape = TEMPLATES[name]  # type: ignore[index]
    assert np.abs(shape.points).max() == pytest.approx(0.5, abs=0.01)
    a, b, c = (shape.points[shape.triangles[:, k]] for k in range(3))
    assert np.einsum("ij,ij->i", np.cross(b - a, c - a), a).sum() / 6 > 0.05


def test_masks_agree_with_the_simulators_ray_caster() -> None:
    boxes = [RED, WALL, *STRUCTURE]
    mask, _ = MaskCaster(meshes_by_shader([Part(b, "paint") for b in boxes], CLASSES), [3]).cast(EYE, 64, 48)
    caster = Caster(boxes)
    rays = (view_rays(64, 48, EYE.hfov_deg) @ EYE.world_from_view.T).reshape(-1, 3)
    assert (mask.ravel() == caster.labels(caster.cast(EYE.origin, rays), CLASSES)).all()
    assert (mask == 1).sum() > 100


def test_far_fronts_are_not_judged_but_far_lamps_are() -> None:
    eye = CameraSample(np.array([0.7, 1.45, 16.0]), EYE.world_from_view, 10.0)
    meshes = meshes_by_shader([Part(RED, "paint")], CLASSES)
    assert set(np.unique(MaskCaster(meshes, far_labels=[3]).cast(eye, 32, 24)[0])) == {0, 255}
    assert set(np.unique(MaskCaster(meshes, far_labels=[1]).cast(eye, 32, 24)[0])) == {0, 1}


def test_held_out_hues_are_on_structure_of_look_3_only() -> None:
    for seed in range(20):
        for look in (2, 3):
            parts = domain_randomization(STRUCTURE, look, np.random.default_rng(seed))
            assert {is_held_out(part.box.material.color) for part in parts} == {look == 3}
            assert len({part.box.material.color for part in parts}) == 1


def test_goods_change_shape_and_structure_does_not() -> None:
    cartons = [Box(np.array([k, 1.0, -0.5]), np.full(3, 0.5), Material((0.5, 0.3, 0.2), "carton")) for k in range(30)]
    for look, allowed in ((2, {"box", "drum", "sack"}), (3, {"box", "roll", "tyres", "cone"})):
        parts = domain_randomization(cartons + STRUCTURE, look, np.random.default_rng(3))
        assert {part.shape for part in parts[:30]} == allowed
        assert {part.shape for part in parts[30:]} == {"box"}
    assert [role(box) for box in (cartons[0], LAMP, WALL, STRUCTURE[0])] == ["goods", "lamp", "surface", "structure"]


def test_area_lamps_keep_the_lamps_place_and_about_their_power() -> None:
    lamps = [
        Box(LAMP.center + np.array([3.0 * k, 0, 0]), LAMP.size, LAMP.material, face_labels=LAMP.face_labels)
        for k in range(8)
    ]
    fills = area_lamps(lamps, 1.0, (1.0, 1.0, 1.0), np.random.default_rng(0))
    assert all(fill.place[1] < 3.98 and fill.place[2] == pytest.approx(1.0) for fill in fills)
    assert sum(fill.sides_m[0] for fill in fills) == pytest.approx(22.2)
    assert 0.3 < sum(fill.watts for fill in fills) / (8 * 10 * 0.24 * np.pi) < 3


def test_looks_are_drawn_by_seed() -> None:
    assert draw_style(3, np.random.default_rng(5)) == draw_style(3, np.random.default_rng(5))
    assert draw_style(2, np.random.default_rng(5)) != draw_style(2, np.random.default_rng(6))
    with pytest.raises(ValueError, match="looks 2 and 3"):
        draw_style(1, np.random.default_rng(0))


def test_developing_keeps_pixel_centres() -> None:
    small = np.zeros((24, 32, 3), dtype=np.uint8)
    small[:, 16:] = 200
    full = develop(small, LENS, (64, 48), np.random.default_rng(0))
    assert full.shape == (48, 64, 3)
    assert full[24, 30, 0] < 100 < full[24, 33, 0]


@pytest.mark.extra("blender")
def test_picture_and_mask_agree_to_a_fraction_of_a_pixel() -> None:
    from savmap.lab.sim.blender.cycles import Effort, render, set_up

    sheet = replace(RED, center=np.array([0.7, 1.45, -0.001]), size=np.array([0.4, 0.9, 0.002]))
    meshes = meshes_by_shader([Part(sheet, "paint"), Part(WALL, "paint")], CLASSES)
    mask, _ = MaskCaster(meshes, [3]).cast(EYE, 64, 48)
    set_up(meshes, PLAIN, (), Effort(64, 48, samples=64, threads=1))
    picture = render(EYE, LENS, 64, 2.0).astype(np.float64)
    redness = picture[..., 0] - picture[..., 1]
    seen = redness > redness.max() / 2
    front = project(
        (np.array([[0.5, 1.0, 0], [0.9, 1.9, 0]]) - EYE.origin) @ EYE.world_from_view, intrinsics(70.0, 64, 48)
    )
    assert (np.sort(front[:, 1])[0], front[0, 0]) == pytest.approx(
        (np.nonzero(mask)[0].min(), np.nonzero(mask)[1].min()), abs=1
    )
    assert (seen & (mask == 1)).sum() / (seen | (mask == 1)).sum() > 0.95
    offset = np.array(np.nonzero(seen)).mean(1) - np.array(np.nonzero(mask)).mean(1)
    assert np.abs(offset).max() < 0.2


def test_command_without_blender_says_what_to_install(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    from savmap.lab.sim.blender import dataset

    with pytest.raises(SystemExit):
        dataset.main(["--count", "1", "-o", str(tmp_path)])
    assert "install the `blender` extra" in capsys.readouterr().err
