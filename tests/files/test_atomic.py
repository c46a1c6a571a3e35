"""Files are written whole or not at all, and read with one clear line."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from savmap.errors import OutputError
from savmap.files import atomic
from savmap.jobs.cache import locked


def test_write_makes_the_folder_and_leaves_only_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "note.txt"
    atomic.write_text(path, "höhe\n")
    assert path.read_bytes() == "höhe\n".encode()
    atomic.write_text(path, "new")
    assert path.read_text() == "new"
    assert os.listdir(path.parent) == ["note.txt"]


@pytest.mark.parametrize("moment", ["fsync", "replace"])
def test_a_kill_leaves_the_old_file_and_a_folder_that_is_swept_up(tmp_path: Path, moment: str) -> None:
    atomic.write_text(tmp_path / "map.json", "old")
    killed = f"import os; os.{moment} = lambda *_: os._exit(9); from savmap.files.atomic import write_text as w; "
    command = [sys.executable, "-c", f"{killed}from pathlib import Path; w(Path('map.json'), 'new')"]
    assert subprocess.run(command, cwd=tmp_path, check=False).returncode == 9
    assert (tmp_path / "map.json").read_text() == "old"
    assert len(os.listdir(tmp_path)) == 2
    with locked(tmp_path):
        assert os.listdir(tmp_path) == ["map.json"]


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


@pytest.mark.parametrize("name", ["pipe", "/dev/null", "/dev/stdout", "/dev/new"])
def test_files_take_the_place_of_no_device(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="is a device or a pipe"):
        atomic.write_text(tmp_path / name, "{}")
