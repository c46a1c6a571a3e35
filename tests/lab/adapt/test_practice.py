"""Pictures against forgetting."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from savmap.errors import PluginFailedError
from savmap.lab import hookspecs
from savmap.lab.adapt import practice
from savmap.lab.plugins import LabPlugin
from savmap.plugin.hookspecs import hookimpl
from savmap.plugin.manager import set_up
from savmap.types.progress import NoteCollector, SilentMonitor


def install(monkeypatch: pytest.MonkeyPatch, paint: Callable[..., None] | None) -> None:
    """Let `posts` be a plugin that paints so."""
    lab_class = type("PostsLab", (), {"practice_pictures": hookimpl(paint)} if paint else {})
    monkeypatch.setattr(practice, "lab_plugin", lambda name: LabPlugin(name, *set_up(name, lab_class, hookspecs)))


def practise(folder: Path, monitor: Any = None, seed: int = practice.SEED) -> Path | None:
    return practice.practice_set("posts", ("post",), 7, folder, monitor or SilentMonitor(), seed)


def test_plugin_paints_its_pictures_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def paint(self: object, folder: Path, count: int) -> None:
        folder.mkdir()
        (folder / "dataset.json").write_text(str(count))

    install(monkeypatch, paint)
    for _ in range(2):
        notes = NoteCollector()
        assert practise(tmp_path / "practice", notes) == tmp_path / "practice"
        assert (tmp_path / "practice" / "dataset.json").read_text() == "7"
    assert notes.lines == []


def test_plugin_without_any_has_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, None)
    assert practise(tmp_path / "practice") is None


def test_painter_that_fails_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: object) -> None:
        raise KeyError("paint")

    install(monkeypatch, refuse)
    with pytest.raises(PluginFailedError, match="plugin `posts` failed in `practice_pictures`: KeyError"):
        practise(tmp_path / "practice")
    assert not (tmp_path / "practice").exists()


def test_another_seed_paints_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds: list[int] = []

    def paint(self: object, folder: Path, seed: int) -> None:
        folder.mkdir()
        seeds.append(seed)

    install(monkeypatch, paint)
    for folder, seed in (("practice", practice.SEED), ("other-places", practice.OTHER_SEED)):
        practise(tmp_path / folder, seed=seed)
    assert seeds == [practice.SEED, practice.OTHER_SEED]
