"""What is cut from frames: narrow strips of the face, small panoramas for the viewer, and views of the floor; no more of
them than are needed."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from savmap.pipeline import cutting
from savmap.pipeline.cutting import FaceStrips, FloorCutter, Stills, reduced, spaced_stills, strip_views
from savmap.pipeline.view_plans import PassPlan
from savmap.types import FilmedPanorama, Panorama, Planes, Still, Trajectory, ViewPlan, ViewSpec
from savmap.video.reader import Clip, VideoInfo
from savmap.vision.evidence import PackedView
from savmap.vision.views import Renderer

HEIGHT = 100
LEVEL = np.diag([1.0, -1.0, -1.0])
FACE = ViewSpec("face", 0.0, hfov_deg=120.0, width=96, height=96)
BT601 = np.array([[1, 0, 1.402, -179.456], [1, -0.344, -0.714, 135.459], [1, 1.772, 0, -226.816]])


def plan_of(every: int = 1, found: bool = True) -> PassPlan:
    """A pass in which a plugin looks at the face every so many frames, and another one at nothing."""
    face = ViewPlan((replace(FACE, every=every),), world_from_rig=LEVEL if found else None)
    return PassPlan("pass 1", Clip(Path("drive.mp4"), fps=10), {"one": face, "two": ViewPlan(())})


@pytest.fixture(autouse=True)
def no_footage(monkeypatch: pytest.MonkeyPatch) -> None:
    info = VideoInfo(Path("drive.mp4"), 2 * HEIGHT, HEIGHT, "h264", "yuv420p", 30.0, 10.0)
    monkeypatch.setattr(cutting, "probe_clip", lambda clip: info)


def panorama(frame: int) -> Panorama:
    """Dark above the horizon, bright below it."""
    image = np.full((HEIGHT, 2 * HEIGHT, 3), (10, 90, 200), np.uint8)
    image[HEIGHT // 2 :] = 200
    return Panorama(frame, frame / 10, image)


def stills(count: int) -> list[Still]:
    cutter = Stills()
    cutter.begin(plan_of(), None)
    return [cut for frame in range(count) for cut in cutter.cut(panorama(frame)) if isinstance(cut, Still)]


def test_stills_are_kept_of_every_other_frame() -> None:
    kept = stills(9)
    assert [still.frame for still in kept] == [0, 2, 4, 6, 8]
    image = cv2.imdecode(kept[0].picture, cv2.IMREAD_COLOR)
    assert image.shape == (100, 200, 3)
    assert np.abs(image[:40, :, ::-1].astype(int) - (10, 90, 200)).max() < 4


def test_stills_are_made_smaller_and_keep_their_colours() -> None:
    assert reduced(panorama(0), 40).shape == (40, 80, 3)
    assert reduced(panorama(0), 400).shape == (100, 200, 3)
    planes = Planes(np.full((100, 200), 90, np.uint8), *(np.full((50, 100), c, np.uint8) for c in (180, 80)), BT601)
    filmed = FilmedPanorama(0, 0.0, planes)
    assert np.abs(reduced(filmed, 40).astype(int) - planes.rgb[:40, :80]).max() <= 1


def test_stills_keep_their_distance_on_the_path() -> None:
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 0, 3] = [0.0, 0.5, 0.9, 1.0, 2.0]
    several = [Still(frame, np.zeros(1, np.uint8)) for frame in (0, 1, 2, 3, 4, 9)]
    assert [still.frame for still in spaced_stills(several, Trajectory(np.arange(5), poses))] == [0, 2, 4]


def test_strips_are_narrow_and_as_fine_as_the_panorama() -> None:
    (spec,) = strip_views(plan_of(), "one")
    assert spec.hfov_deg == pytest.approx(cutting.STRIP_HFOV_DEG, abs=2.0)
    assert spec.camera[0, 0] == pytest.approx(HEIGHT / np.pi, rel=0.01)
    assert spec.height == pytest.approx(2 * HEIGHT / np.pi * np.tan(np.radians(60)), abs=1)
    assert not list(strip_views(plan_of(), "two"))
    (seldom,) = strip_views(plan_of(5), "one")
    assert (spec.every, seldom.every) == (1, 5)


@pytest.mark.parametrize(("every", "kept"), [(1, [*range(11)]), (4, [0, 4, 8])])
def test_the_floor_is_kept_of_frames_in_which_the_face_is_looked_at(every: int, kept: list[int]) -> None:
    cutter = FloorCutter(Renderer())
    cutter.begin(plan_of(every), "one")
    cuts = [cut for frame in range(11) for cut in cutter.cut(panorama(frame))]
    (spec,) = cutter.views.values()
    right, _, forward = (LEVEL @ spec.rig_from_view).T
    assert right == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)
    assert forward == pytest.approx([0.0, -np.sin(np.radians(50)), -np.cos(np.radians(50))], abs=1e-9)
    assert [cut.frame for cut in cuts] == kept
    assert isinstance(cuts[0], PackedView)
    assert np.median(cuts[0].grey()) == pytest.approx(200, abs=3)


@pytest.mark.parametrize("cutter", [FaceStrips(Renderer()), FloorCutter(Renderer())])
def test_nothing_is_cut_where_no_face_was_found(cutter: FaceStrips | FloorCutter) -> None:
    cutter.begin(plan_of(found=False), None)
    assert cutter.cut(panorama(0)) == []
    assert not cutter.views


def test_no_floor_is_cut_where_no_attitude_is_given() -> None:
    cutter = FloorCutter(Renderer())
    cutter.begin(plan_of(found=False), "one")
    assert cutter.cut(panorama(0)) == []
