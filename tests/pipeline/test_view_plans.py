"""Which plugin is asked first for its views, and what those after it are told."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from savmap.pipeline import view_plans
from savmap.pipeline.view_plans import plan_shown
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.site.model import Pass
from savmap.types import ViewPlan
from savmap.vision.view_planning import PassPreview
from savmap.vision.views import Renderer

from ..plugin.made_up_plugin import plugin_class


class Config(BaseModel):
    """No settings."""


@pytest.mark.parametrize("face_comes_first", [True, False])
def test_attitude_of_the_face_is_told_to_other_plugins_in_any_order(
    face_comes_first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    turned, told = np.diag([1.0, -1.0, -1.0]), list[Any]()

    def plan_views(plugin: LoadedPlugin, row_pass: object, pool: object, preview: object, attitude: object) -> ViewPlan:
        told.append(attitude)
        return ViewPlan((), turned if plugin.name == "one" else None)

    monkeypatch.setattr(view_plans, "plan_views", plan_views)
    monkeypatch.setattr(view_plans, "SegmenterPool", lambda plugins: None)
    faces = [loaded_plugin("one", plugin_class(), Config())]
    plugins = [*faces, loaded_plugin("two", plugin_class(needs_path=True), Config())]
    plugins = plugins if face_comes_first else plugins[::-1]
    plan = plan_shown("pass 1", Pass(video=Path("a.mp4")), plugins, PassPreview((), (), Renderer(), np.eye(3)), None)
    assert told[0] is None
    assert np.array_equal(told[1], turned)
    assert plan.locators() == {"one"}
    assert [*plan.plans] == [plugin.name for plugin in plugins]
