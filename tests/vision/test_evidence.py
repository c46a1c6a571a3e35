"""Evidence in planes: what adds up over frames, what smears away."""

import numpy as np
import pytest

from savmap.geometry import pinhole
from savmap.types import (
    Floats,
    FrameTable,
    PlanePatch,
    RowFacts,
    Trajectory,
    View,
    ViewSpec,
)
from savmap.vision.evidence import PackedView, gather
from savmap.vision.evidence.planes import heights_shown
from savmap.vision.networks.segmenter import Segmentation

SPEC = ViewSpec("face", 0.0, hfov_deg=100.0, width=320, height=240)
PATCH = PlanePatch("face", np.array([-1.0, 0.0, 0.0]), np.eye(3)[0], np.eye(3)[1], np.array([6.0, 2.0]), 0.05)
# The rig looks at the face: x right, y down, z forward is the row's x, -y, -z.
AT_FACE = np.diag([1.0, -1.0, -1.0])
# Turned up by 60 degrees.
UPWARDS = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, -np.sqrt(0.75)], [0.0, np.sqrt(0.75), 0.5]])


def pose(x: float) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = AT_FACE, [x, 1.0, 2.0]
    return matrix


def drawn(world_from_rig: Floats, outlines: list[Floats], probability: float) -> Segmentation:
    """A network that sees posts of these outlines with some probability, and nothing else."""
    maps = np.zeros((2, SPEC.height, SPEC.width), np.float32)
    for outline in outlines:
        local = (outline - world_from_rig[:3, 3]) @ world_from_rig[:3, :3] @ SPEC.rig_from_view
        pixels = pinhole.project(local, SPEC.camera)
        columns = slice(max(int(pixels[:, 0].min()), 0), max(int(pixels[:, 0].max()) + 1, 0))
        rows = slice(max(int(pixels[:, 1].min()), 0), int(pixels[:, 1].max()) + 1)
        maps[1, rows, columns] = probability
    maps[0] = 1 - maps[1]
    return Segmentation(("post",), maps)


def post(x: float, z: float = 0.0) -> Floats:
    return np.array([[x - 0.05, 0.1, z], [x + 0.05, 0.1, z], [x + 0.05, 1.9, z], [x - 0.05, 1.9, z]])


def packed_views_of(outlines: list[Floats], probability: float) -> tuple[list[PackedView], Trajectory]:
    xs = np.linspace(0.0, 4.0, 21)
    poses = np.array([pose(x) for x in xs])
    image = np.full((SPEC.height, SPEC.width, 3), 90, np.uint8)
    views = [View(SPEC, frame, 0.1 * frame, image) for frame in range(len(xs))]
    packed_views = [
        PackedView.of(view, drawn(at, outlines, probability)) for view, at in zip(views, poses, strict=True)
    ]
    return packed_views, Trajectory(np.arange(len(xs)), poses)


def columns_of(evidence: Floats, x: float) -> float:
    """The greatest mean evidence of a column within 5 cm of x, over the post's height."""
    across = PATCH.origin[0] + PATCH.across
    return float(evidence[8:32, np.abs(across - x) < 0.05].mean(axis=0).max())


def test_a_faint_post_in_the_plane_adds_up() -> None:
    packed_views, path = packed_views_of([post(1.0), post(3.0)], 0.3)
    seen = gather(PATCH, ("post",), packed_views, {"face": SPEC}, path)
    assert columns_of(seen.of("post"), 1.0) == pytest.approx(0.3, abs=0.08)
    assert columns_of(seen.of("post"), 3.0) == pytest.approx(0.3, abs=0.08)
    assert columns_of(seen.of("post"), 2.0) == 0.0


def test_what_stands_behind_the_plane_smears_away() -> None:
    packed_views, path = packed_views_of([post(2.0, z=-1.0)], 1.0)
    seen = gather(PATCH, ("post",), packed_views, {"face": SPEC}, path)
    assert 0.0 < seen.of("post").max() < 0.5


def test_nothing_is_known_of_what_no_frame_shows() -> None:
    packed_views, path = packed_views_of([post(1.0)], 1.0)
    far = PlanePatch("far", np.array([90.0, 0, 0]), np.eye(3)[0], np.eye(3)[1], np.ones(2), 0.1)
    seen = gather(far, ("post",), packed_views, {"face": SPEC}, path)
    assert not seen.weight.any()
    assert not seen.mean.any()


def test_frames_without_a_pose_are_left_out() -> None:
    packed_views, path = packed_views_of([post(1.0)], 1.0)
    alone = Trajectory(path.frames[:1], path.world_from_rig[:1])
    seen = gather(PATCH, ("post",), packed_views, {"face": SPEC}, alone)
    whole = gather(PATCH, ("post",), packed_views, {"face": SPEC}, path)
    assert (seen.weight > 0).sum() < (whole.weight > 0).sum()


def test_the_plane_is_pictured() -> None:
    packed_views, path = packed_views_of([], 0.0)
    seen = gather(PATCH, ("post",), packed_views, {"face": SPEC}, path)
    assert np.abs(seen.picture[seen.weight > 0].astype(int) - 90).max() <= 2


def test_the_heights_of_the_face_that_views_show() -> None:
    """A view ahead shows 2 m * tan(v / 2) above and below the camera; one that looks up shows more above, and one along the aisle nothing."""
    path = Trajectory(np.arange(2), np.stack([pose(0.0), pose(1.0)]))
    ahead = ViewSpec("pass 1 / ahead", 0.0, hfov_deg=100.0, width=320, height=240)
    up = ViewSpec("pass 1 / up", 0.0, pitch_deg=40.0, hfov_deg=100.0, width=320, height=240)
    along = ViewSpec("pass 1 / along", 90.0, hfov_deg=100.0, width=320, height=240)
    other = ViewSpec("pass 2 / up", 0.0, pitch_deg=40.0, hfov_deg=100.0, width=320, height=240)

    def shown(*views: ViewSpec) -> tuple[float, float]:
        frames = FrameTable(np.arange(2.0), ("pass 1",) * 2)
        return heights_shown(
            path, RowFacts("A", frames, {view.name: view for view in views}, {"pass 1": 1, "pass 2": 1})
        )

    reach = 2.0 * np.tan(np.radians(50.0)) * 239 / 320
    assert shown(ahead, along, other) == pytest.approx((1.0 - reach, 1.0 + reach), abs=0.02)
    low, high = shown(ahead, up)
    assert low == pytest.approx(1.0 - reach, abs=0.02)
    assert 4.0 < high <= 1.0 + 9 * 2.0
