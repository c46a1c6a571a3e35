"""How deep flat parts lie: what the marks on them tell, and when they tell nothing."""

from collections.abc import Mapping

import cv2
import numpy as np
import pytest

from savmap.types import FlatDepth, FlatParts, Floats, PlanePatch, Trajectory, View, ViewSpec
from savmap.vision.evidence import PackedView, depth_of
from savmap.vision.evidence.depth import LEAST_SECTIONS, Vote, consensus

SPEC = ViewSpec("face", 0.0, hfov_deg=100.0, width=480, height=360)
PIXEL_M, LENGTH_M = 0.0025, 5.0
AT_FACE = np.diag([1.0, -1.0, -1.0])
"""The rig looks at the face: x right, y down, z forward is the row's x, -y, -z."""
HEIGHTS = (0.6, 1.0, 1.4, 1.7)
TALL = 0.12
FOCAL = SPEC.camera[0, 0]
XS = np.linspace(0.0, LENGTH_M, 21)


def poses_before(distance: float) -> Floats:
    matrices = np.tile(np.eye(4), (len(XS), 1, 1))
    matrices[:, :3, :3] = AT_FACE
    matrices[:, :3, 3] = np.stack([XS, np.full_like(XS, 1.1), np.full_like(XS, distance)], axis=1)
    return matrices


def marked(rng: np.random.Generator) -> Floats:
    """A band of 5 m with soft marks all along."""
    marks = rng.uniform(0, 1, (round(TALL / 0.03), round(LENGTH_M / 0.03))) > 0.75
    size = (round(LENGTH_M / PIXEL_M), round(TALL / PIXEL_M))
    return np.asarray(cv2.GaussianBlur(110 + 90 * cv2.resize(marks.astype(np.float32), size), (0, 0), 3), np.float64)


def packed_views_of(depths: Mapping[float, float], rng: np.random.Generator, noise: float = 1.0) -> list[PackedView]:
    """Packed views of bands at these heights and depths (z, m), marked all along, before a grey wall, from 2 m before the face."""
    bands = {height: marked(rng).astype(np.float32) for height in depths}
    packed_views = []
    for frame, pose in enumerate(poses_before(2.0)):
        image = np.full((SPEC.height, SPEC.width), 110.0, np.float32)
        for height, z in depths.items():
            view_from_row = (pose[:3, :3] @ SPEC.rig_from_view).T
            corner = np.array([0.0, height + TALL, z]) - pose[:3, 3]
            plane = np.column_stack(
                [view_from_row[:, 0] * PIXEL_M, -view_from_row[:, 1] * PIXEL_M, view_from_row @ corner]
            )
            size = (SPEC.width, SPEC.height)
            laid = cv2.warpPerspective(bands[height], SPEC.camera @ plane, size, flags=cv2.INTER_AREA, borderValue=-1)
            image = np.where(laid > 0, laid, image)
        image = np.clip(image + rng.normal(0, noise, image.shape), 0, 255).astype(np.uint8)
        view = View(SPEC, frame, 0.1 * frame, np.repeat(image[..., None], 3, axis=2))
        packed_views.append(PackedView(frame, view.spec.name, (), bytes(cv2.imencode(".jpg", view.image)[1])))
    return packed_views


def parts_at(heights: tuple[float, ...], z: float, scale: float = 1.0) -> FlatParts:
    """Bands that are thought to lie at z, a bit within their edges."""
    size = scale * np.array([LENGTH_M - 0.4, TALL - 0.03])
    parts = tuple(
        PlanePatch(f"band {height}", scale * np.array([0.2, height + 0.015, z]), *np.eye(3)[:2], size, 0.1)
        for height in heights
    )
    return FlatParts("band 1 / left", "z", parts)


def measured(packed_views: list[PackedView], flat: FlatParts, scale: float = 1.0) -> FlatDepth | None:
    path = Trajectory(np.arange(len(XS)), poses_before(2.0))
    scaled = path.world_from_rig.copy()
    scaled[:, :3, 3] *= scale
    return depth_of("racks", flat, packed_views, {"face": SPEC}, Trajectory(path.frames, scaled))


@pytest.mark.parametrize("z", [-0.03, -0.012, 0.0, 0.02])
def test_marks_tell_the_depth_to_a_millimetre(z: float) -> None:
    depth = measured(packed_views_of(dict.fromkeys(HEIGHTS, z), np.random.default_rng(1)), parts_at(HEIGHTS, -0.005))
    assert depth is not None
    value, sigma = depth.metres(2.0)
    assert value == pytest.approx(z, abs=0.001)
    assert 0.0002 < sigma < 0.002
    assert abs(value - z) < 2.5 * sigma


