"""Choosing views in a made-up hall, with the camera turned any way."""

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.errors import StructureError
from savmap.geometry import pinhole
from savmap.geometry.cameras import Camera, Equirectangular, Fisheye, Pinhole
from savmap.jobs.preview import overview
from savmap.types import Panorama, View, ViewSpec
from savmap.vision.view_planning import (
    LARGEST_HFOV_DEG,
    Manual,
    PassPreview,
    ceiling_view,
    choose_face,
    face_at,
    face_candidates,
    fit_count,
    fit_height,
    floor_view,
    travel_directions,
    whole_view,
)

from .hall import EYE_DISTANCE, EYE_HEIGHT, TOP, hall, red

LEVEL = np.diag([1.0, -1.0, -1.0])
TURNS = [(0.0, 0.0, 0.0), (130.0, 12.0, -8.0), (-75.0, -25.0, 20.0), (20.0, 40.0, 5.0)]


def turned(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """rig_from_world of a rig that faced the grid before it was turned."""
    return pinhole.rig_from_view(yaw, pitch, roll).T @ LEVEL


@lru_cache
def pass_preview(yaw: float, pitch: float, roll: float, step: float = 0.07) -> PassPreview:
    """A pass from x = 2 to x = 10 (or back, for a negative step)."""
    places = np.linspace(2, 10, 4)[:: 1 if step > 0 else -1]
    rig = turned(yaw, pitch, roll)
    keys = [hall(x, rig, i) for i, x in enumerate(places)]
    pairs = [(keys[i], hall(places[i] + step, rig, i)) for i in (1, 3)]
    return PassPreview.of_frames(keys, pairs)


def redness(spec: ViewSpec, panorama: Panorama) -> float:
    return float(red(pass_preview(*TURNS[0]).renderer.render(panorama, spec).image).mean())


def extent(view: View) -> tuple[float, float] | None:
    rows = np.flatnonzero(red(view.image).sum(axis=1) > 5)
    return (float(rows[0]), float(rows[-1])) if len(rows) else None


def lamps(view: View) -> int:
    whole = (view.image.min(axis=-1) > 200).astype(np.uint8)
    return int(cv2.connectedComponentsWithStats(whole)[0]) - 1


def degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(Rotation.from_matrix(a.T @ b).magnitude()))


@pytest.mark.slow
@pytest.mark.parametrize("turn", TURNS, ids=str)
def test_face_is_found_whichever_way_the_camera_is_turned(turn: tuple[float, float, float]) -> None:
    face = choose_face(pass_preview(*turn), redness)
    assert degrees_between(face.rig_from_world, turned(*turn)) < 0.5
    assert np.allclose(face.world_from_rig, face.rig_from_world.T)
    assert face.travel == 1


@pytest.mark.slow
@pytest.mark.parametrize(("step", "travel", "side"), [(0.07, 1, "left"), (-0.07, -1, "right")])
def test_side_is_left_when_moving_towards_plus_x(step: float, travel: int, side: str) -> None:
    pass_ = pass_preview(*TURNS[0], step)
    assert choose_face(pass_, redness).travel == travel
    assert degrees_between(choose_face(pass_, redness, side).rig_from_world, LEVEL) < 0.5
    other = choose_face(pass_, lambda spec, panorama: 1.0, "right" if side == "left" else "left")
    assert degrees_between(other.rig_from_world, turned(180, 0, 0)) < 0.5
    assert other.travel == -travel


def test_the_other_hands_face_is_scored_too() -> None:
    pass_ = pass_preview(*TURNS[0])
    both = choose_face(pass_, lambda spec, panorama: 1.0)
    assert (both.score, both.across_score) == (1.0, 1.0)
    assert choose_face(pass_, lambda spec, panorama: 1.0, "left").across_score == 0.0
    assert choose_face(pass_, redness).across_score < 0.1 * choose_face(pass_, redness).score


@pytest.mark.parametrize("drift", [0.0, 9.0])
def test_axes_are_found_where_the_heading_drifts(drift: float) -> None:
    """A stabiliser's heading, or a cart that is not pushed straight: each key frame is turned by so much more than the last."""
    keys = [hall(2 + 2 * i, turned(20 + drift * (i - 2), 12, -8), i) for i in range(5)]
    axes = PassPreview.of_frames(keys).rig_from_manhattan
    assert degrees_between(axes, turned(20, 12, -8)) < 1.0


