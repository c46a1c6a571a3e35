"""Which views of a pass are looked at: every plugin is asked, those first that find the face."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from savmap.pipeline import view_plans
from savmap.pipeline.view_plans import plan_pass
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.site.model import Pass
from savmap.types import ViewPlan
from savmap.vision.view_planning import PassPreview
from savmap.vision.views import Renderer

from ..plugin.made_up_plugin import plugin_class

NO_NETWORKS: Any = None


class Config(BaseModel):
    pass


@pytest.mark.parametrize("face_comes_first", [True, False])
def test_attitude_of_the_face_is_told_to_other_plugins_in_any_order(
    face_comes_first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    turned, told = np.diag([1.0, -1.0, -1.0]), list[Any]()

    def plan_views(plugin: LoadedPlugin, row_pass: object, pool: object, preview: object, attitude: object) -> ViewPlan:
        told.append(attitude)
        return ViewPlan((), turned if plugin.name == "face" else None)

    monkeypatch.setattr(view_plans, "plan_views", plan_views)
    plugins = [
        loaded_plugin("face", plugin_class(), Config()),
        loaded_plugin("ceiling", plugin_class(needs_path=True), Config()),
    ]
    plugins = plugins if face_comes_first else plugins[::-1]
    preview = PassPreview((), (), Renderer(), np.eye(3))
    plan = plan_pass("pass 1", Pass(video=Path("a.mp4")), plugins, NO_NETWORKS, preview, None)
    assert told[0] is None
    assert np.array_equal(told[1], turned)
    assert plan.locators() == {"face"}
    assert [*plan.plans] == [plugin.name for plugin in plugins]
