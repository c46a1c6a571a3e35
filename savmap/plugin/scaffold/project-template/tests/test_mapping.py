"""From drawn masks to places, without a video: two pillars before a camera that drives past them."""

from collections.abc import Sequence

import numpy as np
import pytest

from savmap.graph import CameraHeight, References, camera_priors, merge, solve
from savmap.lab.scenes import Goods, Hall, Look, RowFrame, Site
from savmap.plugin import (
    LEVEL,
    Detection,
    Feature,
    Floats,
    FrameTable,
    KeySpace,
    KnownSize,
    Measured,
    RowFacts,
    Structure,
    StructureError,
    Trajectory,
    View,
    ViewSpec,
    project,
)
from savmap.vision.networks.segmenter import Segmenter
from savmap_pillars.lab import PillarsLab
from savmap_pillars.plugin import Pillars, Settings

SPEC = ViewSpec("pass 1 / pillars", 0.0, hfov_deg=110.0, width=640, height=480)
FRAMES = 12
POSTS = np.array([[[0.5, 0.0, 0.4], [0.5, 2.5, 0.4]], [[2.4, 0.0, 0.5], [2.4, 2.5, 0.5]]])
FACTS = RowFacts("A", FrameTable(np.arange(FRAMES) / 5.0, ("pass 1",) * FRAMES), {SPEC.name: SPEC}, {"pass 1": 1})


@pytest.fixture
def plugin() -> Pillars:
    return Pillars(Settings())


def path() -> Trajectory:
    """The camera goes along x at 1.4 m, 2.4 m in front of the face, and looks straight at it."""
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, :3, :3] = LEVEL
    poses[:, :3, 3] = np.stack([np.linspace(0, 3, FRAMES), np.full(FRAMES, 1.4), np.full(FRAMES, 2.4)], axis=1)
    return Trajectory(np.arange(FRAMES), poses)


def pixels_of(points: Floats, pose: Floats) -> Floats:
    return project((points - pose[:3, 3]) @ pose[:3, :3] @ SPEC.rig_from_view, SPEC.camera)


def features() -> list[Feature]:
    """What `extract_features` would give of the posts in every frame."""
    return [
        Feature(frame, SPEC.name, "pillar", part, instance, pixel[None], np.eye(2)[None])
        for frame, pose in enumerate(path().world_from_rig)
        for instance, post in enumerate(POSTS)
        for part, pixel in zip(("foot", "top"), pixels_of(post, pose), strict=True)
    ]


def mapped(plugin: Pillars) -> list[Structure]:
    tracks = plugin.track(features(), FACTS, path())
    constraints = plugin.constrain(tracks, FACTS, path(), KeySpace(plugin.name))
    frames = camera_priors(FACTS, path(), References(camera_heights=(CameraHeight(1.4, 0.01),)), fixed=path())
    solution = solve(merge(frames, constraints))
    return plugin.describe(tracks, solution.landmarks_of(plugin.name), solution)


def picture(masks: Sequence[tuple[slice, slice]]) -> tuple[View, list[Detection]]:
    """A view in which the masks are magenta, and detections of them."""
    image = np.full((SPEC.height, SPEC.width, 3), 110, np.uint8)
    detections = []
    for place in masks:
        image[place] = (230, 20, 200)
        mask = np.zeros(image.shape[:2], np.bool_)
        mask[place] = True
        detections.append(Detection("pillar", 0.9, mask, mask.astype(np.float32)))
    return View(SPEC, 7, 0.5, image), detections


def test_the_network_sees_what_is_magenta(plugin: Pillars) -> None:
    view, _ = picture([(slice(100, 300), slice(200, 220))])
    probability = Segmenter(plugin.model).probabilities(view.image)[1]
    assert np.array_equal(probability > 0.5, view.image[..., 0] == 230)


