"""Pictures against forgetting."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from savmap.errors import PluginFailedError
from savmap.lab.adapt import practice
from savmap.types.progress import NoteCollector, SilentMonitor


def paint(folder: Path, count: int, seed: int) -> None:
    folder.mkdir()
    (folder / "dataset.json").write_text(str(count))


def refuse(folder: Path, count: int, seed: int) -> None:
    raise KeyError("paint")


def test_plugin_paints_its_own_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(practice, "load_class", lambda name: SimpleNamespace(practice_pictures=paint))
    for _ in range(2):
        notes = NoteCollector()
        folder = practice.practice_set("posts", ("post",), 7, tmp_path / "practice", notes)
        assert folder == tmp_path / "practice"
        assert (folder / "dataset.json").read_text() == "7"
    assert notes.lines == []


def test_plugin_without_any_has_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(practice, "load_class", lambda name: SimpleNamespace())
    assert practice.practice_set("posts", ("post",), 7, tmp_path / "practice", SilentMonitor()) is None


def test_painter_that_fails_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(practice, "load_class", lambda name: SimpleNamespace(practice_pictures=refuse))
    with pytest.raises(PluginFailedError, match="plugin `posts` failed in `practice_pictures`: KeyError"):
        practice.practice_set("posts", ("post",), 7, tmp_path / "practice", SilentMonitor())
    assert not (tmp_path / "practice").exists()


def test_another_seed_paints_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds: list[int] = []
    painter = SimpleNamespace(practice_pictures=lambda folder, count, seed: (seeds.append(seed), folder.mkdir()))
    monkeypatch.setattr(practice, "load_class", lambda name: painter)
    for folder, seed in (("practice", practice.SEED), ("other-places", practice.OTHER_SEED)):
        practice.practice_set("posts", ("post",), 7, tmp_path / folder, SilentMonitor(), seed)
    assert seeds == [practice.SEED, practice.OTHER_SEED]
