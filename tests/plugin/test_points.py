"""What plugins of points have in common: view plans, tracks with and without a path, structures, scores."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from savmap.errors import OutputError, StructureError
from savmap.graph import KeySpace, Landmark
from savmap.plugin import (
    DOWNWARDS,
    LEVEL,
    Detection,
    Feature,
    Floats,
    FrameTable,
    Measured,
    Panorama,
    PassPreview,
    RowFacts,
    Structure,
    Track,
    Trajectory,
    View,
    ViewSpec,
    count_view_plan,
    draw_points,
    face_view_plan,
    frames_showing,
    keys_by_object,
    point_structures,
    project,
    score_points,
    surveyed_points,
    touches_border,
    tracks_along_face,
    tracks_on_floor,
    upright_ends,
    with_sizes,
)
from savmap.vision.views import Renderer

SPEC = ViewSpec("pass 1 / view", 0.0, hfov_deg=110.0)
FRAMES = 30
FACTS = RowFacts("A", FrameTable(np.arange(FRAMES) / 5, ("pass 1",) * FRAMES), {SPEC.name: SPEC}, {"pass 1": 1})
PLACES = np.array([0.0, 1.1, 2.9, 4.0])


def path(scale: float = 1.0, lift_m: float = 0.0) -> Trajectory:
    """Along x at 1.4 m, 2.4 m from the face; a path that is off by a scale and a height."""
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, :3, :3] = LEVEL
    along = np.linspace(-0.5, 4.5, FRAMES) + 0.2 * np.sin(np.arange(FRAMES) / 3)
    poses[:, :3, 3] = scale * np.stack([along, np.full(FRAMES, 1.4), np.full(FRAMES, 2.4)], axis=1)
    poses[:, 1, 3] += lift_m
    return Trajectory(np.arange(FRAMES), poses)


def features(z: float) -> list[Feature]:
    """Feet and tops of posts at a depth, as the true path sees them."""
    found: list[Feature] = []
    for frame, pose in enumerate(path().world_from_rig):
        for instance, x in enumerate(PLACES):
            for part, y in (("foot", 0.0), ("top", 2.0)):
                pixel = project((np.array([[x, y, z]]) - pose[:3, 3]) @ pose[:3, :3], SPEC.camera)
                found.append(Feature(frame, SPEC.name, "post", part, instance, pixel, np.eye(2)[None]))
    return found


def truly(tracks: list[Track], z: float) -> bool:
    """Whether each track is of one post, in order along x, and has all its sightings."""
    names = [f"post {number} / {part}" for number in range(1, 5) for part in ("foot", "top")]
    expected = {(one.frame, one.part, one.instance): one.pixels[0] for one in features(z)}
    right = [
        np.array_equal(pixel, expected[frame, str(track.place["part"]), int(track.place["post"]) - 1])
        for track in tracks
        for frame, pixel in zip(track.frames.tolist(), track.pixels, strict=True)
    ]
    return [track.name for track in tracks] == names and all(right) and len(right) == len(expected)


def test_objects_on_the_floor_are_told_apart_on_a_known_path() -> None:
    assert truly(tracks_on_floor(features(0.8), FACTS, path(), "foot", 0.3), 0.8)


def test_the_floor_is_found_under_a_path_of_another_scale_and_height() -> None:
    off = path(scale=1.4, lift_m=1.0)
    assert truly(tracks_on_floor(features(0.8), FACTS, off, "foot", 0.3, level_known=False), 0.8)


def test_objects_in_the_face_are_told_apart_without_a_path() -> None:
    assert truly(tracks_along_face(features(0.0), FACTS, path().world_from_rig[:, :3, :3], "foot"), 0.0)


def test_two_passes_are_aligned_by_their_first_object() -> None:
    there = features(0.0)
    back = [replace(one, frame=2 * FRAMES - 1 - one.frame) for one in there]
    table = FrameTable(np.arange(2 * FRAMES) / 5, ("pass 1",) * FRAMES + ("pass 2",) * FRAMES)
    facts = replace(FACTS, frames=table, travel={"pass 1": 1, "pass 2": -1})
    tracks = tracks_along_face([*there, *back], facts, np.tile(LEVEL, (2 * FRAMES, 1, 1)), "foot")
    assert [len(track.frames) for track in tracks] == [2 * FRAMES] * 8


@pytest.mark.parametrize("level_known", [True, False])
def test_nothing_seen_is_said(level_known: bool) -> None:
    with pytest.raises(StructureError, match="nothing was seen in 3 frames"):
        tracks_on_floor([], FACTS, path(), "foot", 0.3, level_known=level_known)
    with pytest.raises(StructureError, match="nothing was seen in 3 frames"):
        tracks_along_face([], FACTS, path().world_from_rig[:, :3, :3], "foot")


def test_frames_that_could_show_a_point_are_counted() -> None:
    points = np.array([[4.4, 1.0, 0.0], [2.0, 1.4, 5.0]])
    shown = frames_showing(points, FACTS, path(), np.array([0.0, 0.0, -1.0]))
    assert 0 < shown[0] < FRAMES
    assert shown[1] == 0
    assert not frames_showing(points, FACTS, path(), np.array([0.0, 1.0, 0.0])).any()


def point(place: tuple[float, float, float], sigma: float = 0.01) -> Landmark:
    return Landmark(np.array(place), sigma**2 * np.eye(3), 5)


def solved() -> tuple[list[Track], dict[str, Landmark]]:
    tracks = tracks_on_floor(features(0.8), FACTS, path(), "foot", 0.3)
    places = {"foot": 0.0, "top": 2.0}
    return tracks, {
        track.name: point((float(PLACES[int(track.place["post"]) - 1]), places[str(track.place["part"])], 0.8))
        for track in tracks
    }


def test_keys_of_an_object_are_those_of_its_tracks() -> None:
    tracks, _ = solved()
    keys = KeySpace("posts")
    flat = [key for parts in keys_by_object(tracks, keys).values() for key in parts.values()]
    assert flat == list(keys.keys([track.name for track in tracks]).values())
    assert list(keys_by_object(tracks, keys)["post 1"]) == ["foot", "top"]


def test_structures_leave_out_what_is_lost_and_may_be_closed() -> None:
    tracks, landmarks = solved()
    lost = landmarks | {"post 2 / top": point((1.1, 2.0, 0.8), sigma=1.0)}
    assert [own.id for own in point_structures(tracks, lost, 0.5)] == ["post 1", "post 3", "post 4"]
    assert point_structures(tracks, landmarks, 0.5)[0].edges.tolist() == [[0, 1]]
    assert point_structures(tracks, landmarks, 0.5, closed=True)[0].edges.tolist() == [[0, 1], [1, 0]]


def test_sizes_have_the_sigma_of_the_difference() -> None:
    class Solution:
        def difference_sigma(self, plugin: str, first: str, last: str, axis: int) -> float:
            assert (plugin, first, last, axis) == ("posts", "post 1 / foot", "post 1 / top", 1)
            return 0.014

    tracks, landmarks = solved()
    first = point_structures(tracks, landmarks, 0.5)[:1]
    sizes: Any = {"height_m": ("foot", "top", "y"), "depth_m": ("foot", "back", "z")}
    (sized,) = with_sizes(first, Solution(), "posts", sizes)  # type: ignore[arg-type]
    assert sized.attributes["height_m"] == Measured(2.0, 0.014)
    assert "depth_m" not in sized.attributes


def mapped(*x: float) -> list[Structure]:
    edges = np.empty((0, 2), np.int64)
    return [
        Structure(f"post {k}", "post", np.array([[at, 0.0, 0.0]]), np.eye(3)[None], ("foot",), edges)
        for k, at in enumerate(x, start=1)
    ]


def truth(*x: float) -> Floats:
    return np.array([[[at, 0.0, 0.0]] for at in x]).reshape(-1, 1, 3)


def test_scores_match_one_to_one_as_many_as_can_be() -> None:
    score = score_points(mapped(0.5, 1.4), truth(0.0, 0.9), 1.0, "posts")
    assert score.deviations == {"post 1": pytest.approx(0.5), "post 2": pytest.approx(0.5)}
    assert (score.distances["posts"].missing, score.distances["posts"].spurious) == (0, 0)


def test_objects_beyond_the_ends_are_neither_missing_nor_spurious() -> None:
    score = score_points(mapped(0.1, 5.0, 3.0), truth(0.0, 9.0, 2.0), 0.5, "posts", ends_x=(-1.0, 4.0))
    found = score.distances["posts"]
    assert (len(found.distances_m), found.missing, found.spurious) == (1, 1, 1)
    assert score.deviations == {"post 1": pytest.approx(0.1), "post 3": float("inf")}


def test_without_a_survey_there_is_no_score_and_nothing_surveyed_is_drawn() -> None:
    assert score_points(mapped(1.0), None, 0.5, "posts").distances == {}
    assert [one.role for one in draw_points(mapped(1.0), None, {"post 1": 1.0}, 0.05, "posts")] == ["off"]


@pytest.mark.parametrize("entry", [[[0, 1]], [["a", 1, 2]], [[0, 1, float("nan")]]])
def test_a_malformed_survey_is_one_line(entry: Any) -> None:
    assert surveyed_points({}, "posts", 1) is None
    with pytest.raises(OutputError, match="survey: posts: "):
        surveyed_points({"posts": entry}, "posts", 1)


def mask_of(rows: slice, columns: slice) -> Any:
    mask = np.zeros((480, 640), np.bool_)
    mask[rows, columns] = True
    return mask


def test_ends_and_borders_of_masks() -> None:
    mask = mask_of(slice(100, 301), slice(200, 221))
    np.testing.assert_allclose(upright_ends(mask), [[210, 300.5], [210, 99.5]])
    mask[99, 218:221] = mask[301, 200:202] = True
    np.testing.assert_allclose(upright_ends(mask), [[210, 301.5], [210, 98.5]])
    mask[99, 218:221] = mask[301, 200:202] = False
    np.testing.assert_allclose(upright_ends(mask_of(slice(100, 101), slice(200, 221))), [[210, 100.5], [210, 99.5]])
    assert not touches_border(mask)
    assert touches_border(mask_of(slice(1, 301), slice(200, 221)))


@pytest.fixture
def pass_preview() -> PassPreview:
    keys = tuple(Panorama(k, k / 5, np.zeros((64, 128, 3), np.uint8)) for k in range(3))
    return PassPreview(keys, (), Renderer(), LEVEL.T)


def two_posts(view: View) -> list[Detection]:
    masks = [mask_of(slice(100, 300), slice(left, left + 20)) for left in (200, 400)]
    return [Detection("post", 0.9, mask, mask.astype(np.float32)) for mask in masks]


def test_a_plan_of_the_face_claims_it_only_where_the_plugin_finds_it(pass_preview: PassPreview) -> None:
    plain = face_view_plan(pass_preview, two_posts, None, {}, LEVEL, "posts")
    assert (plain.world_from_rig, plain.travel, plain.views[0].name) == (None, 0, "posts")
    finds = face_view_plan(pass_preview, two_posts, None, {}, LEVEL, "posts", finds_face=True)
    np.testing.assert_allclose(finds.world_from_rig, LEVEL, atol=1e-9)
    assert finds.views == plain.views


def test_where_nothing_is_detected_a_plan_has_a_note_and_the_face_is_not_found(pass_preview: PassPreview) -> None:
    plan = face_view_plan(pass_preview, lambda view: [], None, {}, LEVEL, "posts")
    assert plan.views == ()
    assert "no structure is seen" in plan.notes[0]
    with pytest.raises(StructureError, match="no structure is seen"):
        face_view_plan(pass_preview, lambda view: [], None, {}, LEVEL, "posts", finds_face=True)


def test_a_plan_that_counts_looks_where_it_is_told(pass_preview: PassPreview) -> None:
    plan = count_view_plan(pass_preview, two_posts, {}, LEVEL, "floor", DOWNWARDS, every=2)
    assert (plan.views[0].name, plan.views[0].every, plan.notes) == ("floor", 2, ())
    np.testing.assert_allclose(LEVEL @ plan.views[0].rig_from_view, DOWNWARDS, atol=1e-9)
    assert "fewer than 3" in count_view_plan(pass_preview, two_posts, {}, LEVEL, "floor", DOWNWARDS, 3).notes[0]


def test_a_line_that_no_view_shows_whole_is_seen_from_as_near_as_may_be(pass_preview: PassPreview) -> None:
    def line(view: View) -> list[Detection]:
        mask = mask_of(slice(200, 220), slice(0, view.spec.width))
        return [Detection("post", 0.9, mask, mask.astype(np.float32))]

    plan = count_view_plan(pass_preview, line, {}, LEVEL, "floor", DOWNWARDS)
    assert plan.views[0].hfov_deg < 70
    assert "fewer than 2" in plan.notes[0]
    nothing = count_view_plan(pass_preview, lambda view: [], {}, LEVEL, "floor", DOWNWARDS)
    assert nothing.views[0].hfov_deg > 150
