"""Pictures against forgetting."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.errors import PluginFailedError
from savmap.lab.adapt import practice
from savmap.lab.plugins import LabPlugin
from savmap.lab.sim.dataset import Sample
from savmap.plugin.hookspecs import hookimpl
from savmap.plugin.manager import set_up
from savmap.types.progress import NoteCollector, SilentMonitor


def install(monkeypatch: pytest.MonkeyPatch, paint: Callable[..., Sample] | None) -> None:
    """Let `posts` be a plugin that paints so."""
    lab_class = type(
        "PostsLab", (), {"practice_picture": hookimpl(paint), "network_classes": ("post",)} if paint else {}
    )
    monkeypatch.setattr(practice, "lab_plugin", lambda name: LabPlugin(name, set_up(name, lab_class)))


def grey(self: object) -> Sample:
    return np.full((480, 640, 3), 127, np.uint8), np.zeros((480, 640), np.uint8)


def practise(folder: Path, monitor: Any = None, seed: int = practice.SEED) -> Path | None:
    return practice.practice_set("posts", ("post",), 7, folder, monitor or SilentMonitor(), seed)


def test_plugin_paints_its_pictures_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, grey)
    for _ in range(2):
        notes = NoteCollector()
        assert practise(tmp_path / "practice", notes) == tmp_path / "practice"
        assert len(list((tmp_path / "practice" / "masks").iterdir())) == 7
    assert notes.lines == []


def test_plugin_without_any_has_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, None)
    assert practise(tmp_path / "practice") is None


def test_painter_that_fails_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: object) -> Sample:
        raise KeyError("paint")

    install(monkeypatch, refuse)
    with pytest.raises(PluginFailedError, match="plugin `posts` failed in `practice_picture`: KeyError"):
        practise(tmp_path / "practice")
    assert not (tmp_path / "practice").exists()


def test_another_seed_paints_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds: list[int] = []

    def paint(self: object, seed: int, index: int) -> Sample:
        seeds.append(seed)
        return grey(self)

    install(monkeypatch, paint)
    for folder, seed in (("practice", practice.SEED), ("other-places", practice.OTHER_SEED)):
        practise(tmp_path / folder, seed=seed)
    assert seeds == [practice.SEED] * 7 + [practice.OTHER_SEED] * 7
