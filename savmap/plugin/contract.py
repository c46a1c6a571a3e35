"""Contract tests: what the engine relies on, tried on a plugin's class with random masks and in a small made-up
place."""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from savmap.errors import PluginFailedError, SavmapError
from savmap.files.serialization import packed
from savmap.geometry.pinhole import project
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.plugin.protocol import Plugin, class_faults
from savmap.types import (
    Detection,
    Feature,
    Floats,
    FrameTable,
    Panorama,
    RowFacts,
    Structure,
    Trajectory,
    View,
    ViewPlan,
    ViewSpec,
)

if TYPE_CHECKING:
    from savmap.vision.view_planning import PassPreview

SPEC = ViewSpec("contract", yaw_deg=0.0, hfov_deg=110.0)
FRAMES = 12
HEIGHT_M, DISTANCE_M, CEILING_M = 1.4, 2.4, 4.0
POST_M, STRIP_M, SLAB_M = (0.1, 2.2, 0.1), (1.2, 0.06, 0.12), (1.0, 0.02, 0.3)


def check_plugin(plugin_class: type[Plugin], require_model: bool = True) -> None:
    """Raise AssertionError with every clause of the contract that the plugin's class breaks.

    Each required hook is asked: `render_views` with and without detections, `extract_features` with none and with masks
    of any shape, `track` without features, and, where `track` takes the objects of a made-up place for its own,
    `constrain`, the solve, `describe` and the hooks after it. require_model: whether the network's file must be there
    (a plugin under construction may lack it).
    """
    faults = list(class_faults(plugin_class))
    if not faults:
        declared: Any = plugin_class
        plugin = loaded_plugin(declared.name, plugin_class, declared.Config())
        clauses = CLAUSES if plugin.has("find") else (*CLAUSES, *SINGLE_VIEWS)
        faults += [fault for clause in clauses for fault in clause(plugin)]
        if require_model:
            faults += _network_faults(plugin)
    if faults:
        raise AssertionError("the plugin breaks its contract: " + "; ".join(dict.fromkeys(faults)))


def _views_are_chosen(plugin: LoadedPlugin) -> Iterator[str]:
    """Views are chosen, or refused in the plugin's own words, whatever the network gives and whether the attitude is
    known."""
    predictors: tuple[Callable[[View], list[Detection]], ...] = (lambda _: [], _predictor(plugin))
    for attitude in (None, _path().world_from_rig[0, :3, :3]):
        for predict in predictors:
            yield from _failures(lambda: plugin.render_views(_preview(), predict, None, {}, attitude))  # noqa: B023


def _nothing_gives_no_features(plugin: LoadedPlugin) -> Iterator[str]:
    """A view without detections gives no features."""
    yield from _untrue(
        lambda: plugin.extract_features(_view(SPEC, 7), [], None) == [], "extract_features([]) must give []"
    )


def _features_fit(plugin: LoadedPlugin) -> Iterator[str]:
    """Whatever a mask looks like, features are of its frame and view and of a class of the plugin, and the same ones
    when it is asked again."""
    answers: list[list[Feature]] = []
    for seed in (*range(4), *range(4)):
        detections = [_random_detection(label, seed) for label in plugin.classes]
        try:
            answers.append(plugin.extract_features(_view(SPEC, 7), detections, _panorama(7) if seed % 2 else None))
        except SavmapError as error:
            yield f"extract_features raised on a mask: {error}"
            return
    if any(feature.label not in plugin.classes for features in answers for feature in features):
        yield "features must carry a class of the plugin"
    if packed(answers[:4]) != packed(answers[4:]):
        yield "extract_features must give the same for the same view, whatever it was asked before"


def _nothing_gives_no_tracks(plugin: LoadedPlugin) -> Iterator[str]:
    """Without features, tracking gives nothing or says so with a SavmapError of its own."""
    start = _path() if plugin.needs_path else None
    yield from _untrue(
        lambda: plugin.track([], _facts(SPEC), _path().world_from_rig[:, :3, :3], start) == [],
        "track([]) must give no tracks",
    )


def _a_place_is_mapped(plugin: LoadedPlugin) -> Iterator[str]:
    """Posts, strips on the ceiling or slabs on the floor, whatever the plugin's views show, from features to
    structures."""
    from savmap.graph import (  # with its own weight; only where it is needed
        camera_priors,
        check_jacobians,
        merge,
        solve,
    )

    spec, path = _spec(plugin), _path()
    facts = _facts(spec)
    try:
        features: list[Feature] = []
        for frame in range(FRAMES):
            detections = _place_detections(plugin.classes, spec, frame)
            features += plugin.extract_features(_view(spec, frame), detections, None)
        tracks = plugin.track(features, facts, path.world_from_rig[:, :3, :3], path)
        structures: list[Structure] = []
        if tracks:
            constraints = plugin.constrain(tracks, facts, path)
            yield from check_jacobians(constraints, path)
            held = merge(camera_priors(facts, path, fixed=path), constraints)
            structures = plugin.describe(tracks, facts, solve(held))
        related = plugin.relate(structures, {})
        score = plugin.evaluate(related, {})
        plugin.draw(related, None, score.deviations)
        plugin.openings(related)
        limits = plugin.limits({}, "contract")
        plugin.inspect(related, {plugin.name: plugin.places(related, None)}, None, limits, None, {}, None)
        plugin.survey_entry(related)
        plugin.cross_row_landmarks(related)
    except PluginFailedError as error:
        yield str(error)
    except SavmapError:
        return


