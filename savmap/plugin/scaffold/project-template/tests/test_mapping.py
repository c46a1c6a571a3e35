"""From drawn masks to places, without a video: a camera drives past a row of pillars."""

import numpy as np
import pytest

from savmap.graph import CameraHeight, References, camera_priors, merge, published_start, solve
from savmap.lab.scenes import Exposure, Goods, Hall, RowFrame, Site
from savmap.plugin import (
    LEVEL,
    Detection,
    Feature,
    Floats,
    FrameTable,
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
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.vision.networks.segmenter import Segmenter
from savmap_pillars.lab import PillarsLab
from savmap_pillars.plugin import Pillars, Settings

SPEC = ViewSpec("pass 1 / pillars", 0.0, hfov_deg=110.0, width=640, height=480)
FRAMES = 40
PLACES = (0.0, 1.5, 2.8, 4.4, 5.6, 7.2, 8.5)
POSTS = np.array([[[x, 0.0, 0.0], [x, 2.6, 0.0]] for x in PLACES])
FACTS = RowFacts("A", FrameTable(np.arange(FRAMES) / 5.0, ("pass 1",) * FRAMES), {SPEC.name: SPEC}, {"pass 1": 1})


def opened(settings: Settings) -> LoadedPlugin:
    """The plugin as the engine asks it."""
    return loaded_plugin("pillars", Pillars, settings)


@pytest.fixture
def plugin() -> LoadedPlugin:
    return opened(Settings())


def path() -> Trajectory:
    """The camera goes along x at 1.4 m, 2.4 m before the face, now faster, now slower, and looks straight at it."""
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, :3, :3] = LEVEL
    along = np.linspace(0.0, 8.5, FRAMES) + 0.3 * np.sin(np.linspace(0, 9, FRAMES))
    poses[:, :3, 3] = np.stack([along, np.full(FRAMES, 1.4), np.full(FRAMES, 2.4)], axis=1)
    return Trajectory(np.arange(FRAMES), poses)


def pixels_of(points: Floats, pose: Floats) -> Floats:
    return project((points - pose[:3, 3]) @ pose[:3, :3] @ SPEC.rig_from_view, SPEC.camera)


def features() -> list[Feature]:
    """What `extract_features` would give of the posts that each frame shows."""
    return [
        Feature(frame, SPEC.name, "pillar", part, instance, pixel[None], np.eye(2)[None])
        for frame, pose in enumerate(path().world_from_rig)
        for instance, post in enumerate(POSTS)
        if ((pixels := pixels_of(post, pose)) > 0).all() and (pixels < [SPEC.width, SPEC.height]).all()
        for part, pixel in zip(("foot", "top"), pixels, strict=True)
    ]


def mapped(plugin: LoadedPlugin) -> list[Structure]:
    """From the path, for a plugin that needs it; else from the guess that the speed is constant, and the camera's
    height."""
    attitudes = path().world_from_rig[:, :3, :3]
    known_path = path() if plugin.needs_path else None
    tracks = plugin.track(features(), FACTS, attitudes, known_path)
    start = known_path or published_start(FACTS, attitudes, length_m=7.0, height_m=1.4, distance_m=2.0)
    references = References(camera_heights=(CameraHeight(1.4, 0.01),))
    frames = camera_priors(FACTS, start, references, fixed=known_path)
    solution = solve(merge(frames, plugin.constrain(tracks, FACTS, start)))
    np.testing.assert_allclose(solution.trajectory.world_from_rig[:, :3, 3], path().world_from_rig[:, :3, 3], atol=0.03)
    return plugin.describe(tracks, FACTS, solution)


def test_the_network_sees_what_is_magenta(plugin: LoadedPlugin) -> None:
    image = np.full((SPEC.height, SPEC.width, 3), 110, np.uint8)
    image[100:300, 200:220] = (230, 20, 200)
    probability = Segmenter(plugin.model).probabilities(image)[1]
    assert np.array_equal(probability > 0.5, image[..., 0] == 230)


def test_ends_of_a_mask_are_foot_and_top_and_cut_ones_are_left_out(plugin: LoadedPlugin) -> None:
    masks = np.zeros((2, SPEC.height, SPEC.width), np.bool_)
    masks[0, 100:301, 200:221] = masks[1, 0:200, 400:420] = True
    view = View(SPEC, 7, 0.5, np.zeros((SPEC.height, SPEC.width, 3), np.uint8))
    detections = [Detection("pillar", 0.9, mask, mask.astype(np.float32)) for mask in masks]
    points = plugin.extract_features(view, detections, None)
    assert [(point.part, point.instance, point.frame) for point in points] == [("foot", 0, 7), ("top", 0, 7)]
    np.testing.assert_allclose(np.concatenate([point.pixels for point in points]), [[210, 300.5], [210, 99.5]])


def test_where_nothing_is_seen_it_says_so(plugin: LoadedPlugin) -> None:
    with pytest.raises(StructureError, match="nothing was seen"):
        plugin.track([], FACTS, path().world_from_rig[:, :3, :3], path())


def test_they_and_the_camera_are_where_they_were(plugin: LoadedPlugin) -> None:
    structures = mapped(plugin)
    assert [structure.id for structure in structures] == [f"pillar {number}" for number in range(1, 8)]
    np.testing.assert_allclose([structure.vertices for structure in structures], POSTS, atol=0.03)
    heights = [structure.attributes["height_m"] for structure in structures]
    assert all(isinstance(height, Measured) and 0 < height.sigma < 0.1 for height in heights)


def test_a_known_height_is_used() -> None:
    """A value that the pictures do not contradict: what they do is refused."""
    structures = mapped(opened(Settings(height_m=KnownSize(value=2.604, sigma=0.0001))))
    np.testing.assert_allclose([np.ptp(structure.vertices[:, 1]) for structure in structures], 2.604, atol=0.0005)


def test_scores_drawings_and_other_rows(plugin: LoadedPlugin) -> None:
    survey = {"pillars": (POSTS + np.array([0.1, 0, 0])).tolist()}
    first = mapped(plugin)[:1]
    score = plugin.evaluate(first, survey)
    assert score.deviations["pillar 1"] == pytest.approx(0.1, abs=0.03)
    assert len(score.deviations) == 1
    assert [drawing.role for drawing in plugin.draw(first, survey, score.deviations)] == ["survey"] * 7 + ["off"]
    (foot,) = plugin.cross_row_landmarks(first)
    np.testing.assert_allclose(foot.place, POSTS[0, 0], atol=0.03)


def test_the_simulator_builds_them_and_a_random_place_has_some() -> None:
    site = Site(Hall(), Goods(), Exposure(), {"A": RowFrame(np.eye(3), np.array([1.0, 0.0, 0.0]), True)})
    parts = PillarsLab().scene({"stands": [{"x": 1.0, "z": 0.0, "height": 2.6}]}, site)
    assert len(parts.boxes) == 1
    np.testing.assert_allclose(parts.survey["A"]["pillars"], POSTS[:1])
    section = PillarsLab().random_section(np.random.default_rng(0), site).section
    assert 1 <= len(PillarsLab().scene(section, site).boxes) <= 4
