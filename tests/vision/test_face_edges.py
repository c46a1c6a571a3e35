"""The face beside a drive by its edges: painted posts before goods, seen from a known path, and a wall far away."""

from functools import cache
from typing import Literal

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.errors import StructureError
from savmap.geometry import sphere
from savmap.types import Floats, Panorama
from savmap.vision.evidence.face_edges import FaceEdges, FacePlane, FacePosts, FaceSweep, building_axes, faces_beside
from savmap.vision.odometry import WalkedPath

HEIGHT, FRAMES, LENGTH_M = 256, 18, 4.0
FACE_M, GOODS_M, WALL_M = 1.4, 1.9, 7.0
"""From the path to the face and the goods on its left, and to the wall on its right."""
POSTS_M, WIDTH_M, TOP_M = np.array([0.2, 1.3, 2.6, 3.8]), 0.12, 2.5
"""Posts' centres and width, and how far they reach up and down."""
UNIT_M = 2.5
"""Of the path."""
PIXEL_M, MARGIN_M = 0.02, 8.0
RIG_FROM_WORLD: Floats = Rotation.from_euler("yxz", [40.0, 5.0, -3.0], degrees=True).as_matrix()
"""World: x along the way, y down, z to the left."""
RAYS: Floats = (
    sphere.rays_from_panorama_pixels(
        np.stack(np.meshgrid(np.arange(2.0 * HEIGHT), np.arange(float(HEIGHT))), axis=-1), HEIGHT
    )
    @ RIG_FROM_WORLD
)
FACES = faces_beside(RIG_FROM_WORLD * [1.0, -1.0, -1.0], RIG_FROM_WORLD[:, 0])


