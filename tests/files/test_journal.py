"""Records kept in parts: what was kept is there again, up to what is damaged, and a disk that is full costs no work."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from savmap.errors import OutputError
from savmap.files import journal as module
from savmap.files.journal import Journal, Parts, counts, forget
from savmap.types import Still, ViewSpec

FIRST, SECOND = ViewSpec("a", 1.0), ViewSpec("b", 2.0)


@dataclass
class Shelf:
    """Parts in memory."""

    parts: dict[int, bytes]
    full: bool = False

    def load(self, part: int) -> bytes | None:
        return self.parts.get(part)

    def save(self, part: int, content: bytes) -> None:
        if self.full:
            raise OutputError("no room")
        self.parts[part] = content

    def drop(self, part: int) -> bool:
        return self.parts.pop(part, None) is not None


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> Shelf:
    """Three records in three parts."""
    monkeypatch.setattr(module, "KEEP_S", 0.0)
    shelf = Shelf({})
    with Journal(shelf) as journal:
        journal.add("walk", 4, FIRST)
        journal.add("walk", 5, SECOND)
        journal.add("look", 4, SECOND)
    return shelf


def records(parts: Parts) -> list[ViewSpec | None]:
    journal = Journal(parts)
    return [journal.get(ViewSpec, *place) for place in (("walk", 4), ("walk", 5), ("look", 4), ("look", 5))]


def test_what_was_kept_is_there_again(kept: Shelf) -> None:
    assert records(kept) == [FIRST, SECOND, SECOND, None]
    assert counts(kept) == {"walk": 2, "look": 1}
    with Journal(kept) as journal:
        journal.add("look", 5, FIRST)
    assert records(kept)[3] == FIRST
    assert counts(kept) == {"walk": 2, "look": 2}


def test_records_wait_for_their_part_and_are_kept_at_the_end() -> None:
    shelf, seen = Shelf({}), list[int]()

    def walk() -> None:
        with Journal(shelf) as journal:
            journal.add("walk", 4, FIRST)
            seen.append(len(shelf.parts))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        walk()
    assert seen == [0]
    assert records(shelf)[0] == FIRST


@pytest.mark.parametrize("damage", [b"", b"one", None])
def test_what_is_behind_a_damaged_part_is_forgotten(kept: Shelf, damage: bytes | None) -> None:
    if damage is None:
        del kept.parts[2]
    else:
        kept.parts[2] = damage
    assert records(kept) == [FIRST, None, None, None]
    assert 1 in kept.parts
    assert 2 not in kept.parts


def test_a_journal_that_another_one_writes_is_read_on_from_where_it_stopped(kept: Shelf) -> None:
    reader, loaded = Journal(kept), list[int]()
    with Journal(kept) as writer:
        writer.add("look", 5, FIRST)
    assert not reader.has("look", 5)
    shelf = Shelf(kept.parts)
    reader._parts = shelf
    shelf.load = lambda part: loaded.append(part) or kept.load(part)  # type: ignore[method-assign,func-returns-value]
    reader.read_on()
    assert loaded == [4, 5]
    assert reader.get(ViewSpec, "look", 5) == FIRST


def test_records_of_another_kind_are_not_used(kept: Shelf) -> None:
    with pytest.raises(ValueError, match="not a stored Still"):
        Journal(kept).get(Still, "walk", 4)


def test_a_full_disk_ends_the_keeping_not_the_work(kept: Shelf) -> None:
    kept.full = True
    with Journal(kept) as journal:
        journal.add("walk", 6, FIRST)
        journal.add("walk", 7, FIRST)
        assert journal.get(ViewSpec, "walk", 6) == FIRST
    assert Journal(kept).earlier.total() == 3


def test_a_part_is_written_before_much_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "KEEP_BYTES", 1)
    shelf = Shelf({})
    journal = Journal(shelf)
    journal.add("walk", 4, FIRST)
    assert sorted(shelf.parts) == [0, 1]
    assert journal.get(ViewSpec, "walk", 4) == FIRST


def test_without_parts_records_last_as_long_as_the_journal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "KEEP_S", 0.0)
    journal = Journal()
    folder = journal._parts._folder  # type: ignore[attr-defined]
    journal.add("walk", 4, FIRST)
    assert journal.get(ViewSpec, "walk", 4) == FIRST
    assert list(folder.iterdir())
    del journal
    assert not folder.exists()


def test_forgotten_parts_are_dropped(kept: Shelf) -> None:
    forget(kept)
    assert kept.parts == {}


def test_where_no_temporary_folder_can_be_made_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    with pytest.raises(OutputError, match=r"no temporary folder can be made .*: set TMPDIR to one"):
        Journal()