def _network_faults(plugin: LoadedPlugin) -> list[str]:
    from savmap.vision.networks.segmenter import Segmenter  # with its own weight; only where there is a network

    try:
        segmenter = Segmenter(plugin.model)
    except SavmapError as error:
        return [f"its network cannot be used: {error}"]
    missing = [name for name in plugin.classes if name not in segmenter.classes]
    detections = plugin.detect(_view(SPEC, 7), segmenter)
    wrong = [detection.label for detection in detections if detection.label not in segmenter.classes]
    return [f"its network gives no `{name}`" for name in missing] + [
        f"it detects `{name}`, which is no class" for name in wrong
    ]


CLAUSES: tuple[Callable[[LoadedPlugin], Iterator[str]], ...] = (_views_are_chosen, _nothing_gives_no_tracks)
SINGLE_VIEWS = (_nothing_gives_no_features, _features_fit, _a_place_is_mapped)
"""Of plugins that extract features of single views: those that find in all of them measure what was found."""


def _failures(call: Callable[[], object]) -> Iterator[str]:
    """How a hook failed; nothing where it answered, or refused in the plugin's own words."""
    try:
        call()
    except PluginFailedError as error:
        yield str(error)
    except SavmapError:
        return


def _untrue(holds: Callable[[], bool], otherwise: str) -> Iterator[str]:
    """The clause that does not hold, or how a hook failed."""
    answers: list[bool] = []
    yield from _failures(lambda: answers.append(holds()))
    if answers == [False]:
        yield otherwise


def _path() -> Trajectory:
    """The camera goes 3 m along x, and looks straight at the face."""
    from savmap.vision.view_planning import LEVEL  # as above

    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, :3, :3] = LEVEL
    poses[:, :3, 3] = np.stack([np.linspace(0, 3, FRAMES), *np.tile([[HEIGHT_M], [DISTANCE_M]], FRAMES)], axis=1)
    return Trajectory(np.arange(FRAMES), poses)


def _facts(spec: ViewSpec) -> RowFacts:
    table = FrameTable(np.arange(FRAMES) / 5.0, ("pass 1",) * FRAMES)
    return RowFacts("contract", table, {spec.name: spec}, {"pass 1": 1})


def _spec(plugin: LoadedPlugin) -> ViewSpec:
    """The first view that the plugin chooses in the made-up place, by the name that the engine gives it."""
    plans: list[ViewPlan] = []
    attitude = _path().world_from_rig[0, :3, :3]
    list(
        _failures(lambda: plans.append(plugin.render_views(_preview(), _predictor(plugin), None, {}, attitude))),
    )
    views = [spec for plan in plans for spec in plan.views] or [SPEC]
    angles = (views[0].yaw_deg, views[0].pitch_deg, views[0].roll_deg, views[0].hfov_deg)
    return ViewSpec(f"pass 1 / {views[0].name}", *angles, views[0].width, views[0].height)


def _preview() -> "PassPreview":
    from savmap.vision.view_planning import LEVEL, PassPreview  # as above
    from savmap.vision.views import Renderer

    keys = tuple(_panorama(frame) for frame in (0, FRAMES // 2, FRAMES - 1))
    return PassPreview(keys, (), Renderer(), LEVEL.T)


def _predictor(plugin: LoadedPlugin) -> Callable[[View], list[Detection]]:
    return lambda view: _place_detections(plugin.classes, view.spec, view.frame)


def _place_detections(classes: Sequence[str], spec: ViewSpec, frame: int) -> list[Detection]:
    """What a perfect network would give of the place, for each class alike."""
    pose = _path().world_from_rig[frame]
    masks = [mask for box in _boxes(spec) if (mask := _mask(box, spec, pose)).any()]
    return [Detection(label, 0.9, mask, mask.astype(np.float32)) for label in classes for mask in masks]


def _boxes(spec: ViewSpec) -> list[Floats]:
    """Corners (8, 3) m of three boxes: on the ceiling for a view upwards, lying on the floor for one downwards, else
    standing there."""
    up = float((_path().world_from_rig[0, :3, :3] @ spec.rig_from_view)[1, 2])
    size, y, z = (STRIP_M, CEILING_M, DISTANCE_M) if up > 0.7 else (SLAB_M, SLAB_M[1] / 2, 0.8)
    if abs(up) <= 0.7:
        size, y, z = POST_M, POST_M[1] / 2, 0.3
    halves = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    return [np.array([x, y, z]) + halves * size for x in (0.0, 1.6, 3.2)]


def _mask(corners: Floats, spec: ViewSpec, pose: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Pixels (h, w) of the hull of a box; none where it is not wholly in front of the camera."""
    in_view = (corners - pose[:3, 3]) @ pose[:3, :3] @ spec.rig_from_view
    canvas = np.zeros((spec.height, spec.width), np.uint8)
    if (in_view[:, 2] > 0.2).all():
        hull = cv2.convexHull(np.round(project(in_view, spec.camera)).astype(np.int32))
        cv2.fillConvexPoly(canvas, hull, 1)
    return canvas.astype(np.bool_)


def _view(spec: ViewSpec, frame: int) -> View:
    image = np.random.default_rng(0).integers(0, 255, (spec.height, spec.width, 3)).astype(np.uint8)
    return View(spec, frame, frame / 5.0, image)


def _panorama(frame: int) -> Panorama:
    image = np.random.default_rng(1).integers(0, 255, (128, 256, 3)).astype(np.uint8)
    return Panorama(frame, frame / 5.0, image)


def _random_detection(label: str, seed: int) -> Detection:
    rng = np.random.default_rng(seed)
    mask = np.zeros((SPEC.height, SPEC.width), dtype=bool)
    top, left = rng.integers(0, 240), rng.integers(0, 320)
    mask[top : top + rng.integers(1, 240), left : left + rng.integers(1, 320)] = True
    return Detection(label, 0.9, mask, mask.astype(np.float32))
