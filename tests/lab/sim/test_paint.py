"""The painter: what is seen, where, in which colour, and how it is labelled."""

import json
from pathlib import Path

import numpy as np
import pytest

from savmap.geometry.pinhole import focal_px
from savmap.lab.sim.dataset import Sample, write_series
from savmap.lab.sim.paint.atlas import TILE, Atlas, atlas_of
from savmap.lab.sim.paint.develop import developed
from savmap.lab.sim.paint.faces import Lighting
from savmap.lab.sim.paint.noise import texture
from savmap.lab.sim.paint.raster import Camera, camera_at
from savmap.lab.sim.paint.shade import Painted, painted
from savmap.lab.sim.paint.stage import Stage, Surface, Tag

SIZE = 320, 240
EVEN = Lighting(np.zeros((0, 3)), np.zeros(0), 1.0, 0.0, 0.0)
WHITE, HALVES, FILM = (Surface(tile) for tile in range(3))


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    """A white tile, one that is dark below, one for veils."""
    white = np.ones((TILE, TILE), np.float32)
    halves = white.copy()
    halves[TILE // 2 :] = 0.2
    return atlas_of([texture(white), texture(halves), texture(white, 0.5)])


def stage() -> Stage:
    return Stage(np.random.default_rng(0))


def ahead(yaw: float = 0.0, pitch: float = 0.0) -> Camera:
    """Four metres before z = 0, a metre and a half up."""
    return camera_at(np.array([0.0, 1.5, 4.0]), yaw, pitch, 0.0, 60.0)


def seen(place: Stage, atlas: Atlas, camera: Camera | None = None, haze: float = 0.0) -> Painted:
    return painted(place.faces(), atlas, EVEN, camera or ahead(), SIZE, 2, haze)


def extent(chosen: np.ndarray) -> tuple[float, float, float, float]:
    """Left, top, right and bottom borders of the chosen pixels."""
    rows, columns = np.flatnonzero(chosen.any(axis=1)), np.flatnonzero(chosen.any(axis=0))
    return columns[0] - 0.5, rows[0] - 0.5, columns[-1] + 0.5, rows[-1] + 0.5


def test_a_face_is_where_a_pinhole_sees_it(atlas: Atlas) -> None:
    place = stage()
    place.box((-0.6, 1.0, -0.3), (0.4, 1.7, 0.0), WHITE, tag=Tag(1, 0.7))
    mask = seen(place, atlas).mask
    focal = focal_px(60.0, SIZE[0]) / 4.0
    expected = (159.5 - 0.6 * focal, 119.5 - 0.2 * focal, 159.5 + 0.4 * focal, 119.5 + 0.5 * focal)
    assert extent(mask == 1) == pytest.approx(expected, abs=0.8)
    assert (mask == 1).sum() == pytest.approx(0.7 * focal**2, rel=0.03)


def test_nearer_faces_hide_farther_ones_in_any_order(atlas: Atlas) -> None:
    masks = []
    for order in (1, -1):
        place = stage()
        for z, label in ((0.0, 1), (0.5, 2), (1.0, 0))[::order]:
            place.box((-0.5 + z / 2, 1.0, z - 0.1), (0.5, 2.0, z), WHITE, tag=Tag(label))
        masks.append(seen(place, atlas).mask)
    assert np.array_equal(*masks)
    assert set(np.unique(masks[0])) == {0, 1, 2}
    assert masks[0][119, 159 + 50] == 0


def test_members_that_look_thin_are_not_judged(atlas: Atlas) -> None:
    place = stage()
    place.box((-0.5, 1.0, -0.1), (-0.2, 2.0, 0), WHITE, tag=Tag(1, 0.05))
    place.box((0.2, 1.0, -0.1), (0.5, 2.0, 0), WHITE, tag=Tag(1, 0.03))
    mask = seen(place, atlas).mask  # 69 px a metre: 3.5 and 2.1 px
    assert set(np.unique(mask[:, :159])) == {0, 1}
    assert set(np.unique(mask[:, 170:])) == {0, 255}


def test_textures_stand_upright_and_take_their_tint(atlas: Atlas) -> None:
    place = stage()
    place.box((-1, 0.5, -1), (1, 2.5, 0), Surface(HALVES.tile, (0.5, 1.0, 0.1)))
    linear = seen(place, atlas).linear
    assert linear[90, 160] == pytest.approx((0.5, 1.0, 0.1), abs=0.01)
    assert linear[150, 160] == pytest.approx((0.02, 0.04, 0.004), abs=0.005)


def test_a_floor_runs_under_the_camera(atlas: Atlas) -> None:
    place = stage()
    place.quad((-500, 0, 500), (1000, 0, 0), (0, 0, -1000), WHITE)
    linear = seen(place, atlas).linear
    assert linear[125:].min() > 0.9
    assert linear[:118].max() == 0


def test_meshes_are_seen_through(atlas: Atlas) -> None:
    place = stage()
    place.quad((-1, 0.5, 0), (2, 0, 0), (0, 2, 0), WHITE, mesh=(10.0, 0.0, 0.25), tag=Tag(1))
    inside = seen(place, atlas).linear[60:180, 100:220].mean()
    assert inside == pytest.approx(0.25, abs=0.05)


def test_veils_lie_over_what_is_behind_them(atlas: Atlas) -> None:
    place = stage()
    place.box((-1, 0.5, -0.1), (1, 2.5, 0), Surface(WHITE.tile, (0.0, 0.0, 0.0)), tag=Tag(2))
    place.quad((-1, 0.5, 0.1), (1, 0, 0), (0, 2, 0), FILM, veil=1.0)
    place.quad((0, 0.5, -0.5), (1, 0, 0), (0, 2, 0), FILM, veil=1.0)
    result = seen(place, atlas)
    assert result.linear[119, 130].mean() == pytest.approx(0.5, abs=0.02)
    assert result.linear[119, 190].max() == 0
    assert (result.mask[100:140, 120:200] == 2).all()


def test_gloom_darkens_with_depth_and_haze_with_distance(atlas: Atlas) -> None:
    place = stage()
    with place.gloom(1.0):
        place.quad((-0.5, 1.0, -1.0), (1, 0, 0), (0, 1, 0), WHITE)
    assert seen(place, atlas).linear[119, 159].mean() == pytest.approx(np.exp(-1), abs=0.01)
    hazy = seen(place, atlas, haze=0.2).linear
    assert hazy[119, 159].mean() < 0.3
    assert hazy[5, 5].mean() > 0.01


def test_round_things_are_lit_smoothly(atlas: Atlas) -> None:
    place = stage()
    place.cylinder((0, 1.0, 0), 0.4, 1.0, WHITE, WHITE, sides=10)
    lamp = Lighting(np.array([[-6.0, 1.5, 3.0]]), np.array([40.0]), 0.05, 0.0, 0.0)
    row = painted(place.faces(), atlas, lamp, ahead(), SIZE, 0).linear[119, :, 0]
    lit = row[row > 0.01]
    assert lit[2:8].mean() > 2 * lit[-8:-2].mean()
    assert np.abs(np.diff(lit[1:-1])).max() < 0.15 * lit.max()


def test_developed_pictures_keep_to_their_exposure() -> None:
    linear = np.full((480, 640, 3), 5.0, np.float32)
    dim, bright = (developed(linear, np.random.default_rng(4), key).mean() for key in (0.05, 0.4))
    assert dim + 40 < bright
    again = developed(linear, np.random.default_rng(4), 0.4)
    assert np.array_equal(again, developed(linear, np.random.default_rng(4), 0.4))


def test_a_series_goes_on_where_it_was(tmp_path: Path) -> None:
    made = []

    def make(index: int) -> Sample:
        made.append(index)
        return np.full((8, 8, 3), index, np.uint8), np.full((8, 8), index % 2, np.uint8)

    write_series(tmp_path, ("thing",), "test", ["a-0", "a-1"], make)
    write_series(tmp_path, ("thing",), "test", ["a-0", "a-1", "a-2"], make)
    assert made == [0, 1, 2]
    assert json.loads((tmp_path / "dataset.json").read_text())["classes"] == ["thing"]
    assert len(list((tmp_path / "masks").iterdir())) == 3
