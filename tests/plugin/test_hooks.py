"""Hooks: checked at the door, and failures named."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.errors import PluginError, PluginFailedError, SiteError
from savmap.plugin import manager
from savmap.plugin.manager import open_plugin
from savmap.types import View

from .made_up_plugin import VIEW, loaded


def test_a_plugin_that_raises_is_named() -> None:
    def extract_features(self: object, view: View) -> list[Any]:
        raise ZeroDivisionError("oh")

    plugin = loaded(extract_features=extract_features)
    with pytest.raises(
        PluginError, match=r"`made-up` failed in `extract_features` at frame 3 of view: ZeroDivisionError: oh"
    ):
        plugin.extract_features(VIEW, [], None)


def test_a_hook_that_takes_what_it_is_not_given_is_refused() -> None:
    with pytest.raises(PluginError, match="`track` takes `featurs`, but is given features, facts, attitudes, start"):
        loaded(track=lambda self, featurs: [])


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
    plugin = loaded(extract_features=extract_features)
    with pytest.raises(PluginFailedError) as caught:
        plugin.extract_features(VIEW, [], None)
    assert str(caught.value) == f"plugin `made-up` failed in `extract_features` at frame 3 of view: {says}"
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
    plugin = loaded(extract_features=lambda self, view: Odd())
    with pytest.raises(PluginError, match="returned Odd from `extract_features`, not list"):
        plugin.extract_features(VIEW, [], None)
    assert capsys.readouterr().err.endswith("ms, Odd\n")


def test_a_trace_that_cannot_be_printed_is_in_nobodys_way(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SAVMAP_TRACE", "1")
    plugin = loaded(extract_features=lambda self, view: [])
    with (tmp_path / "closed").open("w") as closed:
        monkeypatch.setattr("sys.stderr", closed)
    assert plugin.extract_features(VIEW, [], None) == []


def test_what_is_drawn_is_checked() -> None:
    plugin = loaded(draw=lambda self, structures: ("line",))
    with pytest.raises(PluginError, match="returned a tuple with a str from `draw`, not Drawing"):
        plugin.draw([], None, {})


def test_a_plugin_answers_for_itself_alone() -> None:
    first = loaded(extract_features=lambda self, view: [])
    second = loaded()
    assert first.extract_features(VIEW, [], None) == []
    with pytest.raises(PluginError):
        second.extract_features(VIEW, [], None)


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
