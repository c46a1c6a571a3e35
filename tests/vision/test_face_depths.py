"""Depths behind a face: what lies in it and what lies behind it are told apart by how they move from frame to frame."""

import cv2
import numpy as np
import pytest

from savmap.geometry.arrays import Floats
from savmap.types import FaceDepths, PlanePatch, RowStrips, Strip, Trajectory, ViewSpec
from savmap.vision.face_depths import face_depths, seen_from, swept_depths

FACE = PlanePatch("face", np.zeros(3), np.eye(3)[0], np.eye(3)[1], np.array([2.0, 1.2]), 0.02)
AWAY_M, EYE_M, BEHIND_M, SIDE_M = 1.5, 0.6, 0.5, 1.0
SPEC = ViewSpec("strip", 0.0, hfov_deg=50.0, width=140, height=130)
PLACES = np.linspace(-0.2, 2.2, 13)


def pose(x: float) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.diag([1.0, -1.0, -1.0]), [x, EYE_M, AWAY_M]
    return matrix


def picture(x: float, textured: bool) -> Floats:
    """A wall of noise in the face, to the left of `SIDE_M`, and another `BEHIND_M` behind it."""
    columns, rows = np.meshgrid(np.arange(SPEC.width), np.arange(SPEC.height))
    rays = SPEC.rig_rays(np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)) @ pose(x)[:3, :3].T
    noise = cv2.GaussianBlur(np.random.default_rng(2).normal(0, 200, (300, 400)), (0, 0), 2.0)

    def seen(depth: float) -> tuple[Floats, Floats]:
        places = np.array([x, EYE_M]) - rays[:, :2] * (AWAY_M + depth) / rays[:, 2:]
        cells = np.round(places / 0.01).astype(int) + 100
        return noise[cells[:, 1].clip(0, 299), cells[:, 0].clip(0, 399)], places[:, 0]

    (near, at), (far, _) = seen(0.0), seen(BEHIND_M)
    grey = 128 + np.where(at < SIDE_M, near, far) * textured
    return np.clip(grey, 0, 255).reshape(SPEC.height, SPEC.width)


def strips(textured: bool = True) -> RowStrips:
    jpegs = [cv2.imencode(".png", picture(x, textured).astype(np.uint8))[1].ravel() for x in PLACES.tolist()]
    return RowStrips({"strip": SPEC}, tuple(Strip(number, "strip", jpeg) for number, jpeg in enumerate(jpegs)))


PATH = Trajectory(np.arange(len(PLACES)), np.array([pose(x) for x in PLACES.tolist()]))


@pytest.fixture(scope="module")
def depths() -> FaceDepths:
    found = face_depths(FACE, strips(), PATH)
    assert found is not None
    return found


def test_each_side_has_its_depth(depths: FaceDepths) -> None:
    best = depths.depths[depths.scores.argmax(axis=0)]
    columns = (np.arange(best.shape[1]) + 0.5) * depths.cell
    middle = slice(8, -8)
    step = np.diff(depths.depths)[np.searchsorted(depths.depths, BEHIND_M)]
    for side, depth in (
        ((columns < SIDE_M - 0.15) & (columns > 0.15), 0.0),
        ((columns > SIDE_M + 0.15) & (columns < 1.85), BEHIND_M),
    ):
        off = np.abs(best[middle][:, side] - depth)
        assert np.mean(off <= step) > 0.95
        assert depths.scores.max(axis=0)[middle][:, side].mean() > 0.8


def test_cells_know_the_camera_that_shows_them(depths: FaceDepths) -> None:
    across = (np.arange(depths.scores.shape[2]) + 0.5) * depths.cell
    off = depths.cameras[20, :, 0] - across
    assert np.abs(off).max() < 0.15, "the nearest one, and they are 0.2 m from each other"
    assert depths.cameras[20, 0, 1:].tolist() == pytest.approx([EYE_M, AWAY_M])


def test_flat_paint_tells_nothing() -> None:
    flat = face_depths(FACE, strips(textured=False), PATH)
    assert flat is not None
    assert np.abs(flat.scores[:, 8:-8, 12:-12]).max() < 0.1


def test_no_frame_no_depths() -> None:
    assert face_depths(FACE, strips(), Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))) is None


def test_face_is_one_of_the_planes_and_nearer_ones_are_closer() -> None:
    depths = swept_depths(2.0, 0.008)
    assert 0.0 in depths.round(9).tolist()
    assert (np.diff(np.diff(depths)) > 0).all()
    assert (depths[0], depths[-1]) == (pytest.approx(-0.2, abs=0.05), pytest.approx(1.6, abs=0.15))


def test_a_point_behind_the_face_is_seen_where_both_rays_meet_it() -> None:
    first, second, point = np.array([0.3, 1.0, 2.0]), np.array([1.1, 1.2, 1.8]), np.array([0.7, 0.4, -0.5])
    on_face = [eye[:2] + (point[:2] - eye[:2]) * eye[2] / (eye[2] - point[2]) for eye in (first, second)]
    assert (seen_from(first, second, 0.5) @ [*on_face[0], 1.0])[:2] == pytest.approx(on_face[1])
