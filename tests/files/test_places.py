"""Nothing is written outside an output folder through a link, whatever lies in it."""

import errno
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from savmap.cli.app import app
from savmap.cli.console import Console
from savmap.errors import OutputError
from savmap.files import places
from savmap.files.atomic import write_bytes, write_text, write_with
from savmap.jobs.cache import FolderCache, locked
from savmap.jobs.check import CheckError
from savmap.jobs.map_site import written_files
from savmap.site.job import job_for, prepare

MINE = "my own words"
EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev" / "site.yaml"
JOB = job_for(EXAMPLE, ["shelves"], Path("out"))


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    path = tmp_path / "mine" / "notes.txt"
    path.parent.mkdir()
    path.write_text(MINE)
    return path


@pytest.fixture
def out(tmp_path: Path) -> Path:
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


def _log(path: Path) -> None:
    with Console(path) as console:
        console.note("a line")


WRITERS: dict[str, Callable[[Path], object]] = {
    "map.json": lambda path: write_text(path, "{}"),
    "savmap.log": _log,
    "map.own": lambda path: write_with(lambda part: part.write_bytes(b"x"), path),
}


def test_a_link_named_as_the_old_probe_is_left_alone(out: Path, mine: Path) -> None:
    (out / ".savmap-probe").symlink_to(mine)
    prepare(out)
    assert mine.read_text() == MINE
    assert (out / ".savmap-probe").is_symlink()


@pytest.mark.parametrize("name", WRITERS)
def test_a_link_is_replaced_and_not_followed(out: Path, mine: Path, name: str) -> None:
    (out / name).symlink_to(mine)
    prepare(out)
    WRITERS[name](out / name)
    assert mine.read_text() == MINE
    assert not (out / name).is_symlink()


def test_a_hard_link_of_the_log_is_left_alone(out: Path, mine: Path) -> None:
    os.link(mine, out / "savmap.log")
    _log(out / "savmap.log")
    assert mine.read_text() == MINE


def test_a_foreseen_temporary_name_is_not_written_to(out: Path, mine: Path) -> None:
    for name in ("map.json", "savmap.log"):
        (out / f".{name}.{os.getpid()}.part").symlink_to(mine)
        WRITERS[name](out / name)
    assert mine.read_text() == MINE


@pytest.mark.parametrize("link", ["stages", "stages/A"])
def test_no_stage_is_written_through_a_linked_folder(out: Path, mine: Path, link: str) -> None:
    (out / link).parent.mkdir(exist_ok=True)
    (out / link).symlink_to(mine.parent)
    prepare(out)
    with pytest.raises(OutputError, match=f"{out / link}: is a link"):
        FolderCache(out).save("A", "solved", "key", b"")
    assert [path.name for path in mine.parent.rglob("*")] == [mine.name]


FOLDERS = sorted({f"{part}" for file in written_files(JOB) for part in file.relative_to(JOB.output).parents} - {"."})


def test_all_folders_of_an_output_are_tried() -> None:
    assert {"stages", "stages/A", "pano", "face", "face/small", "joint"} <= set(FOLDERS)


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_that_is_none_is_refused_before_work(out: Path, mine: Path, name: str) -> None:
    files = written_files(replace(JOB, output=out))
    prepare(out, files)
    assert list(out.iterdir()) == []
    (out / name).parent.mkdir(parents=True, exist_ok=True)
    (out / name).symlink_to(mine.parent)
    with pytest.raises(
        OutputError, match=f"{out / name}: is a link, and nothing is written through one; remove it, or"
    ):
        prepare(out, files)
    (out / name).unlink()
    (out / name).write_text(MINE)
    with pytest.raises(OutputError, match=f"{out / name}: nothing can be written there: is a file, not a folder"):
        prepare(out, files)


