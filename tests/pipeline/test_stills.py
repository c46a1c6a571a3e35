"""Stills: panoramas kept for the viewer, smaller, and no more of them than the camera's path needs."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from savmap.pipeline import cutting
from savmap.pipeline.cutting import Stills, reduced, spaced_stills
from savmap.pipeline.view_plans import PassPlan
from savmap.types import FilmedPanorama, Panorama, Planes, Still, Trajectory, ViewPlan
from savmap.video.reader import Clip, VideoInfo

PLAN = PassPlan("pass 1", Clip(Path("drive.mp4"), fps=10), {"one": ViewPlan(())})
BT601 = np.array([[1, 0, 1.402, -179.456], [1, -0.344, -0.714, 135.459], [1, 1.772, 0, -226.816]])


@pytest.fixture(autouse=True)
def no_footage(monkeypatch: pytest.MonkeyPatch) -> None:
    info = VideoInfo(Path("drive.mp4"), 200, 100, "h264", "yuv420p", 30.0, 10.0)
    monkeypatch.setattr(cutting, "probe", lambda path, fps: info)
    monkeypatch.setattr(cutting, "expected_frames", lambda clip, info: 100)


def panorama(frame: int, height: int = 100) -> Panorama:
    return Panorama(frame, frame / 10, np.full((height, 2 * height, 3), (10, 90, 200), np.uint8))


def kept(count: int) -> tuple[Still, ...]:
    cutter = Stills()
    cutter.begin(PLAN, None)
    return tuple(cut for frame in range(count) for cut in cutter.cut(panorama(frame)) if isinstance(cut, Still))


def test_stills_are_kept_now_and_then() -> None:
    assert [still.frame for still in kept(30)] == [0, 7, 14, 21, 28]
    image = cv2.imdecode(kept(1)[0].picture, cv2.IMREAD_COLOR)
    assert image.shape == (100, 200, 3)
    assert np.abs(image[..., ::-1].astype(int) - (10, 90, 200)).max() < 4


def test_a_long_pass_keeps_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cutting, "expected_frames", lambda clip, info: 8000)
    assert [still.frame for still in kept(250)] == [0, 100, 200]


def test_stills_are_made_smaller(monkeypatch: pytest.MonkeyPatch) -> None:
    assert reduced(panorama(0), 40).shape == (40, 80, 3)
    assert reduced(panorama(0), 400).shape == (100, 200, 3)


def test_filmed_panoramas_keep_their_colours() -> None:
    planes = Planes(np.full((100, 200), 90, np.uint8), *(np.full((50, 100), c, np.uint8) for c in (180, 80)), BT601)
    filmed = FilmedPanorama(0, 0.0, planes)
    assert np.abs(reduced(filmed, 40).astype(int) - planes.rgb[:40, :80]).max() <= 1


def test_stills_stand_apart_on_the_path() -> None:
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 0, 3] = [0.0, 0.5, 0.9, 1.0, 2.0]
    stills = [Still(frame, np.zeros(1, np.uint8)) for frame in (0, 1, 2, 3, 4, 9)]
    assert [still.frame for still in spaced_stills(stills, Trajectory(np.arange(5), poses))] == [0, 2, 4]
