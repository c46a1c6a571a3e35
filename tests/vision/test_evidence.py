"""Evidence in planes: what adds up over frames, what smears away, and how frames are read with it in mind."""

import numpy as np
import pytest

from savmap.types import (
    Feature,
    Floats,
    FoundObject,
    FrameTable,
    PlanePatch,
    RowFacts,
    Trajectory,
    View,
    ViewSpec,
)
from savmap.vision.evidence import (
    PackedView,
    features_of,
    found_detections,
    gather,
    outlines_in,
)
from savmap.vision.evidence.detections import BAND, grown, within_picture
from savmap.vision.evidence.planes import heights_shown, outline_in
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


def a_post(outline: Floats, name: str = "post 1") -> FoundObject:
    return FoundObject(name, "post", outline, 1.0)


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


def test_an_outline_behind_the_camera_is_nowhere() -> None:
    behind = post(1.0, z=4.0)
    assert outline_in(SPEC, pose(1.0), behind) is None


def test_an_outline_is_cut_at_the_camera() -> None:
    floor = np.array([[0.0, 0, -3.0], [1.0, 0, -3.0], [1.0, 0, 5.0], [0.0, 0, 5.0]])
    pixels = outline_in(SPEC, pose(0.5), floor)
    assert pixels is not None
    assert np.isfinite(pixels).all()


def shown_at(outlines: list[Floats], probability: float, found: list[FoundObject]) -> list[Floats]:
    """The columns (first, last + 1) and rows of what is detected of found objects where the network sees these outlines."""
    view = View(SPEC, 0, 0.0, np.zeros((SPEC.height, SPEC.width, 3), np.uint8))
    detections = found_detections(view, drawn(pose(2.0), outlines, probability), pose(2.0), found)
    boxes = []
    for detection in detections:
        rows, columns = np.nonzero(detection.mask)
        boxes.append(np.array([columns.min(), columns.max() + 1, rows.min(), rows.max() + 1], np.float64))
    return boxes


def pixels_of(outline: Floats) -> Floats:
    pixels = outline_in(SPEC, pose(2.0), outline)
    assert pixels is not None
    return np.array([pixels[:, 0].min(), pixels[:, 0].max(), pixels[:, 1].min(), pixels[:, 1].max()])


def wide(low: float, high: float, bottom: float = 0.2, top: float = 1.8) -> Floats:
    return np.array([[low, bottom, 0.0], [high, bottom, 0.0], [high, top, 0.0], [low, top, 0.0]])


def test_an_outline_grows_across_its_lesser_thickness() -> None:
    lying = np.array([[0.0, 1.0, 0.5], [2.0, 1.0, 0.5], [2.0, 1.1, 0.5], [0.0, 1.1, 0.5]])
    expected = lying + np.array([0, 0.1 * BAND, 0]) * np.array([-1, -1, 1, 1])[:, None]
    assert grown(lying, BAND) == pytest.approx(expected)
    assert grown(post(1.0), -BAND)[:, 0] == pytest.approx(1.0 + 0.05 * (1 - 2 * BAND) * np.array([-1, 1, 1, -1]))


@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        (wide(1.6, 2.4), (1.6, 2.4)),
        (wide(1.55, 2.46), (1.55, 2.46)),
        (wide(1.6, 3.2), (1.6, 2.4 + 0.8 * BAND)),
        (wide(1.6, 2.1), (1.6, 2.4 - 0.8 * BAND)),
    ],
    ids=["as found", "a bit off", "something adjoins", "a part is hidden"],
)
def test_borders_of_what_is_found_are_measured_within_a_band(seen: Floats, expected: tuple[float, float]) -> None:
    for probability in (0.9, 0.3):
        (box,) = shown_at([seen], probability, [a_post(wide(1.6, 2.4))])
        assert box == pytest.approx(pixels_of(wide(*expected)), abs=2.0)


def test_what_is_not_seen_or_not_found_is_not_detected() -> None:
    assert shown_at([wide(1.6, 2.4)], 0.9, []) == []
    assert shown_at([wide(1.6, 2.4)], 0.9, [a_post(wide(3.0, 3.6))]) == []
    assert shown_at([wide(1.6, 2.4)], 0.05, [a_post(wide(1.6, 2.4))]) == []
    assert shown_at([wide(1.6, 2.4)], 0.9, [a_post(wide(1.6, 2.4) + np.array([0, 0, 5.0]))]) == []


def test_features_are_of_the_object_that_their_instance_lies_in() -> None:
    def edge(number: int, x: float, label: str = "post") -> Feature:
        pixels = outline_in(SPEC, pose(2.0), post(x))
        assert pixels is not None
        return Feature(0, "face", label, "left", number, pixels[[0, 3]], np.tile(np.eye(2), (2, 1, 1)))

    outlines = outlines_in(SPEC, pose(2.0), [a_post(post(1.0)), a_post(post(3.0), "post 2")])
    features = [edge(0, 2.99), edge(1, 1.0), edge(1, 1.02), edge(2, 2.0), edge(3, 1.0, "other")]
    assert [f.object for f in features_of(features, outlines)] == ["post 2", "post 1", "post 1", "", ""]


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
