"""Records kept meanwhile: what was kept is there again, up to what is damaged, and a disk that is full costs no work."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from savmap.errors import OutputError
from savmap.files import journal as module
from savmap.files.journal import Journal, forget
from savmap.types import Still, ViewSpec

FIRST, SECOND = ViewSpec("a", 1.0), ViewSpec("b", 2.0)


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """Three records."""
    file = tmp_path / "row" / "frames"
    with Journal(file, "key") as journal:
        journal.add("walk", 4, FIRST)
        journal.add("walk", 5, SECOND)
        journal.add("look", 4, SECOND)
    return file


def records(file: Path, key: str = "key") -> list[ViewSpec | None]:
    journal = Journal(file, key)
    return [journal.get(ViewSpec, *place) for place in (("walk", 4), ("walk", 5), ("look", 4), ("look", 5))]


def test_what_was_kept_is_there_again(kept: Path) -> None:
    assert records(kept) == [FIRST, SECOND, SECOND, None]
    with Journal(kept, "key") as journal:
        assert journal.earlier == {"walk": 2, "look": 1}
        journal.add("look", 5, FIRST)
    assert records(kept)[3] == FIRST


def test_what_was_kept_of_anything_else_is_forgotten(kept: Path) -> None:
    assert Journal(kept, "other", is_reader=True).earlier.total() == 0
    assert records(kept) == [FIRST, SECOND, SECOND, None], "a reader forgets nothing"
    assert records(kept, "other") == [None] * 4
    assert records(kept) == [None] * 4


def test_records_wait_and_are_kept_at_the_end(tmp_path: Path) -> None:
    seen = list[bool]()

    def walk() -> None:
        with Journal(tmp_path / "frames", "key") as journal:
            journal.add("walk", 4, FIRST)
            seen.append(Journal(tmp_path / "frames", "key", is_reader=True).has("walk", 4))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        walk()
    assert seen == [False]
    assert records(tmp_path / "frames")[0] == FIRST


def test_what_is_behind_a_damaged_record_is_forgotten(kept: Path) -> None:
    with closing(sqlite3.connect(kept)) as file, file:
        file.execute("update records set content = ? where series = 'walk' and number = 5", (b"one",))
    assert records(kept) == [FIRST, None, None, None]


@pytest.mark.parametrize("size", [100, 5000])
def test_a_damaged_file_is_begun_anew(kept: Path, size: int) -> None:
    kept.write_bytes(kept.read_bytes()[:size])
    assert records(kept) == [None] * 4
    with Journal(kept, "key") as journal:
        journal.add("walk", 4, FIRST)
    assert records(kept)[0] == FIRST


def test_what_another_process_keeps_meanwhile_is_read(kept: Path) -> None:
    reader = Journal(kept, "key", is_reader=True)
    with Journal(kept, "key") as writer:
        writer.add("look", 5, FIRST)
        assert not reader.has("look", 5)
    assert reader.has("look", 5)
    assert reader.get(ViewSpec, "look", 5) == FIRST


def test_records_of_another_kind_are_not_used(kept: Path) -> None:
    with pytest.raises(ValueError, match="not a stored Still"):
        Journal(kept, "key").get(Still, "walk", 4)


def test_a_full_disk_ends_the_keeping_not_the_work(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "KEEP_S", 0.0)
    with Journal(kept, "key") as journal:
        pages = journal._kept.execute("pragma page_count").fetchone()[0]
        journal._kept.execute(f"pragma max_page_count = {pages}")
        for number in range(100):
            journal.add("walk", 6 + number, FIRST)
        assert journal._full
        assert all(journal.get(ViewSpec, "walk", 6 + number) == FIRST for number in range(100))
    assert records(kept)[:3] == [FIRST, SECOND, SECOND]


@pytest.mark.parametrize("limit", ["KEEP_S", "KEEP_BYTES"])
def test_records_are_kept_before_much_waits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str) -> None:
    monkeypatch.setattr(module, limit, 0)
    journal = Journal(tmp_path / "frames")
    journal.add("walk", 4, FIRST)
    assert Journal(tmp_path / "frames", is_reader=True).get(ViewSpec, "walk", 4) == FIRST


def test_without_a_file_records_last_as_long_as_the_journal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "KEEP_S", 0.0)
    journal = Journal()
    journal.add("walk", 4, FIRST)
    assert not journal._waiting
    assert journal.get(ViewSpec, "walk", 4) == FIRST
    assert not Journal().has("walk", 4)


def test_forgotten_records_are_gone(kept: Path) -> None:
    forget(kept)
    assert list(kept.parent.iterdir()) == []


def test_nothing_is_written_through_a_link(kept: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(kept)
    with Journal(tmp_path / "link", "other") as journal:
        journal.add("walk", 4, SECOND)
    assert records(kept)[0] == FIRST


def test_a_file_that_cannot_be_opened_is_told(tmp_path: Path) -> None:
    (tmp_path / "row").touch()
    with pytest.raises(OutputError, match=r"frames: cannot be opened"):
        Journal(tmp_path / "row" / "frames")
