"""Hooks: checked at the door, and failures named."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict

from savmap.errors import PluginError, PluginFailedError, SiteError
from savmap.plugin import hookspecs, manager
from savmap.plugin.hookspecs import hookimpl
from savmap.plugin.manager import loaded_plugin, open_plugin
from savmap.types import CrossRowLandmark, Panorama, Structure, View

HOOKS = {name: value for name, value in vars(hookspecs).items() if hasattr(value, "savmap_spec")}


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid")
    threshold: float = 0.5


def plugin(**hooks: Any) -> type:
    """A plugin's class with the given hooks."""
    body = {
        "name": "made-up",
        "classes": ("thing",),
        "model": Path("none.onnx"),
        "Config": Config,
        "__init__": lambda self, config: None,
    }
    return type("MadeUp", (), {**body, **{name: hookimpl(function) for name, function in hooks.items()}})


def test_the_hooks_that_were_asked_for_exist() -> None:
    assert {
        "render_views",
        "detect",
        "extract_features",
        "track",
        "constrain",
        "describe",
        "relate",
        "shared",
        "evaluate",
        "draw",
        "scene",
    } <= set(HOOKS)


def test_a_misspelt_hook_is_refused() -> None:
    with pytest.raises(PluginError, match="made-up"):
        loaded_plugin("made-up", plugin(extract_feature=lambda self, view: []), Config())


def test_a_plugin_that_raises_is_named() -> None:
    def extract_features(self: object, view: View) -> list[Any]:
        raise ZeroDivisionError("oh")

    room = loaded_plugin("made-up", plugin(extract_features=extract_features), Config())
    with pytest.raises(PluginError, match=r"`made-up` failed in `extract_features`: ZeroDivisionError: oh"):
        room.extract(view=None, detections=[])


@pytest.mark.parametrize("answer", [None, 3, ["x"]])
def test_a_wrong_answer_is_named(answer: object) -> None:
    room = loaded_plugin("made-up", plugin(extract_features=lambda self, view: answer), Config())
    with pytest.raises(PluginError, match=r"`made-up` returned .* from `extract_features`"):
        room.extract(view=None, detections=[])


class SpeechlessError(Exception):
    """An error that cannot even say what it is."""

    def __str__(self) -> str:
        raise RuntimeError


@pytest.mark.parametrize("traced", ["", "1"])
@pytest.mark.parametrize(
    ("error", "says"), [(ValueError("a\nb\n"), "ValueError: a b"), (SpeechlessError(), "SpeechlessError")]
)
def test_whatever_a_plugin_raises_is_one_line(
    error: Exception, says: str, traced: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def extract_features(self: object, view: View) -> list[Any]:
        raise error

    monkeypatch.setenv("SAVMAP_TRACE", traced)
    room = loaded_plugin("made-up", plugin(extract_features=extract_features), Config())
    with pytest.raises(PluginFailedError) as caught:
        room.extract(view=None, detections=[])
    assert str(caught.value) == f"plugin `made-up` failed in `extract_features`: {says}"
    lines = capsys.readouterr().err.splitlines()
    assert [line.endswith(f"ms, raised {says}") for line in lines] == ([True] if traced else [])


class Odd:
    """What no hook may answer, and has parts that cannot be counted."""

    views = np.array(3)

    @property
    def keys(self) -> object:
        raise RuntimeError


def test_a_trace_tells_of_odd_answers_too(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("SAVMAP_TRACE", "1")
    room = loaded_plugin("made-up", plugin(extract_features=lambda self, view: Odd()), Config())
    with pytest.raises(PluginError, match="returned Odd from `extract_features`, not list"):
        room.extract(view=object(), detections=[])
    assert capsys.readouterr().err.endswith("ms, Odd\n")


def test_a_trace_that_cannot_be_printed_is_in_nobodys_way(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SAVMAP_TRACE", "1")
    room = loaded_plugin("made-up", plugin(extract_features=lambda self, view: []), Config())
    with (tmp_path / "closed").open("w") as closed:
        monkeypatch.setattr("sys.stderr", closed)
    assert room.extract(view=None, detections=[]) == []


def test_what_is_drawn_is_checked() -> None:
    room = loaded_plugin("made-up", plugin(draw=lambda self, structures: ("line",)), Config())
    with pytest.raises(PluginError, match="returned a tuple with a str from `draw`, not Drawing"):
        room.draw(structures=[], survey=None, deviations={})


def test_what_is_shared_with_other_rows_is_checked_and_nothing_by_default() -> None:
    assert loaded_plugin("made-up", plugin(), Config()).shared([]) == []
    thing = CrossRowLandmark("post 1", "post", np.zeros(3), np.eye(3), ("x",), 1.5)
    assert loaded_plugin("made-up", plugin(shared=lambda self, structures: [thing]), Config()).shared([]) == [thing]
    room = loaded_plugin("made-up", plugin(shared=lambda self, structures: ["post"]), Config())
    with pytest.raises(PluginError, match="a str from `shared`, not CrossRowLandmark"):
        room.shared([])


def test_a_plugin_answers_for_itself_alone() -> None:
    first = loaded_plugin("made-up", plugin(extract_features=lambda self, view: []), Config())
    second = loaded_plugin("made-up", plugin(), Config())
    assert first.extract(view=None, detections=[]) == []
    with pytest.raises(PluginError):
        second.extract(view=None, detections=[])


def test_extraction_is_given_the_panorama_if_it_asks_for_it() -> None:
    given: list[object] = []

    def extract_features(self: object, panorama: object) -> list[Any]:
        given.append(panorama)
        return []

    image = np.zeros((8, 16, 3), dtype=np.uint8)
    room = loaded_plugin("made-up", plugin(extract_features=extract_features), Config())
    room.extract(None, [], Panorama(0, 0.0, image))
    room.extract(None, [])
    assert isinstance(given[0], Panorama)
    assert given[0].image is image
    assert given[1] is None


def test_an_unknown_plugin_gets_the_nearest_name() -> None:
    with pytest.raises(PluginError, match="did you mean `shelves`"):
        open_plugin("shelfs", {})


def test_settings_are_strict() -> None:
    with pytest.raises(
        SiteError, match=r"site\.yaml: plugins\.shelves: unknown key `treshold`: did you mean `threshold`"
    ):
        open_plugin("shelves", {"treshold": 1}, "site.yaml")


def test_only_named_plugins_are_imported() -> None:
    code = "import sys; from savmap.plugin.manager import open_plugin; open_plugin('shelves', {}); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert {name for name in manager.installed() if f"savmap_{name}" in loaded} == {"shelves"}


def test_structures_may_be_related_to_what_others_mapped() -> None:
    point = Structure(
        "thing 1", "thing", np.zeros((1, 3)), np.eye(3)[None], ("middle",), np.zeros((0, 2), dtype=np.int64)
    )

    def relate(self: Any, structures: Any, others: Any) -> list[Structure]:
        return [replace(own, attributes={"others": len(others["rack"])}) for own in structures]

    assert loaded_plugin("made-up", plugin(), Config()).relate([point], {"rack": [point]}) == (point,)
    (related,) = loaded_plugin("made-up", plugin(relate=relate), Config()).relate([point], {"rack": [point]})
    assert related.attributes == {"others": 1}
