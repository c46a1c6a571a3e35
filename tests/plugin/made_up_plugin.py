"""A plugin's class for tests, complete, with the hooks that a test gives it; and for each hook a call and a sound
answer."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from savmap.graph import Constraints, KeySpace, image_measurements
from savmap.plugin.hookspecs import REQUIRED, hookimpl
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.types import (
    CrossRowLandmark,
    Detection,
    Drawing,
    Feature,
    Finding,
    FlatParts,
    FoundObject,
    FrameTable,
    JointCovariance,
    MapWarning,
    Panorama,
    PlanePatch,
    RowFacts,
    RowInspection,
    Score,
    Structure,
    SurveyEntry,
    Track,
    Trajectory,
    View,
    ViewPlan,
    ViewSpec,
)

SPEC = ViewSpec("view", 0.0, width=16, height=12)
VIEW = View(SPEC, 3, 0.1, np.zeros((12, 16, 3), np.uint8))
FACTS = RowFacts("A", FrameTable(np.arange(5.0), ("pass 1",) * 5), {"view": SPEC}, {"pass 1": 1})
PATH = Trajectory(np.arange(5), np.tile(np.eye(4), (5, 1, 1)))
PANORAMA = Panorama(3, 0.1, np.zeros((8, 16, 3), np.uint8))
MASK = np.ones((12, 16), np.bool_)
DETECTION = Detection("thing", 0.9, MASK, MASK.astype(np.float32))
FEATURE = Feature(3, "view", "thing", "foot", 0, np.ones((1, 2)), np.eye(2)[None])
TRACK = Track("thing 1", "thing", {"at_m": 1.25}, np.zeros(1, np.int64), ("view",), np.ones((1, 2)), np.eye(2)[None])
NO_EDGES = np.empty((0, 2), np.int64)
THING = Structure("thing 1", "thing", np.zeros((1, 3)), np.eye(3)[None], ("foot",), NO_EDGES)
LANDMARK = CrossRowLandmark("thing 1", "thing", np.zeros(3), np.eye(3))
FRONT = PlanePatch("front", np.zeros(3), np.eye(3)[0], np.eye(3)[1], np.ones(2), 0.1)
FLAT = FlatParts("thing 1", "z", (FRONT,))
KEYS = KeySpace("made-up").keys(["thing 1"])
POINTS = {"thing 1": np.zeros(3)}
CONSTRAINTS = Constraints("made-up", KEYS, image_measurements([TRACK], KEYS, FACTS.views), (), POINTS)


class Solved:
    """A solution of no landmarks."""

    def landmarks_of(self, plugin: str) -> dict[str, Any]:
        return {}


SOLVED: Any = Solved()
CALLS: dict[str, Callable[[Any], Any]] = {
    "render_views": lambda plugin: plugin.render_views(None, list, "left", {}, None),
    "detect": lambda plugin: plugin.detect(VIEW, None),
    "extract_features": lambda plugin: plugin.extract_features(VIEW, [], None),
    "track": lambda plugin: plugin.track([], FACTS, np.tile(np.eye(3), (5, 1, 1)), PATH),
    "find": lambda plugin: plugin.find(None, PATH, POINTS, FACTS, 0.0),
    "measure": lambda plugin: plugin.measure([], SPEC, 3, np.eye(4), np.zeros((1, 6, 8), np.float32), PANORAMA),
    "planes": lambda plugin: plugin.planes(POINTS),
    "flat_parts": lambda plugin: plugin.flat_parts(POINTS),
    "constrain": lambda plugin: plugin.constrain([TRACK], FACTS, PATH),
    "describe": lambda plugin: plugin.describe([TRACK], FACTS, SOLVED),
    "relate": lambda plugin: plugin.relate([THING], {}),
    "warnings": lambda plugin: plugin.warnings([THING]),
    "openings": lambda plugin: plugin.openings([THING]),
    "places": lambda plugin: plugin.places([THING], JointCovariance({}, np.eye(1))),
    "inspect": lambda plugin: plugin.inspect([THING], {}, None, plugin.limits({}, "test"), None, {}, None),
    "cross_row_landmarks": lambda plugin: plugin.cross_row_landmarks([THING]),
    "evaluate": lambda plugin: plugin.evaluate([THING], {}),
    "survey_entry": lambda plugin: plugin.survey_entry([THING]),
    "draw": lambda plugin: plugin.draw([THING], None, {}),
    "exporters": lambda plugin: plugin.exporters(),
}
ANSWERS: dict[str, Any] = {
    "render_views": ViewPlan((SPEC,), np.eye(3), -1),
    "detect": [DETECTION],
    "extract_features": [FEATURE],
    "track": [TRACK],
    "find": [FoundObject("thing 1", "thing", np.eye(3), 0.75)],
    "measure": [FEATURE],
    "planes": [FRONT],
    "flat_parts": [FLAT, FlatParts("thing 1", "x", ())],
    "constrain": CONSTRAINTS,
    "describe": [THING],
    "relate": [THING],
    "warnings": [MapWarning("uncertain-element", ("thing 1",))],
    "openings": [THING],
    "places": [THING],
    "inspect": RowInspection((Finding("lean", "thing 1 leans", "amber", ("thing 1",)),)),
    "cross_row_landmarks": [LANDMARK],
    "evaluate": Score(missing={"thing": 1}, deviations={"thing 1": float("inf")}),
    "survey_entry": SurveyEntry({"things": [[0.0, 1.0, 2.0]]}, {"thing 1": "it is odd"}),
    "draw": (Drawing("point", np.zeros((1, 3)), "mapped", "fixture", "things"),),
    "exporters": {"made": lambda site_map, path: None},
}


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid")
    threshold: float = 0.25


def plugin_class(leave_out: tuple[str, ...] = (), **members: Any) -> type:
    """The class of a plugin "made-up" with the given hooks and attributes; a required hook that is not given
    answers None."""
    attributes = {
        "name": "made-up",
        "classes": ("thing",),
        "model": Path("none.onnx"),
        "Config": Config,
        "__init__": lambda self, config: None,
    }
    required = (*REQUIRED, "measure") if "find" in members else REQUIRED
    hooks = {hook: lambda self: None for hook in required if hook not in leave_out}
    given = {name: value for name, value in members.items() if callable(value) and not isinstance(value, type)}
    rest = {name: value for name, value in members.items() if name not in given}
    marked = {name: hookimpl(function) for name, function in {**hooks, **given}.items()}
    return type("MadeUp", (), {**attributes, **marked, **rest})


def loaded(**members: Any) -> LoadedPlugin:
    """That plugin at work."""
    return loaded_plugin("made-up", plugin_class(**members), Config())