def test_only_directions_that_may_be_the_face_are_looked_at() -> None:
    looked = []

    def score(spec: ViewSpec, panorama: Panorama) -> float:
        looked.append(spec.yaw_deg)
        return 1.0

    face = choose_face(pass_preview(*TURNS[0]), score, "left")
    assert set(looked) == {face.spec.yaw_deg}


def test_direction_of_travel_past_a_face_with_nothing_behind() -> None:
    """Half of the sphere is bare: no corner to follow across the aisle."""
    whole = pass_preview(*TURNS[0])
    half = whole.keys[0].image.shape[1] // 2
    columns = (np.arange(2 * half) + half // 2) % (2 * half) < half

    def bare(panorama: Panorama) -> Panorama:
        return replace(panorama, image=np.where(columns[None, :, None], 90, panorama.image).astype(np.uint8))

    pairs = [(bare(first), bare(second)) for first, second in whole.pairs]
    assert travel_directions(pairs, face_candidates(LEVEL)[0], whole.renderer) == (1, 0, -1, 0)


def test_a_standing_camera_has_no_direction_of_travel() -> None:
    still = pass_preview(*TURNS[0])
    still = PassPreview(
        still.keys, tuple((key, key) for key in still.keys[:2]), still.renderer, still.rig_from_manhattan
    )
    face = choose_face(still, redness, "left")
    assert face.travel == 0
    assert degrees_between(face.rig_from_world, LEVEL) < 0.5


def test_candidates_are_level_and_turn_to_the_right() -> None:
    views = face_candidates(LEVEL)
    assert [round(view.yaw_deg) % 360 for view in views] == [0, 90, 180, 270]
    assert all(abs(view.pitch_deg) < 1e-6 and abs(view.roll_deg) < 1e-6 for view in views)
    assert len(face_candidates(turned(0, 50, 0))) == 8


@pytest.mark.parametrize("turn", TURNS[:3], ids=str)
def test_whole_height_at_the_smallest_field_of_view(turn: tuple[float, float, float]) -> None:
    pass_ = pass_preview(*turn)
    fitted = fit_height(pass_, choose_face(pass_, redness), extent, margin=0.05)
    assert fitted.warning is None
    for view in pass_.views(fitted.spec):
        rows = extent(view)
        assert rows is not None
        assert rows[0] > 10
        assert rows[1] < 469
    up, down = np.arctan2(TOP - EYE_HEIGHT, EYE_DISTANCE), np.arctan2(EYE_HEIGHT, EYE_DISTANCE)
    least = 2 * np.degrees(np.arctan(np.tan((up + down) / 2) * 4 / 3))
    assert least < fitted.spec.hfov_deg < least + 8
    pitch = pinhole.angles_from_rotation(LEVEL @ turned(*turn).T @ fitted.spec.rig_from_view)[1]
    assert pitch == pytest.approx(np.degrees(up - down) / 2, abs=2)


def test_manual_values_win() -> None:
    pass_ = pass_preview(*TURNS[0])
    face = choose_face(pass_, redness)
    level = fit_height(pass_, face, extent, Manual(pitch_deg=0.0, width=800, height=800), "level")
    assert (level.spec.pitch_deg, level.spec.width, level.spec.height, level.spec.name) == (0, 800, 800, "level")
    assert all(extent(view)[1] < 797 for view in pass_.views(level.spec))
    assert fit_height(pass_, face, extent, Manual(hfov_deg=150)).spec.hfov_deg == 150
    whole = Manual(1, 2, 3, 4)
    assert fit_height(pass_, face, lambda view: None, whole).spec == ViewSpec("face", 1, 2, 3, 4)
    assert fit_count(pass_, ceiling_view(face), lamps, manual=Manual(hfov_deg=88)).spec.hfov_deg == 88


def test_a_height_that_fits_nowhere() -> None:
    pass_ = pass_preview(*TURNS[0])
    fitted = fit_height(pass_, choose_face(pass_, redness), lambda view: (0.0, view.spec.height - 1.0))
    assert fitted.spec.hfov_deg == LARGEST_HFOV_DEG
    assert "whole height" in (fitted.warning or "")


def test_a_structure_that_is_never_seen() -> None:
    pass_ = pass_preview(*TURNS[0])
    with pytest.raises(StructureError, match="on the left"):
        choose_face(pass_, lambda spec, panorama: 0.0, "left")
    for manual in (Manual(), Manual(hfov_deg=100)):
        with pytest.raises(StructureError, match="no structure is seen in"):
            fit_height(pass_, choose_face(pass_, redness), lambda view: None, manual)
    with pytest.raises(StructureError, match="no building directions"):
        PassPreview.of_frames([Panorama(0, 0.0, np.full((256, 512, 3), 90, np.uint8))])


@pytest.mark.parametrize("turn", TURNS[:2], ids=str)
def test_ceiling_shows_two_lamps_at_the_smallest_field_of_view(turn: tuple[float, float, float]) -> None:
    pass_ = pass_preview(*turn)
    ceiling = ceiling_view(choose_face(pass_, redness))
    assert (
        degrees_between(turned(*turn).T @ ceiling.rig_from_view, np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])) < 0.5
    )
    two, three = (fit_count(pass_, ceiling, lamps, at_least=n) for n in (2, 3))
    assert two.warning is None
    assert all(lamps(view) >= 2 for view in pass_.views(two.spec))
    assert 60 <= two.spec.hfov_deg < three.spec.hfov_deg
    assert "fewer than 99" in (fit_count(pass_, ceiling, lamps, at_least=99).warning or "")


