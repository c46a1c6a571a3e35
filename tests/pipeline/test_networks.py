"""Which network looks: one that sees clearly more takes the place of the plugin's own, and one that the user names stays."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict

from savmap.pipeline import networks
from savmap.pipeline.networks import further_models, sees_more, with_best_network
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.types import Floats

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
        ((0.026, 0.053), (0.02, 0.05), True),
        ((0.013, 0.022), (0.004, 0.019), True),
        ((0.05, 0.02), (0.02, 0.05), False),
        ((0.0, 0.0), (0.0, 0.0), False),
    ],
)
def test_more_is_clearly_more_and_not_less_of_a_class(shares: Any, others: Any, more: bool) -> None:
    assert sees_more(np.array(shares), np.array(others)) is more


@pytest.mark.parametrize(("seen_by_other", "chosen"), [(0.04, OTHER), (0.02, OWN)])
def test_network_that_sees_more_is_taken(seen_by_other: float, chosen: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def seen(plugin: LoadedPlugin, views: object) -> Floats:
        return np.array([seen_by_other if plugin.model == OTHER else 0.02])

    monkeypatch.setattr(networks, "seen", seen)
    monkeypatch.setattr(networks, "few_views", lambda specs, preview: ["a view"])
    preview: Any = None
    assert with_best_network(plugin_with(), [], preview).model == chosen


def test_plugin_that_wants_no_views_keeps_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(networks, "few_views", lambda specs, preview: [])
    preview: Any = None
    assert with_best_network(plugin_with(), [], preview).network is None


def test_network_that_the_user_names_stays() -> None:
    assert further_models(plugin_with()) == (OTHER,)
    assert further_models(plugin_with(Path("mine.onnx"))) == ()
