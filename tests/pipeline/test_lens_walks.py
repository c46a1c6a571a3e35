"""The walk of an ordinary lens along a face: its path, its focal length, and how a drive goes by it."""

from pathlib import Path

import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.geometry.cameras import Pinhole
from savmap.pipeline import lens_walks
from savmap.pipeline.lens_walks import LensPoints, LensWalk, LensWay, lens_walk, with_lens
from savmap.site.model import Pass
from savmap.site.sections import CameraSection
from savmap.types import Floats, Panorama
from savmap.vision.lens_path import chosen, first_path, parts, turns
from savmap.vision.lens_tracks import WIDTH, LensTracks

from ..vision.made_up_walk import LENS, tracks_of, walked_poses

SECTION = CameraSection(model="pinhole", hfov_deg=LENS.hfov_deg)
FOUND = LensWalk(
    camera=LENS,
    given=LENS,
    focal_sigma=0.01,
    frames=np.array([0, 2, 3, 5]),
    part=np.array([0, 0, 0, 1]),
    world_from_rig=walked_poses(4),
    seen_frame=np.array([0, 0, 2, 3]),
    seen_point=np.array([0, 1, 1, 1]),
    rays=np.tile([0.0, 0.6, 0.8], (4, 1)),
    points=np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
    off_px=0.3,
)


def off_path(poses: Floats, true: Floats) -> float:
    """By how much places are off after a similarity, as a share of the way."""
    a, b = poses[:, :3, 3] - poses[:, :3, 3].mean(axis=0), true[:, :3, 3] - true[:, :3, 3].mean(axis=0)
    left, values, right = np.linalg.svd(b.T @ a)
    scale = values.sum() / (a**2).sum()
    return float(np.sqrt(((b - scale * a @ (left @ right).T) ** 2).sum(axis=1).mean()) / np.ptp(b[:, 0]))


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [1.0, 0.95, 1.05])
def test_the_path_and_the_focal_length_are_found(wrong: float) -> None:
    true = walked_poses(40)
    tracks = tracks_of(true, outliers=0.1)
    focal = wrong * LENS.resolution
    lens = Pinhole(LENS.width, LENS.height, (focal, focal), LENS.centre_px)
    _, path = lens_walks.settled(tracks, lens, 0.05, 0.01)
    assert off_path(path.world_from_rig, true) < 1e-3
    assert path.focal_px == pytest.approx(LENS.resolution, rel=0.01)


def test_lines_tell_how_pictures_are_turned() -> None:
    true = walked_poses(12)
    found = turns(tracks_of(true), LENS)
    assert np.abs(found - true[:, :3, :3]).max() < 2e-3


def test_the_first_path_needs_no_chain() -> None:
    true = walked_poses(40)
    seen = chosen(tracks_of(true), LENS)
    poses, points = first_path(seen, true[:, :3, :3], 1 / LENS.resolution)
    assert off_path(poses, true) < 5e-3
    assert np.median(points[:, 2]) == pytest.approx(-1.0, rel=0.2)


def test_where_too_few_points_lead_on_the_path_breaks() -> None:
    tracks = tracks_of(walked_poses(20))
    keep = (tracks.frame < 12) | (tracks.point >= tracks.point[tracks.frame == 12].max())
    broken = LensTracks(
        tracks.frames, tracks.frame[keep], tracks.point[keep], tracks.pixels[keep], tracks.segments, tracks.size
    )
    part = parts(broken)
    assert part[:12].tolist() == 12 * [0]
    assert part[12:].all()


def test_a_drive_goes_by_the_walk() -> None:
    points, way = LensPoints(FOUND), LensWay(FOUND)
    seen = []
    for frame in range(6):
        followed = points.update(Panorama(frame, float(frame), np.zeros((8, 16, 3), np.uint8)))
        assert len(way.take(followed)) == 0
        seen.append((len(followed.numbers), way.part, len(way.places), way.pose is None))
    assert seen == [(2, 0, 2, False), (0, -1, 0, True), (1, 0, 1, False), (1, 0, 1, False), *2 * [(0, -1, 0, True)]]
    assert way.path.part.tolist() == [0, -1, 0, 0, -1, 1]
    np.testing.assert_allclose(way.path.world_from_rig[2], FOUND.world_from_rig[1])


def test_the_way_along_the_face_and_the_lens_are_told() -> None:
    assert FOUND.travel == 1
    assert FOUND.lens_line == "field of view 75.0 +- 0.7 degrees by the pictures, 75.0 were given"
    assert FOUND.warnings == ()


def test_a_lens_that_is_another_one_is_told() -> None:
    wrong = lens_walks.replace(FOUND, given=Pinhole.of_hfov(LENS.width, LENS.height, 71.0))
    (warning,) = wrong.warnings
    assert warning.code == "bad-panorama"
    assert "75.0 +- 0.7 degrees by the pictures, 71.0 were given" in warning.details[0]


def test_nothing_speaks_against_a_lens_that_was_not_given() -> None:
    unknown = lens_walks.replace(FOUND, given=None)
    assert unknown.warnings == ()
    assert unknown.lens_line == "field of view 75.0 +- 0.7 degrees by the pictures"


def test_a_pass_has_the_lens_that_was_found() -> None:
    walk = lens_walks.replace(FOUND, camera=Pinhole(1000, 500, (700.0, 700.0), (499.5, 249.5), (-0.01,)))
    section = with_lens(Pass(video=Path("a.mp4"), camera=SECTION), walk).camera
    assert section is not None
    camera = section.camera(1000, 500)
    assert isinstance(camera, Pinhole)
    assert camera.focal_px[0] == pytest.approx(700.0)
    assert camera.distortion == (-0.01,)


def test_a_camera_that_stands_still_is_no_walk(monkeypatch: pytest.MonkeyPatch) -> None:
    class Info:
        width, height = 320, 180

    grey = np.random.default_rng(0).integers(0, 255, (180, 320, 3)).astype(np.uint8)
    monkeypatch.setattr(lens_walks, "probe_clip", lambda _: Info)
    monkeypatch.setattr(lens_walks, "pictures", lambda _: ((0.1 * k, grey) for k in range(6)))
    with pytest.raises(StructureError, match="at most 1 pictures in a row lead from one to the next"):
        lens_walk(Pass(video=Path("a.mp4"), camera=SECTION))


def test_other_cameras_have_no_such_walk() -> None:
    assert lens_walk(Pass(video=Path("a.mp4"))) is None
    assert lens_walk(Pass(video=Path("a.mp4"), camera=CameraSection(model="fisheye"))) is None
    assert LENS.width == WIDTH
