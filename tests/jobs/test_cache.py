"""The store: what fits is taken, anything else is made again; one run at a time in a folder."""

from pathlib import Path

import pytest

from savmap.errors import OutputError
from savmap.jobs.cache import FolderCache, locked

NAME = "B/2 ../ü"


@pytest.fixture
def store(tmp_path: Path) -> FolderCache:
    kept = FolderCache(tmp_path)
    kept.save(NAME, "seen", "ab12", b"one\ntwo")
    return kept


def test_what_was_kept_comes_back_for_the_same_fingerprint_only(store: FolderCache) -> None:
    assert store.load(NAME, "seen", "ab12") == b"one\ntwo"
    assert store.load(NAME, "seen", "ab13") is None
    assert store.load(NAME, "solved", "ab12") is None
    assert store.load("other", "seen", "ab12") is None
    assert store.load(NAME, "seen", None) == b"one\ntwo", "whatever it was made of"


def test_what_is_cleared_is_gone_and_what_follows_is_kept(store: FolderCache) -> None:
    store.save("other", "seen", "ab12", b"one")
    store.clear([NAME, "never mapped"])
    assert store.load(NAME, "seen", "ab12") is None
    assert store.load("other", "seen", "ab12") == b"one"
    store.save(NAME, "seen", "ab12", b"two")
    assert store.load(NAME, "seen", "ab12") == b"two"


def test_what_cannot_be_cleared_is_told(store: FolderCache, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(path: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "unlink", refuses)
    with pytest.raises(OutputError, match=r"seen: cannot be removed \(permission denied\); choose another -o"):
        store.clear([NAME])


def test_rows_keep_to_the_folder_whatever_their_names(store: FolderCache, tmp_path: Path) -> None:
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) == 1
    assert files[0].parent.parent == tmp_path / "stages"


@pytest.mark.parametrize("damage", [b"", b"one", b"one\ntwO", b"one\ntwo\n", None])
def test_a_damaged_file_is_made_again(store: FolderCache, tmp_path: Path, damage: bytes | None) -> None:
    file = next(path for path in tmp_path.rglob("seen"))
    head = file.read_bytes().partition(b"\n")[0]
    file.write_bytes(head + b"\n" + damage if damage is not None else b"")
    assert store.load(NAME, "seen", "ab12") is None
    assert store.load(NAME, "seen", None) is None


def test_one_run_at_a_time(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(OutputError, match="another savmap"), locked(tmp_path):
        pass
    with locked(tmp_path):
        pass


def test_what_a_killed_run_left_is_swept_up(store: FolderCache, tmp_path: Path) -> None:
    row = next(tmp_path.glob("stages/*"))
    left = [row / ".seen.1234.part", tmp_path / ".map.json.77.part"]
    mine = tmp_path / ".notes.part"
    for path in (*left, mine):
        path.touch()
    (tmp_path / ".savmap-abcd1234").mkdir()
    with locked(tmp_path):
        assert not any(path.exists() for path in left)
        assert not (tmp_path / ".savmap-abcd1234").exists()
        assert mine.exists()
    assert store.load(NAME, "seen", "ab12") is not None
