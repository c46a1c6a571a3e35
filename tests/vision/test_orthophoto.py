"""Orthophotos: what stands on the face comes back at its place, sharp and evenly bright; strips are few and straight ahead."""

from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from savmap.geometry import sphere
from savmap.pipeline import cutting
from savmap.pipeline.cutting import FaceStrips
from savmap.pipeline.view_plans import PassPlan
from savmap.types import Floats, Orthophoto, Panorama, PlanePatch, RowStrips, Strip, Trajectory, ViewPlan, ViewSpec
from savmap.video.reader import Clip, VideoInfo
from savmap.vision.orthophoto import orthophoto
from savmap.vision.views import Renderer

HEIGHT, AWAY, COUNT = 512, 1.2, 9
FACE = PlanePatch("face", np.array([-0.5, 0.0, 0.0]), np.eye(3)[0], np.eye(3)[1], np.array([3.0, 2.0]), 0.02)
MARKS = np.array([[-0.2, 0.3], [0.7, 1.0], [1.45, 1.7], [2.2, 0.55]])
"""x, y m of white squares of 12 cm on the grey face."""
AIMED = ViewSpec("face", 0.0, hfov_deg=120.0, width=96, height=96)
PLAN = PassPlan("pass 1", Clip(Path("drive.mp4")), {"one": ViewPlan((AIMED,)), "two": ViewPlan(())})


def pose(x: float) -> Floats:
    """A rig that stands before the face, turned a little away from it."""
    turn = cv2.Rodrigues(np.array([0.0, 0.05, 0.0]))[0]
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.diag([1.0, -1.0, -1.0]) @ turn, [x, 1.0, AWAY]
    return matrix


PATH = Trajectory(np.arange(COUNT), np.array([pose(x) for x in np.linspace(-0.4, 2.4, COUNT)]))


def panorama(frame: int, exposure: float = 1.0, marks: Floats = MARKS, depth: float = 0.0) -> Panorama:
    """What the camera sees from a place of the path: the marks, so far before the face, on grey."""
    columns, rows = np.meshgrid(np.arange(2 * HEIGHT), np.arange(HEIGHT))
    rays = sphere.rays_from_panorama_pixels(np.stack([columns, rows], axis=-1).astype(float), HEIGHT)
    world = rays @ PATH.world_from_rig[frame, :3, :3].T
    place = PATH.world_from_rig[frame, :3, 3]
    with np.errstate(divide="ignore"):
        reach = np.where(world[..., 2] < 0, (depth - place[2]) / world[..., 2], np.inf)
        at = place[:2] + np.where(np.isfinite(reach), reach, 1e6)[..., None] * world[..., :2]
    near = [np.abs(at - mark).max(axis=-1) < 0.06 for mark in marks]
    grey = np.where(np.logical_or.reduce(near), 180, 60) * exposure
    return Panorama(frame, frame / 15, np.repeat(np.round(grey).astype(np.uint8)[..., None], 3, axis=2))


@pytest.fixture(autouse=True)
def no_footage(monkeypatch: pytest.MonkeyPatch) -> None:
    info = VideoInfo(Path("drive.mp4"), 2 * HEIGHT, HEIGHT, "h264", "yuv420p", 15.0, COUNT / 15)
    monkeypatch.setattr(cutting, "probe_clip", lambda clip: info)


def cut(**shown: Any) -> RowStrips:
    """The strips of a drive along the face; `exposures` by frame, and what `panorama` takes."""
    exposures = shown.pop("exposures", {})
    cutter = FaceStrips(Renderer())
    cutter.begin(PLAN, "one")
    cuts = [cutter.cut(panorama(frame, exposures.get(frame, 1.0), **shown)) for frame in range(COUNT)]
    return RowStrips(cutter.views, tuple(cut for cut in chain(*cuts) if isinstance(cut, Strip)))


def picture(photo: Orthophoto | None) -> Floats:
    """Grey values (height, width) of an orthophoto."""
    assert photo is not None
    image = np.asarray(cv2.imdecode(photo.picture, cv2.IMREAD_GRAYSCALE), np.float64)
    assert image.shape == (photo.height, photo.width)
    return image


def found(photo: Orthophoto | None) -> Floats:
    """x, y m of what is white on an orthophoto, from left to right."""
    assert photo is not None
    white = (picture(photo) > 120).astype(np.uint8)
    _, _, stats, middles = cv2.connectedComponentsWithStats(white)
    middles = middles[1:][stats[1:, cv2.CC_STAT_AREA] > 50]
    along = np.column_stack([middles, np.ones(len(middles))]) @ photo.face_from_pixel.T
    places = photo.origin[:2] + along[:, :2]
    return np.asarray(places[np.argsort(places[:, 0])])


@pytest.mark.slow
def test_marks_come_back_where_they_are() -> None:
    photo = orthophoto(FACE, cut(), PATH)
    assert photo is not None
    assert photo.pixel_m == pytest.approx(AWAY * np.pi / HEIGHT, abs=5e-4)
    assert found(photo) == pytest.approx(MARKS, abs=photo.pixel_m)
    corners = np.column_stack([MARKS, np.zeros(4)])
    columns, rows = np.round(photo.on_picture(corners)).astype(int).T
    assert (picture(photo)[rows, columns] > 150).all()


def test_what_stands_before_the_face_is_sharp() -> None:
    """Averaged over all frames, a mark 15 cm before the face would be smeared over 20 cm."""
    photo = orthophoto(FACE, cut(marks=np.array([[0.62, 1.0]]), depth=0.15), PATH)
    assert photo is not None
    white = picture(photo) > 150
    sizes = [photo.pixel_m * np.ptp(places) for places in np.nonzero(white)]
    assert sizes == pytest.approx([0.137, 0.137], abs=0.035)


@pytest.mark.slow
def test_dark_frames_are_as_bright_as_their_neighbours() -> None:
    strips = cut(exposures={3: 0.7, 4: 0.75})
    rows = picture(orthophoto(FACE, strips, PATH))
    ground = rows[rows < 120]
    assert np.percentile(ground, 98) - np.percentile(ground, 2) < 4


def test_part_that_no_frame_shows_is_left_out() -> None:
    far = PlanePatch("face", FACE.origin, FACE.right, FACE.up, np.array([30.0, 2.0]), 0.02)
    photo = orthophoto(far, cut(), PATH)
    assert photo is not None
    assert photo.width * photo.pixel_m < 4.0
    assert found(photo) == pytest.approx(MARKS, abs=2 * photo.pixel_m)


def test_long_face_has_wider_pixels() -> None:
    wide = Trajectory(PATH.frames, PATH.world_from_rig)
    far = PlanePatch("face", FACE.origin, FACE.right, FACE.up, np.array([160.0, 2.0]), 0.02)
    photo = orthophoto(far, cut(), wide)
    assert photo is not None
    assert photo.pixel_m == pytest.approx(0.02)


def test_nothing_is_made_of_frames_without_a_pose() -> None:
    elsewhere = Trajectory(PATH.frames + 100, PATH.world_from_rig)
    assert orthophoto(FACE, cut(), elsewhere) is None
    assert orthophoto(FACE, RowStrips(), PATH) is None


def test_nothing_is_made_of_a_face_out_of_sight() -> None:
    behind = PlanePatch("face", np.array([50.0, 0, 0]), FACE.right, FACE.up, FACE.size, 0.02)
    assert orthophoto(behind, cut(), PATH) is None