@pytest.mark.parametrize("turn", TURNS[:2], ids=str)
def test_floor_view_looks_straight_down_with_the_face_above(turn: tuple[float, float, float]) -> None:
    world_from_rig = LEVEL @ turned(*turn).T
    face = face_at(world_from_rig)
    assert degrees_between(face.world_from_rig, world_from_rig) < 1e-5
    down, up = (world_from_rig @ view(face).rig_from_view for view in (floor_view, ceiling_view))
    np.testing.assert_allclose(down, np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), atol=1e-9)
    np.testing.assert_allclose(up @ np.diag([1.0, -1.0, -1.0]), down, atol=1e-9)
    assert (floor_view(face).name, floor_view(face, 90.0, "ground").hfov_deg) == ("floor", 90.0)


def as_seen_by(camera: Camera, panorama: Panorama) -> Panorama:
    """What a camera sees of a panorama, which is black elsewhere."""
    y, x = np.mgrid[0 : panorama.height, 0 : 2 * panorama.height]
    rays = Equirectangular(panorama.height).rays(np.stack([x, y], axis=-1).astype(float))
    seen = np.isfinite(camera.pixels(rays)[..., 0])
    return replace(panorama, image=panorama.image * seen[..., None], seen=(255 * seen).astype(np.uint8))


def test_an_ordinary_lens_is_looked_through_as_it_is() -> None:
    whole = Panorama(0, 0.0, np.zeros((1024, 2048, 3), np.uint8))
    narrow = whole_view(as_seen_by(Pinhole.of_hfov(1138, 640, 75.0), whole))
    assert narrow is not None
    assert (narrow.yaw_deg, narrow.pitch_deg, narrow.roll_deg) == (0.0, 0.0, 0.0)
    assert narrow.hfov_deg == pytest.approx(74.0, abs=0.3)
    assert (narrow.width, narrow.height) == (640, 360)
    assert whole_view(whole) is None
    assert whole_view(as_seen_by(Fisheye.of_hfov(512, 512, 180.0), whole)) is None


def test_a_face_is_found_in_what_a_narrow_camera_sees() -> None:
    """The border of what it sees is no edge of the building's, and which way it goes shows there alone. Its few edges
    tell the direction roughly; those of the structure will tell it."""
    whole, camera = pass_preview(8.0, 5.0, 3.0), Pinhole.of_hfov(640, 480, 90.0)
    keys = [as_seen_by(camera, panorama) for panorama in whole.keys]
    pairs = [(as_seen_by(camera, a), as_seen_by(camera, b)) for a, b in whole.pairs]
    preview = PassPreview.of_frames(keys, pairs)
    face, true = (choose_face(one, redness) for one in (preview, whole))
    assert degrees_between(face.spec.rig_from_view, true.spec.rig_from_view) < 15.0
    assert face.travel == true.travel == 1
    with pytest.raises(StructureError, match="on the right"):
        choose_face(preview, redness, "right")


def test_overview_has_a_tile_a_view_and_frame() -> None:
    pass_ = pass_preview(*TURNS[0])
    picture = overview(pass_.keys, face_candidates(LEVEL)[:2], pass_.renderer, columns=3)
    assert picture.shape == (2 * 360, 3 * 480, 3)
