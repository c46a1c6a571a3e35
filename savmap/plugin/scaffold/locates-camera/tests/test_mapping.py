"""From drawn masks to places and to the camera's path, without a video: a camera drives past a row of pillars."""

import numpy as np
import pytest

from savmap.graph import CameraHeight, References, Solution, camera_priors, merge, published_start, solve
from savmap.lab.scenes import Goods, Hall, Look, RowFrame, Site
from savmap.plugin import (
    LEVEL,
    Detection,
    Feature,
    Floats,
    FrameTable,
    KeySpace,
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
FRAMES = 40
PLACES = (0.0, 1.5, 2.8, 4.4, 5.6, 7.2, 8.5)
POSTS = np.array([[[x, 0.0, 0.0], [x, 2.6, 0.0]] for x in PLACES])
FACTS = RowFacts("A", FrameTable(np.arange(FRAMES) / 5.0, ("pass 1",) * FRAMES), {SPEC.name: SPEC}, {"pass 1": 1})


@pytest.fixture
def plugin() -> Pillars:
    return Pillars(Settings())


def path() -> Trajectory:
    """The camera goes along x at 1.4 m, 2.4 m in front of the face, now faster, now slower, and looks straight at
    it."""
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, :3, :3] = LEVEL
    along = np.linspace(0.0, 8.5, FRAMES) + 0.3 * np.sin(np.linspace(0, 9, FRAMES))
    poses[:, :3, 3] = np.stack([along, np.full(FRAMES, 1.4), np.full(FRAMES, 2.4)], axis=1)
    return Trajectory(np.arange(FRAMES), poses)


def pixels_of(points: Floats, pose: Floats) -> Floats:
    return project((points - pose[:3, 3]) @ pose[:3, :3] @ SPEC.rig_from_view, SPEC.camera)


def features() -> list[Feature]:
    """What `extract_features` would give of the posts that each frame shows."""
    found: list[Feature] = []
    for frame, pose in enumerate(path().world_from_rig):
        for instance, post in enumerate(POSTS):
            pixels = pixels_of(post, pose)
            if ((pixels > 0) & (pixels < [SPEC.width, SPEC.height])).all():
                ends = zip(("foot", "top"), pixels, strict=True)
                found += [
                    Feature(frame, SPEC.name, "pillar", part, instance, pixel[None], np.eye(2)[None])
                    for part, pixel in ends
                ]
    return found


def mapped(plugin: Pillars) -> tuple[list[Structure], Solution]:
    """Mapped without a path: from the first guess of constant speed, and the camera's height."""
    attitudes = path().world_from_rig[:, :3, :3]
    tracks = plugin.track(features(), FACTS, attitudes, None)
    guess = published_start(FACTS, attitudes, length_m=7.0, height_m=1.4, distance_m=2.0)
    constraints = plugin.constrain(tracks, FACTS, guess, KeySpace(plugin.name))
    solution = solve(
        merge(camera_priors(FACTS, guess, References(camera_heights=(CameraHeight(1.4, 0.01),))), constraints)
    )
    return plugin.describe(tracks, solution.landmarks_of(plugin.name), solution), solution


def test_the_network_sees_what_is_magenta(plugin: Pillars) -> None:
    image = np.full((SPEC.height, SPEC.width, 3), 110, np.uint8)
    image[100:300, 200:220] = (230, 20, 200)
    probability = Segmenter(plugin.model).probabilities(image)[1]
    assert np.array_equal(probability > 0.5, image[..., 0] == 230)


def test_ends_of_a_mask_are_foot_and_top(plugin: Pillars) -> None:
    mask = np.zeros((SPEC.height, SPEC.width), np.bool_)
    mask[100:301, 200:221] = True
    view = View(SPEC, 7, 0.5, np.zeros((SPEC.height, SPEC.width, 3), np.uint8))
    found = plugin.extract_features(view, [Detection("pillar", 0.9, mask, mask.astype(np.float32))])
    np.testing.assert_allclose(np.concatenate([one.pixels for one in found]), [[210, 300.5], [210, 99.5]])


def test_sightings_are_sorted_without_a_path(plugin: Pillars) -> None:
    tracks = plugin.track(features(), FACTS, path().world_from_rig[:, :3, :3], None)
    assert [track.name for track in tracks] == [f"pillar {n} / {part}" for n in range(1, 8) for part in ("foot", "top")]
    for track in tracks:
        post = POSTS[int(track.place["pillar"]) - 1, int(track.place["part"] == "top")]
        poses = path().world_from_rig[track.frames]
        np.testing.assert_allclose(track.pixels, [pixels_of(post[None], pose)[0] for pose in poses])


def test_where_nothing_is_seen_it_says_so(plugin: Pillars) -> None:
    with pytest.raises(StructureError, match="nothing was seen"):
        plugin.track([], FACTS, path().world_from_rig[:, :3, :3], None)


def test_they_and_the_camera_are_where_they_were(plugin: Pillars) -> None:
    structures, solution = mapped(plugin)
    assert [own.id for own in structures] == [f"pillar {number}" for number in range(1, 8)]
    np.testing.assert_allclose([own.vertices for own in structures], POSTS, atol=0.03)
    np.testing.assert_allclose(solution.trajectory.world_from_rig[:, :3, 3], path().world_from_rig[:, :3, 3], atol=0.03)
    assert all(isinstance(own.attributes["height_m"], Measured) for own in structures)


def test_scores_and_drawings_tell_what_is_off_and_what_is_missing(plugin: Pillars) -> None:
    survey = {"pillars": (POSTS + np.array([0.1, 0, 0])).tolist()}
    (first, *_), _ = mapped(plugin)
    score = plugin.evaluate([first], survey)
    assert score.apart["pillars"].missing == 6
    assert score.deviations["pillar 1"] == pytest.approx(0.1, abs=0.01)
    assert [one.role for one in plugin.draw([first], survey, score.deviations)] == ["survey"] * 7 + ["off"]
    assert plugin.evaluate([first], {}).apart == {}


def test_rows_share_their_feet(plugin: Pillars) -> None:
    (first, *_), _ = mapped(plugin)
    np.testing.assert_allclose(plugin.cross_row_landmarks([first])[0].place, POSTS[0, 0], atol=0.03)


def test_the_simulator_builds_them_and_surveys_their_fronts() -> None:
    site = Site(Hall(), Goods(), Look(), {"A": RowFrame(np.eye(3), np.array([1.0, 0.0, 0.0]), True)})
    parts = PillarsLab().scene({"stands": [{"x": 1.0, "z": 0.0, "height": 2.6}]}, site)
    assert len(parts.boxes) == 1
    np.testing.assert_allclose(parts.survey["A"]["pillars"], POSTS[:1])
    assert PillarsLab().random_section(np.random.default_rng(0), site).section["stands"]
