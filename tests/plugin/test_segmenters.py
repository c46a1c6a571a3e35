"""Plugins' networks: other people's names for classes, and execution providers from the site file to the session."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict

from savmap.errors import ModelError, SiteError
from savmap.files.validation import ClassNames
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.job import job_for, plugins_for
from savmap.site.overrides import overrides_of
from savmap.types import View, ViewSpec
from savmap.vision.networks import session

from ..vision.made_up_networks import SIDE, picture, yolo
from .made_up_plugin import plugin_class

LEFT, RIGHT = (16.0, 32.0, 32.0, 64.0), (48.0, 32.0, 32.0, 64.0)
SITE = "providers: {}\nplugins: {{shelves: {{}}}}\nrows: {{A: {{passes: [{{video: a.mp4}}]}}}}\n"


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid")
    model: Path | None = None
    class_names: ClassNames = {}


def plugin_with(
    path: Path, class_names: dict[Any, str], needs: str = "pillar", asked: tuple[str, ...] = ("cpu",)
) -> LoadedPlugin:
    pillars = plugin_class(classes=(needs,), model=path, Config=Config)
    return loaded_plugin(needs, pillars, Config.model_validate({"model": path, "class_names": class_names}), asked)


@pytest.fixture
def network(tmp_path: Path) -> Path:
    return yolo(tmp_path / "m.onnx", [(LEFT, (0.9, 0.1)), (RIGHT, (0.9, 0.1))], {0: "post", 1: "bar"})


def view() -> View:
    return View(ViewSpec("v", 0.0, width=SIDE, height=SIDE), 0, 0.0, picture(SIDE, SIDE, (0, SIDE)))


@pytest.mark.parametrize("key", ["post", "0", 0])
def test_a_plugin_detects_instances_of_a_network_with_names_of_its_own(network: Path, key: object) -> None:
    own = plugin_with(network, {key: "pillar"})
    segmenters = SegmenterPool([own])
    found = segmenters.detect(own, view())
    assert [one.label for one in found] == ["pillar", "pillar"]
    assert segmenters.notes == ()


def test_a_class_that_is_missing_is_told_with_those_that_there_are(network: Path) -> None:
    with pytest.raises(ModelError, match=r"does not give `pillar`, .* gives post, bar: say with `class_names`"):
        SegmenterPool([plugin_with(network, {})])


def test_plugins_with_one_file_and_one_naming_share_it(network: Path) -> None:
    names = {"post": "pillar", "bar": "rail"}
    plugins = [
        plugin_with(network, names),
        plugin_with(network, names, "rail"),
        plugin_with(network, {"post": "column"}, "column"),
    ]
    segmenters = SegmenterPool(plugins)
    pillar, rail, column = map(segmenters.network, plugins)
    assert pillar is rail
    assert pillar.classes == ("pillar", "rail")
    assert column.classes == ("column",)


def test_a_picture_is_seen_once(network: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = plugin_with(network, {"post": "pillar"})
    segmenters, seen = SegmenterPool([own]), view()
    segmenters.prefetch(own, seen)
    segmenter = segmenters.network(own)
    monkeypatch.setattr(segmenter, "_adapter", None)
    assert len(segmenters.detect(own, seen)) == 2
    assert np.array_equal(segmenter.probabilities(seen.image), segmenter.predict(seen.image).maps)


def test_a_provider_that_is_not_there_is_noted(network: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session.onnxruntime, "get_available_providers", lambda: ["CPUExecutionProvider"])
    (note,) = SegmenterPool([plugin_with(network, {"post": "pillar"}, asked=("tensorrt",))]).notes
    assert "tensorrt not in this installation" in note
    assert note.endswith("it runs on cpu")


@pytest.mark.parametrize(
    ("given", "asked"),
    [
        ("cuda", ("cuda",)),
        ("[tensorrt, cuda]", ("tensorrt", "cuda")),
        ("openvino, cpu", ("openvino", "cpu")),
        ("", ()),
    ],
)
def test_providers_of_the_site_file_reach_the_plugins(tmp_path: Path, given: str, asked: tuple[str, ...]) -> None:
    (tmp_path / "site.yaml").write_text(SITE.format(given), encoding="utf-8")
    job = job_for(tmp_path / "site.yaml", None, tmp_path)
    assert [own.providers for own in plugins_for(job, "A")] == [asked]


def test_providers_from_the_environment_win(tmp_path: Path) -> None:
    (tmp_path / "site.yaml").write_text(SITE.format("cuda"), encoding="utf-8")
    job = job_for(tmp_path / "site.yaml", None, tmp_path, overrides=overrides_of([], {"SAVMAP__PROVIDERS": "coreml"}))
    assert job.site.providers == ("coreml",)


def test_a_provider_that_does_not_exist(tmp_path: Path) -> None:
    (tmp_path / "site.yaml").write_text(SITE.format("gpu"), encoding="utf-8")
    with pytest.raises(SiteError, match=r"site\.yaml:1: .*providers.*'cuda'"):
        job_for(tmp_path / "site.yaml", None, tmp_path)
