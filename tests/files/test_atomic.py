"""Files are written whole or not at all, and read with one clear line."""

import errno
import os
from pathlib import Path

import pytest

from savmap.errors import OutputError
from savmap.files import atomic


def test_write_makes_the_folder_and_leaves_only_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "note.txt"
    atomic.write_text(path, "höhe\n")
    assert path.read_bytes() == "höhe\n".encode()
    assert os.listdir(path.parent) == ["note.txt"]


def test_write_replaces_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "note.txt"
    atomic.write_text(path, "long old text")
    atomic.write_text(path, "new")
    assert path.read_text() == "new"


def test_full_disk_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "note.txt"
    atomic.write_text(path, "old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="no space left on device") as caught:
        atomic.write_text(path, "new")
    assert "\n" not in str(caught.value)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["note.txt"]


def test_folder_that_is_a_file_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(OutputError, match=r"out.map\.json: cannot be written \(what would be its folder is a file\)"):
        atomic.write_text(tmp_path / "out" / "map.json", "{}")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{"a": 1,\n "b": }', "line 2, column 7"),
        (b'{"a": NaN}', "NaN is not a number"),
        (b"\xff\xfe", "not a text file"),
        (b"", "line 1, column 1"),
    ],
)
def test_read_json_says_what_is_wrong(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "data.json"
    path.write_bytes(content)
    with pytest.raises(OutputError, match=message) as caught:
        atomic.read_json(path)
    assert str(path) in str(caught.value)


def test_read_json_of_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="no such file"):
        atomic.read_json(tmp_path / "none.json")


def test_sha256(tmp_path: Path) -> None:
    path = tmp_path / "abc"
    path.write_bytes(b"abc")
    assert atomic.sha256(path).startswith("ba7816bf")
    with pytest.raises(OutputError, match="cannot be read"):
        atomic.sha256(tmp_path / "none")