def test_the_scale_of_the_path_need_not_be_known() -> None:
    packed_views = packed_views_of(dict.fromkeys(HEIGHTS, -0.02), np.random.default_rng(2))
    depth, scaled = (
        measured(packed_views, parts_at(HEIGHTS, 0.0)),
        measured(packed_views, parts_at(HEIGHTS, 0.0, 3.0), 3.0),
    )
    assert depth is not None
    assert scaled is not None
    assert scaled.share == pytest.approx(depth.share, abs=1e-6)


def test_goods_before_some_parts_are_outvoted() -> None:
    depths = {**dict.fromkeys(HEIGHTS[:3], -0.02), HEIGHTS[3]: 0.04}
    depth = measured(packed_views_of(depths, np.random.default_rng(3)), parts_at(HEIGHTS, 0.0))
    assert depth is not None
    assert depth.metres(2.0)[0] == pytest.approx(-0.02, abs=0.001)


def test_parts_that_contradict_each_other_tell_nothing() -> None:
    depths = {HEIGHTS[0]: -0.02, HEIGHTS[1]: -0.02, HEIGHTS[2]: 0.03, HEIGHTS[3]: 0.03}
    assert measured(packed_views_of(depths, np.random.default_rng(4)), parts_at(HEIGHTS, 0.0)) is None


def test_plain_parts_tell_nothing() -> None:
    assert measured(packed_views_of({}, np.random.default_rng(5), noise=3.0), parts_at(HEIGHTS, 0.0)) is None


def test_too_few_frames_tell_nothing() -> None:
    packed_views = packed_views_of(dict.fromkeys(HEIGHTS, -0.02), np.random.default_rng(6))
    assert measured(packed_views[9:12], parts_at(HEIGHTS, 0.0)) is None
    assert measured([], parts_at(HEIGHTS, 0.0)) is None


def test_paths_and_parts_that_make_no_sense_tell_nothing() -> None:
    packed_views = packed_views_of(dict.fromkeys(HEIGHTS, -0.02), np.random.default_rng(8))
    flat = parts_at(HEIGHTS, 0.0)
    poses = poses_before(2.0)
    poses[::2, 2, 3] = 40.0
    assert depth_of("racks", flat, packed_views, {"face": SPEC}, Trajectory(np.arange(len(XS)), poses)) is None
    behind = poses_before(-2.0)
    assert depth_of("racks", flat, packed_views, {"face": SPEC}, Trajectory(np.arange(len(XS)), behind)) is None
    huge = FlatParts(
        "band", "z", (PlanePatch("all", np.array([-1e6, 0.0, 0.0]), *np.eye(3)[:2], np.array([2e6, 2.0]), 1),)
    )
    assert measured(packed_views, huge) is None


def test_what_stands_out_of_a_part_is_allowed_for() -> None:
    depth = FlatDepth("racks", "band", "z", -0.009, 0.0003, np.arange(3), 20, proud_m=0.001, proud_sigma_m=0.002)
    value, sigma = depth.metres(2.0)
    assert value == pytest.approx(-0.019)
    assert sigma == pytest.approx(np.hypot(0.0006, 0.002))


def votes_at(coordinates: Floats, parts: int = 4) -> list[Vote]:
    return [Vote(float(at), 1.0, 0.2 * n, n % parts) for n, at in enumerate(coordinates)]


def test_sigma_grows_with_the_scatter_between_places() -> None:
    rng = np.random.default_rng(7)
    quiet, loud = (consensus(votes_at(rng.normal(0.01, noise, 40))) for noise in (0.0001, 0.002))
    assert quiet is not None
    assert loud is not None
    assert 0.0003 <= quiet[1] < 0.00035
    assert loud[1] > 1.1 * quiet[1]


def test_few_sections_or_parts_or_places_tell_nothing() -> None:
    same = np.full(20, 0.01)
    assert consensus(votes_at(same)) is not None
    assert consensus(votes_at(same[: LEAST_SECTIONS - 1])) is None
    assert consensus(votes_at(same, parts=2)) is None
    assert consensus([Vote(0.01, 1.0, 0.1, n) for n in range(20)]) is None
