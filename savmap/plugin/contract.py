"""Contract tests: what the engine relies on, tried on a plugin's class with made-up pictures."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from savmap.errors import SavmapError
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.types import Detection, Feature, FrameTable, Panorama, RowFacts, View, ViewSpec

SPEC = ViewSpec("contract", yaw_deg=0.0, hfov_deg=90.0, width=160, height=120)


def check_plugin(plugin_class: Any, require_model: bool = True) -> None:
    """Raise AssertionError with every clause of the contract that the plugin's class breaks.

    require_model: whether the network's file must be there already (a plugin under construction may lack it).
    """
    problems = list(_declaration(plugin_class))
    if not problems:
        room = loaded_plugin(plugin_class.name, plugin_class, plugin_class.Config())
        problems += [problem for clause in CLAUSES for problem in clause(room)]
        if require_model:
            problems += _network(room)
    if problems:
        raise AssertionError("the plugin breaks its contract: " + "; ".join(problems))


def _declaration(plugin_class: Any) -> Iterator[str]:
    if not isinstance(getattr(plugin_class, "name", None), str):
        yield "`name` must be a string"
    classes = getattr(plugin_class, "classes", None)
    if not (isinstance(classes, tuple) and classes and all(isinstance(one, str) for one in classes)):
        yield "`classes` must be a tuple of names"
    if not isinstance(getattr(plugin_class, "model", None), Path):
        yield "`model` must be a Path"
    config = getattr(plugin_class, "Config", None)
    if not (isinstance(config, type) and issubclass(config, BaseModel)):
        yield "`Config` must be a pydantic model"
    elif config.model_config.get("extra") != "forbid":
        yield '`Config` must refuse unknown keys (extra="forbid")'
    elif any(field.is_required() for field in config.model_fields.values()):
        yield "every setting of `Config` needs a default"
    elif not set(getattr(plugin_class, "scale_settings", ())) <= set(config.model_fields):
        yield "`scale_settings` must name settings of `Config`"


def _sees_nothing(room: LoadedPlugin) -> Iterator[str]:
    """A view without detections gives no features."""
    yield from _problem(lambda: room.extract(view=_view(), detections=[]) == [], "extract_features([]) must give []")


def _features_fit(room: LoadedPlugin) -> Iterator[str]:
    """Whatever a mask looks like, features are of this frame and view and of a class of the plugin."""
    features: list[Feature] = []
    for seed in range(4):
        detections = [_detection(label, seed) for label in room.classes]
        try:
            features += room.extract(_view(), detections, _panorama() if seed % 2 else None)
        except SavmapError as error:
            yield f"extract_features raised on a mask: {error}"
            return
    if any(one.frame != 7 or one.view != SPEC.name or one.label not in room.classes for one in features):
        yield "features must carry their view's frame and name, and a class of the plugin"


def _tracks_nothing(room: LoadedPlugin) -> Iterator[str]:
    """Without features, tracking gives nothing or says so with a SavmapError of its own."""
    facts = RowFacts("contract", FrameTable(np.arange(5.0), ("pass 1",) * 5), {SPEC.name: SPEC}, {"pass 1": 0})
    try:
        tracks = room.track(features=[], facts=facts, attitudes=np.tile(np.eye(3), (5, 1, 1)), start=None)
    except SavmapError as error:
        if "failed in" in str(error):
            yield f"track([]) must give [] or raise a SavmapError: {error}"
        return
    if tracks:
        yield "track([]) must give no tracks"


def _shares_nothing(room: LoadedPlugin) -> Iterator[str]:
    """Without structures, nothing is shared with other rows."""
    yield from _problem(lambda: room.shared([]) == [], "shared([]) must give []")


def _network(room: LoadedPlugin) -> list[str]:
    from savmap.vision.networks.segmenter import Segmenter

    try:
        segmenter = Segmenter(room.model)
    except SavmapError as error:
        return [f"its network cannot be used: {error}"]
    missing = [name for name in room.classes if name not in segmenter.classes]
    detections = room.detect(view=_view(), segmenter=segmenter)
    wrong = [one.label for one in detections if one.label not in segmenter.classes]
    return [f"its network gives no `{name}`" for name in missing] + [
        f"it detects `{name}`, which is no class" for name in wrong
    ]


CLAUSES: tuple[Callable[[LoadedPlugin], Iterator[str]], ...] = (
    _sees_nothing,
    _features_fit,
    _tracks_nothing,
    _shares_nothing,
)


def _problem(holds: Callable[[], bool], otherwise: str) -> Iterator[str]:
    try:
        if not holds():
            yield otherwise
    except SavmapError as error:
        yield f"{otherwise}: {error}"


def _view() -> View:
    image = np.random.default_rng(0).integers(0, 255, (SPEC.height, SPEC.width, 3)).astype(np.uint8)
    return View(SPEC, 7, 0.5, image)


def _panorama() -> Panorama:
    image = np.random.default_rng(1).integers(0, 255, (128, 256, 3)).astype(np.uint8)
    return Panorama(7, 0.5, image)


def _detection(label: str, seed: int) -> Detection:
    rng = np.random.default_rng(seed)
    mask = np.zeros((SPEC.height, SPEC.width), dtype=bool)
    top, left = rng.integers(0, 60), rng.integers(0, 80)
    mask[top : top + rng.integers(1, 60), left : left + rng.integers(1, 80)] = True
    return Detection(label, 0.9, mask, mask.astype(np.float32))
