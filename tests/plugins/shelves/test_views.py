"""The face's view: widened where it would show one upright at a time, two views where one cannot hold the height."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.geometry import pinhole
from savmap.types import Detection, Panorama, View, ViewPlan, ViewSpec
from savmap.vision.view_planning import Face, Manual, PassPreview, Side
from savmap.vision.views import Renderer
from savmap_shelves import views
from savmap_shelves.plugin import Shelves
from savmap_shelves.settings import ShelvesSettings
from savmap_shelves.views import cached, face_likeness, halves, uprights_in, which_hand, widened

SPEC = ViewSpec("face", 10.0, 5.0, 0.0, 70.0)


@pytest.fixture
def pass_preview() -> PassPreview:
    keys = tuple(Panorama(k, k / 10, np.zeros((32, 64, 3), dtype=np.uint8)) for k in range(5))
    return PassPreview(keys, (), Renderer(), np.eye(3))


@pytest.mark.parametrize(("given", "every"), [({}, 1), ({"every": 3}, 3)])
def test_the_face_is_looked_at_as_often_as_is_set(
    pass_preview: PassPreview, monkeypatch: pytest.MonkeyPatch, given: dict[str, int], every: int
) -> None:
    monkeypatch.setattr(views, "aim_at_face", lambda *_: ViewPlan((SPEC, replace(SPEC, name="face low")), np.eye(3)))
    plan = Shelves(ShelvesSettings(**given)).render_views(pass_preview, lambda view: [], None, {})
    assert [(spec.name, spec.every) for spec in plan.views] == [("face", every), ("face low", every)]


def two_from(hfov_deg: float, view: View) -> int:
    return 2 if view.spec.hfov_deg >= hfov_deg else 1


def test_a_view_that_was_looked_at_lately_is_not_looked_at_again(pass_preview: PassPreview) -> None:
    looked = []

    def see(view: View) -> list[Detection]:
        looked.append(view.spec.hfov_deg)
        return []

    seen = cached(see)
    for hfov in (70.0, 80.0, 70.0, 90.0, 100.0, 110.0, 70.0):
        for view in pass_preview.views(replace(SPEC, hfov_deg=hfov)):
            assert seen(view) == []
    assert looked == [hfov for hfov in (70, 80, 90, 100, 110, 70) for _ in pass_preview.keys]


def test_a_view_that_shows_one_upright_at_a_time_is_widened(pass_preview: PassPreview) -> None:
    fitted = widened(pass_preview, SPEC, lambda view: two_from(100.0, view), Manual())
    assert fitted.warning is None
    assert 100.0 <= fitted.spec.hfov_deg <= 106.0
    assert (fitted.spec.yaw_deg, fitted.spec.pitch_deg) == (SPEC.yaw_deg, SPEC.pitch_deg)


def test_a_view_that_mostly_shows_two_stays(pass_preview: PassPreview) -> None:
    assert widened(pass_preview, SPEC, lambda view: 1 + (view.frame != 2), Manual()).spec == SPEC


def test_a_field_of_view_given_by_hand_stays(pass_preview: PassPreview) -> None:
    assert widened(pass_preview, SPEC, lambda view: 0, Manual(hfov_deg=70.0)).spec == SPEC


def test_no_view_is_wide_enough(pass_preview: PassPreview) -> None:
    def in_few_pictures(view: View) -> int:
        return 2 if view.frame == pass_preview.keys[0].frame else 1

    assert "fewer than 2" in (widened(pass_preview, SPEC, in_few_pictures, Manual()).warning or "")


def test_a_pass_that_never_shows_two_uprights_is_looked_at_as_it_is(pass_preview: PassPreview) -> None:
    fitted = widened(pass_preview, SPEC, lambda view: 1, Manual())
    assert fitted.spec == SPEC
    assert "none of 5 pictures, evenly spaced, shows two uprights" in (fitted.warning or "")


def test_a_pass_that_shows_no_rack_at_all_is_refused(
    pass_preview: PassPreview, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(views, "choose_face", lambda *_: Face(SPEC, 1, 1.0))
    with pytest.raises(StructureError, match="none of 5 pictures, evenly spaced over the pass, shows an upright or a"):
        views.aim_at_face(pass_preview, lambda view: [], None, {})


def test_two_views_reach_from_80_below_to_80_above_and_neither_sees_the_zenith_or_nadir() -> None:
    face = Face(ViewSpec("face", *pinhole.angles_from_rotation(pinhole.rig_from_view(30, 10, 5)), 100.0), 1, 1.0)
    reach = []
    for spec in halves(face):
        columns = np.array([[319.5, -0.5], [319.5, 479.5]])
        rays = spec.rig_rays(columns) @ (face.world_from_rig.T)
        reach += np.degrees(np.arcsin(rays[:, 1])).tolist()
        up = spec.rig_from_view.T @ face.world_from_rig.T @ np.array([0.0, 1.0, 0.0])
        for pole in (up, -up):
            pixel = pinhole.project(pole, spec.camera)
            assert pole[2] <= 0 or not 0 <= pixel[1] < spec.height
    assert np.isclose(max(reach), 80.0, atol=1.0)
    assert np.isclose(min(reach), -80.0, atol=1.0)


def masks(label: str, *boxes: tuple[int, int, int, int]) -> list[Detection]:
    """Of boxes: first and last row, first and last column."""
    detections = []
    for top, bottom, left, right in boxes:
        mask = np.zeros((SPEC.height, SPEC.width), np.bool_)
        mask[top:bottom, left:right] = True
        detections.append(Detection(label, 0.9, mask, mask.astype(np.float32)))
    return detections


def test_uprights_are_tall_and_plumb() -> None:
    tall, short, fallen = (10, 450, 100, 110), (10, 120, 300, 310), (200, 215, 400, 600)
    assert uprights_in(masks("upright", tall, short, fallen), SPEC) == [440.0]
    assert uprights_in(masks("beam", tall), SPEC) == []


def test_level_beams_and_plumb_uprights_make_a_face() -> None:
    seen = [*masks("upright", (0, 480, 100, 110)), *masks("beam", (50, 60, 0, 320), (100, 110, 0, 15))]
    assert face_likeness(seen, SPEC) == pytest.approx(2 * (1.0 + 0.5))
    askew = np.eye(480, 640, dtype=np.bool_)
    assert face_likeness([Detection("beam", 0.9, askew, askew.astype(np.float32))], SPEC) == 0.0


@pytest.mark.parametrize(("travel", "hand", "other"), [(1, "left", "right"), (-1, "right", "left")])
def test_which_of_two_racks_is_mapped_is_told(travel: int, hand: str, other: str) -> None:
    (note,) = which_hand(Face(SPEC, travel, 1.0, 0.8), None)
    assert f"on the {hand} of the way is mapped" in note
    assert f"--side {other}" in note


@pytest.mark.parametrize(
    ("face", "side"),
    [(Face(SPEC, 1, 1.0, 0.8), "left"), (Face(SPEC, 1, 1.0, 0.1), None), (Face(SPEC, 0, 1.0, 0.8), None)],
)
def test_a_single_rack_or_one_that_is_asked_for_needs_no_note(face: Face, side: Side | None) -> None:
    assert which_hand(face, side) == ()
