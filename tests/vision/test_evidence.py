"""Evidence in planes: what adds up over frames, what smears away, and how frames are read with it in mind."""

import cv2
import numpy as np
import pytest

from savmap.types import Detection, Expected, Floats, PlanePatch, Trajectory, View, ViewSpec
from savmap.vision.evidence import DetectionSettings, PackedView, expected_detections, gather, outlines_in
from savmap.vision.evidence.expected import within_picture
from savmap.vision.evidence.planes import outline_in
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
        pixels = outline_in(SPEC, world_from_rig, outline)
        assert pixels is not None
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


def detected(probability: float, expected: list[Expected]) -> list[float]:
    """Middles of the regions found where posts are expected; the network sees one at 1 and one at 3."""
    image = np.zeros((SPEC.height, SPEC.width, 3), np.uint8)
    segmentation = drawn(pose(2.0), [post(1.0), post(3.0)], probability)
    view = View(SPEC, 0, 0.0, image)
    found = expected_detections(view, segmentation, outlines_in(SPEC, pose(2.0), expected), DetectionSettings())
    return [float(np.nonzero(detection.mask)[1].mean()) for detection in found]


def test_a_faint_post_is_found_where_one_is_expected() -> None:
    centre = outline_in(SPEC, pose(2.0), post(1.0))
    assert centre is not None
    assert detected(0.2, [Expected("post", post(1.0))]) == [pytest.approx(centre[:, 0].mean(), abs=1.0)]


def test_an_object_in_pieces_is_found_by_the_colours_of_those_that_are_seen() -> None:
    """Two posts of one paint; the network sees one of them."""
    image = np.full((SPEC.height, SPEC.width, 3), 60, np.uint8)
    outlines = {x: outline_in(SPEC, pose(2.0), post(x)) for x in (1.0, 3.0)}
    for outline in outlines.values():
        assert outline is not None
        cv2.fillPoly(image, [np.round(outline).astype(np.int32)], (200, 120, 30))
    segmentation, view = drawn(pose(2.0), [post(3.0)], 0.9), View(SPEC, 0, 0.0, image)
    hidden = Expected("post", post(1.0), in_pieces=True)

    def found_at(thing: Expected) -> list[Detection]:
        return expected_detections(view, segmentation, outlines_in(SPEC, pose(2.0), [thing]), DetectionSettings())

    (found,) = found_at(hidden)
    middle = outlines[1.0]
    assert middle is not None
    assert np.nonzero(found.mask)[1].mean() == pytest.approx(middle[:, 0].mean(), abs=1.0)
    assert found_at(Expected("post", post(1.0))) == []
    assert found_at(Expected("post", post(2.0), in_pieces=True)) == []


def test_an_outline_that_reaches_far_beyond_the_picture_is_not_bent() -> None:
    """A leaning post, as a wide view shows one whose top is nearly beside the camera."""
    outline = np.array([[83.0, 200.0], [87.0, 200.0], [-4554.0, -3332.0], [-4622.0, -3332.0]])
    inside = within_picture(outline, (SPEC.height, SPEC.width))
    assert inside[:, 0].min() >= -65
    assert inside[:, 1].max() == 200.0
    left = 83.0 + (inside[:, 1] - 200.0) / -3532.0 * -4705.0
    right = 87.0 + (inside[:, 1] - 200.0) / -3532.0 * -4641.0
    assert (np.minimum(np.abs(inside[:, 0] - left), np.abs(inside[:, 0] - right)) < 0.01).all()


def test_an_outline_beside_the_picture_has_no_part_in_it() -> None:
    assert within_picture(np.array([[900.0, 0], [990, 0], [990, 90]]), (240, 320)).shape == (0, 2)


def test_a_post_that_leans_far_beyond_the_picture_is_found() -> None:
    """The view looks up along a tall post, whose lower end is behind it."""
    tall = np.array([[2.85, -1.5, 0.0], [2.95, -1.5, 0.0], [2.95, 2.0, 0.0], [2.85, 2.0, 0.0]])
    lean = np.eye(4)
    lean[:3, :3], lean[:3, 3] = AT_FACE @ UPWARDS, [2.0, 1.0, 0.6]
    outline = outline_in(SPEC, lean, tall)
    assert outline is not None
    assert np.abs(outline).max() > 2000
    shown = within_picture(outline, (SPEC.height, SPEC.width))
    maps = np.zeros((2, SPEC.height, SPEC.width), np.float32)
    cv2.fillPoly(maps[1], [np.round(shown).astype(np.int32)], 0.9)
    maps[0] = 1 - maps[1]
    view = View(SPEC, 0, 0.0, np.zeros((SPEC.height, SPEC.width, 3), np.uint8))
    outlines = outlines_in(SPEC, lean, [Expected("post", tall)])
    found = expected_detections(view, Segmentation(("post",), maps), outlines, DetectionSettings())
    assert sum(int(detection.mask.sum()) for detection in found) == (maps[1] > 0).sum()


def test_what_is_not_expected_is_passed_over() -> None:
    assert len(detected(0.9, [Expected("post", post(3.0))])) == 1
    assert detected(0.9, [Expected("post", post(2.0))]) == []


def test_nothing_is_made_up_where_nothing_is_seen() -> None:
    assert detected(0.05, [Expected("post", post(1.0)), Expected("post", post(3.0))]) == []


def test_an_outline_behind_the_camera_is_nowhere() -> None:
    behind = post(1.0, z=4.0)
    assert outline_in(SPEC, pose(1.0), behind) is None


def test_an_outline_is_cut_at_the_camera() -> None:
    floor = np.array([[0.0, 0, -3.0], [1.0, 0, -3.0], [1.0, 0, 5.0], [0.0, 0, 5.0]])
    pixels = outline_in(SPEC, pose(0.5), floor)
    assert pixels is not None
    assert np.isfinite(pixels).all()
