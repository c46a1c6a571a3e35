"""Which network looks: one that sees clearly more takes the place of the plugin's own, and one that the user names stays."""

from collections.abc import Container
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict

from savmap.errors import StructureError
from savmap.pipeline import networks
from savmap.pipeline.networks import (
    Candidate,
    further_models,
    network_lines,
    sees_more,
    with_best_network,
    with_best_networks,
)
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.site.model import Pass
from savmap.types import ViewPlan, ViewSpec
from savmap.vision.view_planning import PassPreview
from savmap.vision.views import Renderer

from ..plugin.made_up_plugin import plugin_class

OWN, OTHER = Path("own.onnx"), Path("other.onnx")


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid")
    model: Path | None = None


def plugin_with(model: Path | None = None) -> LoadedPlugin:
    known = plugin_class(model=OWN, further_models=(OTHER,))
    return loaded_plugin("one", known, Config(model=model))


@pytest.mark.parametrize(
    ("shares", "others", "more"),
    [
        ((0.02, 0.05), (0.02, 0.05), False),
        ((0.0208, 0.052), (0.02, 0.05), False),
        ((0.022, 0.06), (0.02, 0.05), False),
        ((0.03, 0.058), (0.02, 0.05), True),
        ((0.013, 0.022), (0.004, 0.019), True),
        ((0.05, 0.02), (0.02, 0.05), False),
        ((0.0, 0.0), (0.0, 0.0), False),
    ],
)
def test_more_is_clearly_more_and_not_less_of_a_class(shares: Any, others: Any, more: bool) -> None:
    assert sees_more(np.array(shares), np.array(others)) is more


class Planner:
    """Plans one view with any network but those that miss the structure, and remembers which were asked."""

    def __init__(self, missing: Container[Path] = ()) -> None:
        self.missing, self.asked = missing, list[Path]()

    def __call__(self, candidate: Candidate) -> ViewPlan:
        model = candidate[0].model
        self.asked.append(model)
        if model in self.missing:
            raise StructureError(f"nothing is seen with {model}")
        return ViewPlan((ViewSpec("face", 0.0),), notes=(model.name,))


@pytest.fixture
def shares(monkeypatch: pytest.MonkeyPatch) -> dict[Path, float]:
    """What each network sees of the structure."""
    seen = {OWN: 0.02, OTHER: 0.02}
    monkeypatch.setattr(networks, "SegmenterPool", lambda plugins: None)
    monkeypatch.setattr(networks, "seen", lambda candidate, views: np.array([seen[candidate[0].model]]))
    return seen


PREVIEW: Any = SimpleNamespace(views=lambda spec: [spec])


def test_own_network_is_planned_with_once(shares: dict[Path, float]) -> None:
    plan = Planner()
    best, planned = with_best_network(plugin_with(), PREVIEW, plan)
    assert (best.network, planned.notes, plan.asked) == (None, ("own.onnx",), [OWN])


def test_network_that_sees_more_plans_its_own_views(shares: dict[Path, float]) -> None:
    shares[OTHER] = 0.04
    plan = Planner()
    best, planned = with_best_network(plugin_with(), PREVIEW, plan)
    assert (best.network, planned.notes, plan.asked) == (OTHER, ("other.onnx",), [OWN, OTHER])
    assert network_lines([best]) == ["`one` looks with other.onnx, which sees more here"]


def test_network_that_finds_the_structure_is_taken(shares: dict[Path, float]) -> None:
    plan = Planner(missing=[OWN])
    best, planned = with_best_network(plugin_with(), PREVIEW, plan)
    assert (best.network, planned.notes, plan.asked) == (OTHER, ("other.onnx",), [OWN, OTHER])


def test_where_none_finds_it_the_own_network_says_why(shares: dict[Path, float]) -> None:
    with pytest.raises(StructureError, match=r"seen with own\.onnx"):
        with_best_network(plugin_with(), PREVIEW, Planner(missing=[OWN, OTHER]))


def test_plugin_that_wants_no_views_keeps_its_own(shares: dict[Path, float]) -> None:
    shares[OTHER] = 0.04
    best, planned = with_best_network(plugin_with(), PREVIEW, lambda candidate: ViewPlan(()))
    assert (best.network, planned.views) == (None, ())


@pytest.mark.parametrize("face_comes_first", [True, False])
def test_attitude_of_the_face_is_told_to_other_plugins_in_any_order(
    face_comes_first: bool, monkeypatch: pytest.MonkeyPatch, shares: dict[Path, float]
) -> None:
    turned, told = np.diag([1.0, -1.0, -1.0]), list[Any]()

    def plan_views(plugin: LoadedPlugin, row_pass: object, pool: object, preview: object, attitude: object) -> ViewPlan:
        told.append(attitude)
        return ViewPlan((), turned if plugin.name == "one" else None)

    monkeypatch.setattr(networks, "plan_views", plan_views)
    plugins = [plugin_with(), loaded_plugin("two", plugin_class(needs_path=True), Config())]
    plugins = plugins if face_comes_first else plugins[::-1]
    preview = PassPreview((), (), Renderer(), np.eye(3))
    chosen, plan = with_best_networks("pass 1", Pass(video=Path("a.mp4")), plugins, preview, None)
    assert chosen == plugins
    assert told[0] is None
    assert np.array_equal(told[1], turned)
    assert plan.locators() == {"one"}
    assert [*plan.plans] == [plugin.name for plugin in plugins]


def test_network_that_the_user_names_stays() -> None:
    assert further_models(plugin_with()) == (OTHER,)
    assert further_models(plugin_with(Path("mine.onnx"))) == ()