def boxes(seed: int) -> Floats:
    """Grey levels of a plane that is covered with boxes."""
    rng = np.random.default_rng(seed)
    size = (round(2 * MARGIN_M / PIXEL_M), round((LENGTH_M + 2 * MARGIN_M) / PIXEL_M))
    plane = np.zeros(size)
    for top in range(0, size[0], 30):
        sides = np.cumsum(rng.integers(12, 50, size[1] // 12))
        plane[top : top + 30] = rng.uniform(40, 200, len(sides) + 1)[np.searchsorted(sides, np.arange(size[1]))]
    return plane


def posts() -> Floats:
    """Which part of a cell of the face's plane is a post's."""
    plane = np.zeros_like(boxes(0))
    rows = slice(*(round((MARGIN_M + y) / PIXEL_M) for y in (-TOP_M, TOP_M)))
    for left in POSTS_M - WIDTH_M / 2:
        first = round((MARGIN_M + left) / PIXEL_M)
        plane[rows, first : first + round(WIDTH_M / PIXEL_M)] = 1
    return plane


def seen(plane: Floats, x_m: float, away_m: float) -> Floats:
    """A plane at a distance on the left (negative: right), as the rays from x_m see it, whether it is before them or
    behind."""
    hits = RAYS[..., :2] * (away_m / np.where(np.abs(RAYS[..., 2:]) < 1e-3, 1e-3, RAYS[..., 2:])) + [x_m, 0.0]
    columns, rows = (np.clip((hits[..., k] + MARGIN_M) / PIXEL_M - 0.5, -9, 9e3).astype(np.float32) for k in (0, 1))
    grey = cv2.remap(plane.astype(np.float32), columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(grey, np.float64)


@cache
def driven() -> dict[str, FaceEdges]:
    """The edges on both sides; directions are off by two degrees."""
    goods, wall, face, edges = boxes(1), boxes(2), posts(), {side: FaceEdges() for side in FACES}
    rough = Rotation.from_euler("xyz", [1.0, 1.5, -1.0], degrees=True).as_matrix()
    for frame, x_m in enumerate(np.linspace(0.0, LENGTH_M, FRAMES).tolist()):
        post = seen(face, x_m, FACE_M)
        left = np.where(post > 0.5, 90.0, seen(goods, x_m, GOODS_M))
        image = np.where(RAYS[..., 2] > 0, left, seen(wall, x_m, -WALL_M)).astype(np.uint8)
        for side, rig_from_face in FACES.items():
            edges[side].add(
                frame, Panorama(frame, frame / 10, np.repeat(image[..., None], 3, axis=2)), rough @ rig_from_face
            )
    return edges


def path(drift: float = 0.0) -> WalkedPath:
    """The path in its own unit and the frame of the first rig, with steps that shrink by a share from first to last."""
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    x = np.linspace(0.0, LENGTH_M, FRAMES)
    poses[:, :3, 3] = (x - drift * x * (x - LENGTH_M) / (2 * LENGTH_M))[:, None] / UNIT_M * RIG_FROM_WORLD[:, 0]
    return WalkedPath(poses, np.zeros(FRAMES, np.int64), np.zeros((FRAMES, 6)))


def searched(side: Literal["left", "right"], drift: float = 0.0) -> tuple[FaceSweep, FacePlane]:
    sweep = driven()[side].along(path(drift), UNIT_M, FACES[side])
    assert sweep is not None
    plane = sweep.plane()
    assert plane is not None
    return sweep, plane


def off_m(candidates: FacePosts) -> Floats:
    """How far candidates are from the next post."""
    return np.asarray(np.abs(candidates.centres[:, None] * UNIT_M - POSTS_M).min(axis=1))


def test_the_face_and_its_posts_are_found_before_any_other_pair() -> None:
    sweep, plane = searched("left")
    assert plane.depth * UNIT_M == pytest.approx(FACE_M, rel=0.03)
    assert plane.stands
    assert np.array(plane.heights) * UNIT_M == pytest.approx([-TOP_M, TOP_M], abs=0.25)
    candidates = sweep.posts(plane)
    assert off_m(candidates)[: len(POSTS_M)].max() < 0.01
    assert len(set(np.round(candidates.centres[: len(POSTS_M)], 1))) == len(POSTS_M)
    assert candidates.widths[: len(POSTS_M)] * UNIT_M == pytest.approx(WIDTH_M, abs=0.02)
    assert candidates.ratios[: len(POSTS_M)].min() > 2 > 0 > candidates.ratios[len(POSTS_M) :].max()
    place = plane.points(candidates.centres[:1], 1.0)[0] @ RIG_FROM_WORLD * UNIT_M
    assert place == pytest.approx([candidates.centres[0] * UNIT_M, -UNIT_M, FACE_M], abs=0.05)


def test_nothing_stands_where_only_a_wall_is_far_away() -> None:
    _, plane = searched("right")
    assert not plane.stands


def test_a_path_whose_scale_drifts_will_do() -> None:
    sweep, plane = searched("left", drift=0.04)
    assert plane.depth * UNIT_M == pytest.approx(FACE_M, rel=0.03)
    assert off_m(sweep.posts(plane))[: len(POSTS_M)].max() < 0.06


def test_frames_that_are_few_or_in_no_part_of_the_path_show_no_face() -> None:
    known = path()
    lost = WalkedPath(known.world_from_rig, np.where(np.arange(FRAMES) < 5, 0, -1), known.variance)
    assert driven()["left"].along(lost, UNIT_M) is None


def test_the_middle_of_the_frames_directions_is_the_face_unless_it_is_given() -> None:
    sweep = driven()["left"].along(path(), UNIT_M)
    assert sweep is not None
    off = Rotation.from_matrix(sweep.path_from_face.T @ FACES["left"]).magnitude()
    assert np.degrees(off) == pytest.approx(2.06, abs=0.01)


def test_faces_look_away_from_the_way_on_both_sides() -> None:
    left, right = (RIG_FROM_WORLD.T @ FACES[side] for side in ("left", "right"))
    assert left == pytest.approx(np.eye(3), abs=1e-9)
    assert right == pytest.approx(np.diag([-1.0, 1.0, -1.0]), abs=1e-9)


def test_the_buildings_axes_are_those_of_straight_segments_in_the_paths_frame() -> None:
    rng, turn = np.random.default_rng(3), Rotation.from_euler("z", 4.0, degrees=True).as_matrix()
    known = path()
    poses = known.world_from_rig.copy()
    poses[1, :3, :3] = turn
    begin = rng.normal(size=(60, 3)) * 4
    end = begin + np.repeat(np.eye(3), 20, axis=0)
    rays = [points / np.linalg.norm(points, axis=1, keepdims=True) @ RIG_FROM_WORLD.T for points in (begin, end)]
    seen_in = {0: (rays[0], rays[1]), 1: (rays[0] @ turn, rays[1] @ turn)}
    walked = WalkedPath(poses, known.part, known.variance)
    up = building_axes(walked, seen_in)[:, 1]
    assert up == pytest.approx(-RIG_FROM_WORLD[:, 1], abs=1e-3)
    with pytest.raises(StructureError, match="no building directions"):
        building_axes(walked, {})