@pytest.mark.parametrize("name", sorted({file.name for file in written_files(JOB)}))
def test_a_folder_in_a_files_place_is_refused_before_work(out: Path, name: str) -> None:
    files = written_files(replace(JOB, output=out))
    (file,) = (
        {file for file in files if file.name == name and file.parent.name != "old"} if name != "A.js" else {files[-2]}
    )
    file.mkdir(parents=True)
    with pytest.raises(OutputError, match=f"{file}: is a folder, and a file is to be written there"):
        prepare(out, files)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_refused_before_work(out: Path) -> None:
    (out / "stages").mkdir(mode=0o500)
    with pytest.raises(OutputError, match=f"{out / 'stages'}: nothing can be written there: permission denied"):
        prepare(out, written_files(replace(JOB, output=out)))


def test_a_read_only_disk_is_refused_before_work(monkeypatch: pytest.MonkeyPatch, out: Path) -> None:
    """As a disk that is mounted at a folder of the output is, where it may not be written to."""
    (out / "stages").mkdir()
    real, place = os.open, (out / "stages").stat().st_ino

    def refusing(path: object, flags: int, *rest: int, dir_fd: int | None = None) -> int:
        if flags & os.O_CREAT and dir_fd is not None and os.fstat(dir_fd).st_ino == place:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return real(path, flags, *rest, dir_fd=dir_fd)  # type: ignore[arg-type]

    monkeypatch.setattr("os.open", refusing)
    with pytest.raises(OutputError, match=f"{out / 'stages'}: nothing can be written there: read-only file system"):
        prepare(out, written_files(replace(JOB, output=out)))


@pytest.mark.slow
def test_check_and_map_say_what_is_in_the_way(out: Path, mine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (out / "stages").symlink_to(mine.parent)
    for command in (["check", "--no-pictures"], ["map"]):
        with pytest.raises(OutputError if command == ["map"] else CheckError) as caught:
            app([*command, str(EXAMPLE), "--plugins", "shelves", "-o", str(out)], standalone_mode=False)
        said = capsys.readouterr()
        assert f"{out / 'stages'}: is a link" in said.out + said.err + str(caught.value)
        assert "measuring" not in said.err


def test_sweeping_up_follows_no_link(out: Path, mine: Path) -> None:
    (mine.parent / ".savmap-abcd1234").touch()
    (out / "stages").symlink_to(mine.parent.parent)
    with locked(out):
        assert (mine.parent / ".savmap-abcd1234").exists()
    (out / "stages").unlink()
    (out / "stages").mkdir()
    (out / "stages" / "A").symlink_to(mine.parent)
    with locked(out):
        assert (mine.parent / ".savmap-abcd1234").exists()


def test_unknown_files_among_the_stages_are_left_alone(out: Path) -> None:
    strange = [out / "stages" / ".DS_Store", out / "stages" / "A" / "notes", out / "stages" / "A" / "more" / ".x"]
    for path in strange:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(MINE)
    os.mkfifo(out / "stages" / "pipe")
    with locked(out):
        assert all(path.read_text() == MINE for path in strange)


@pytest.mark.parametrize("name", WRITERS)
def test_a_pipe_or_a_device_is_not_waited_for(out: Path, name: str) -> None:
    os.mkfifo(out / name)
    if name == "savmap.log":
        _log(out / name)
        assert (out / name).is_file()
    else:
        with pytest.raises(OutputError, match="is a device or a pipe"):
            WRITERS[name](out / name)


@pytest.mark.parametrize("name", ["/dev/null", "/dev/stdout", "/dev/new", "/proc/new"])
def test_files_take_the_place_of_no_device(name: str) -> None:
    with pytest.raises(OutputError, match="is a device or a pipe"):
        places.require_plain(Path(name))


def test_an_output_folder_may_be_a_link_itself(tmp_path: Path, out: Path) -> None:
    (tmp_path / "there").symlink_to(out)
    prepare(tmp_path / "there")
    write_bytes(tmp_path / "there" / "stages" / "A" / "solved", b"x")
    assert (out / "stages" / "A" / "solved").read_bytes() == b"x"
