"""A plugin's class for tests, complete, with the hooks that a test gives it."""

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from savmap.plugin.hookspecs import REQUIRED, hookimpl
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.types import FrameTable, RowFacts, Trajectory, View, ViewSpec

SPEC = ViewSpec("view", 0.0, width=16, height=12)
VIEW = View(SPEC, 3, 0.1, np.zeros((12, 16, 3), np.uint8))
FACTS = RowFacts("A", FrameTable(np.arange(5.0), ("pass 1",) * 5), {"view": SPEC}, {"pass 1": 1})
PATH = Trajectory(np.arange(5), np.tile(np.eye(4), (5, 1, 1)))


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid")
    threshold: float = 0.25


def plugin_class(leave_out: tuple[str, ...] = (), **members: Any) -> type:
    """The class of a plugin "made-up" with the given hooks and attributes; a required hook that is not given answers None."""
    attributes = {
        "name": "made-up",
        "classes": ("thing",),
        "model": Path("none.onnx"),
        "Config": Config,
        "__init__": lambda self, config: None,
    }
    hooks = {hook: lambda self: None for hook in REQUIRED if hook not in leave_out}
    given = {name: value for name, value in members.items() if callable(value) and not isinstance(value, type)}
    rest = {name: value for name, value in members.items() if name not in given}
    marked = {name: hookimpl(function) for name, function in {**hooks, **given}.items()}
    return type("MadeUp", (), {**attributes, **marked, **rest})


def loaded(**members: Any) -> LoadedPlugin:
    """That plugin at work."""
    return loaded_plugin("made-up", plugin_class(**members), Config())