def test_ends_of_a_mask_are_foot_and_top_and_cut_ones_are_left_out(plugin: Pillars) -> None:
    view, detections = picture([(slice(100, 301), slice(200, 221)), (slice(0, 200), slice(400, 420))])
    found = plugin.extract_features(view, detections)
    assert [(one.part, one.instance, one.frame) for one in found] == [("foot", 0, 7), ("top", 0, 7)]
    np.testing.assert_allclose(np.concatenate([one.pixels for one in found]), [[210, 300.5], [210, 99.5]])


def test_sightings_are_sorted(plugin: Pillars) -> None:
    tracks = plugin.track(features(), FACTS, path())
    assert [track.name for track in tracks] == [f"pillar {n} / {part}" for n in (1, 2) for part in ("foot", "top")]
    assert all(len(track.frames) == FRAMES for track in tracks)


def test_where_nothing_is_seen_it_says_so(plugin: Pillars) -> None:
    with pytest.raises(StructureError, match="nothing was seen"):
        plugin.track([], FACTS, path())


def test_they_are_mapped_where_they_stand(plugin: Pillars) -> None:
    structures = mapped(plugin)
    assert [own.id for own in structures] == ["pillar 1", "pillar 2"]
    np.testing.assert_allclose([own.vertices for own in structures], POSTS, atol=0.01)
    heights = [own.attributes["height_m"] for own in structures]
    assert all(isinstance(height, Measured) and 0 < height.sigma < 0.1 for height in heights)
    np.testing.assert_allclose([float(height) for height in heights], 2.5, atol=0.02)


def test_a_known_height_is_used() -> None:
    """A value that the pictures do not contradict: what they do is refused."""
    known = Pillars(Settings(height_m=KnownSize(value=2.504, sigma=0.0001)))
    heights = [own.vertices[1, 1] - own.vertices[0, 1] for own in mapped(known)]
    np.testing.assert_allclose(heights, 2.504, atol=0.0005)


def test_scores_and_drawings_tell_what_is_off_and_what_is_missing(plugin: Pillars) -> None:
    survey = {"pillars": (POSTS + np.array([0.1, 0, 0])).tolist()}
    first, _ = mapped(plugin)
    score = plugin.evaluate([first], survey)
    assert score.apart["pillars"].missing == 1
    assert score.deviations["pillar 1"] == pytest.approx(0.1, abs=0.01)
    assert [one.role for one in plugin.draw([first], survey, score.deviations)] == ["survey", "survey", "off"]
    assert [one.role for one in plugin.draw([first], None, {})] == ["mapped"]
    assert plugin.evaluate([first], {}).apart == {}


def test_as_many_as_can_have_a_partner(plugin: Pillars) -> None:
    first, second = mapped(plugin)
    survey = {"pillars": [(POSTS[0] - np.array([1.9, 0, 0])).tolist(), POSTS[0].tolist()]}
    score = plugin.evaluate([first, second], survey).apart["pillars"]
    assert (len(score.distances_m), score.missing, score.spurious) == (2, 1, 1)


def test_rows_share_their_feet(plugin: Pillars) -> None:
    first, second = mapped(plugin)
    assert [own.id for own in plugin.cross_row_landmarks([first, second])] == ["pillar 1", "pillar 2"]
    np.testing.assert_allclose(plugin.cross_row_landmarks([first])[0].place, POSTS[0, 0], atol=0.01)


def test_the_simulator_builds_them_and_surveys_their_fronts() -> None:
    site = Site(Hall(), Goods(), Look(), {"A": RowFrame(np.eye(3), np.array([1.0, 0.0, 0.0]), True)})
    parts = PillarsLab().scene({"stands": [{"x": 1.5, "z": 0.4, "height": 2.5}]}, site)
    assert len(parts.boxes) == 1
    np.testing.assert_allclose(parts.survey["A"]["pillars"], POSTS[:1])


def test_a_random_place_has_some() -> None:
    site = Site(Hall(), Goods(), Look(), {"A": RowFrame(np.eye(3), np.zeros(3), True)})
    section = PillarsLab().random_section(np.random.default_rng(0), site).section
    assert 1 <= len(PillarsLab().scene(section, site).boxes) <= 4
