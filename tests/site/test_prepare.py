"""What could not be written at the end of a run is refused before its work."""

import errno
import os
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from savmap.cli.app import app
from savmap.errors import OutputError
from savmap.files.atomic import write_bytes
from savmap.jobs.cache import locked
from savmap.jobs.check import CheckError
from savmap.jobs.map_site import written_files
from savmap.site.job import job_for, prepare

MINE = "my own words"
EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev" / "site.yaml"
JOB = job_for(EXAMPLE, ["shelves"], Path("out"))


@pytest.fixture
def out(tmp_path: Path) -> Path:
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


def test_a_file_in_a_folders_place_is_refused(out: Path) -> None:
    files = written_files(replace(JOB, output=out))
    folders = {f"{part}" for file in files for part in file.relative_to(out).parents} - {"."}
    assert {"stages", "stages/A", "pano", "face", "face/small", "joint"} <= folders
    prepare(out, files)
    assert list(out.iterdir()) == []
    for folder in sorted(folders):
        (out / folder).parent.mkdir(parents=True, exist_ok=True)
        (out / folder).touch()
        with pytest.raises(OutputError, match=f"{out / folder}: nothing can be written there: is a file, not a folder"):
            prepare(out, files)
        (out / folder).unlink()


def test_a_folder_in_a_files_place_is_refused(out: Path) -> None:
    files = written_files(replace(JOB, output=out))
    for file in files:
        file.mkdir(parents=True)
        with pytest.raises(OutputError, match=f"{file}: is a folder, and a file is to be written there"):
            prepare(out, files)
        file.rmdir()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_refused(out: Path) -> None:
    (out / "stages").mkdir(mode=0o500)
    with pytest.raises(OutputError, match=f"{out / 'stages'}: nothing can be written there: permission denied"):
        prepare(out, written_files(replace(JOB, output=out)))


def test_a_read_only_disk_is_refused(monkeypatch: pytest.MonkeyPatch, out: Path) -> None:
    """As a disk that is mounted at a folder of the output is, where it may not be written to."""
    real = tempfile.TemporaryFile

    def refusing(dir: Path) -> Any:
        if dir == out / "stages":
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return real(dir=dir)

    (out / "stages").mkdir()
    monkeypatch.setattr("tempfile.TemporaryFile", refusing)
    with pytest.raises(OutputError, match=f"{out / 'stages'}: nothing can be written there: read-only file system"):
        prepare(out, written_files(replace(JOB, output=out)))


@pytest.mark.slow
def test_check_and_map_say_what_is_in_the_way(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (out / "stages").touch()
    for command in (["check", "--no-pictures"], ["map"]):
        with pytest.raises(OutputError if command == ["map"] else CheckError) as caught:
            app([*command, str(EXAMPLE), "--plugins", "shelves", "-o", str(out)], standalone_mode=False)
        said = capsys.readouterr()
        assert f"{out / 'stages'}: nothing can be written there" in said.out + said.err + str(caught.value)
        assert "measuring" not in said.err


def test_unknown_files_among_the_stages_are_left(out: Path) -> None:
    others = [out / "stages" / ".DS_Store", out / "stages" / "A" / "notes", out / "stages" / "A" / "more" / ".x"]
    for path in others:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(MINE)
    with locked(out):
        assert all(path.read_text() == MINE for path in others)


def test_an_output_folder_may_be_a_link(tmp_path: Path, out: Path) -> None:
    (tmp_path / "link").symlink_to(out)
    prepare(tmp_path / "link")
    write_bytes(tmp_path / "link" / "stages" / "A" / "solved", b"x")
    assert (out / "stages" / "A" / "solved").read_bytes() == b"x"
