"""A full disk: one clear line and exit code 9, and what was there before stays whole.

`little_room` limits the size of any file this process writes: what a full disk does, but for the words.
"""

import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from savmap.cli.console import Console
from savmap.errors import OutputError
from savmap.files.atomic import write_text, write_with
from savmap.jobs.cache import FolderCache, locked
from savmap.lab.sim.render.panorama import encode
from savmap.lab.sim.scene.files import Cart
from savmap.maps.map_file import write_map
from savmap.maps.run_record import RowRun, RunLog, write_log
from savmap.report.picture import write_box_plot
from savmap.site.job import LEAST_ROOM, prepare
from savmap.types import Evaluation, FrameTable, RowMap, Score, SiteMap, Structure, Trajectory
from savmap.video.image_folder import write_picture

FULL = Path("/dev/full")
MAIN = "from savmap.cli.app import main; main()"
NOISE = np.random.default_rng(2).integers(0, 255, (64, 128, 3), np.uint8)


@contextmanager
def little_room(limit: int = 1000) -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def site_map() -> SiteMap:
    path = Trajectory(np.arange(2), np.tile(np.eye(4), (2, 1, 1)), np.full((2, 3), 0.01))
    spread = np.tile(1e-4 * np.eye(3), (3, 1, 1))
    bars = tuple(Structure(f"{i}", "bar", np.eye(3), spread, ("a", "b", "c"), np.array([[0, 1]])) for i in range(9))
    row = RowMap("A", FrameTable(np.arange(2.0), ("pass 1",) * 2), {}, path, {"racks": bars}, (), {})
    return SiteMap({"A": row}, {"savmap": "0"})


def _map(path: Path) -> None:
    write_map(site_map(), path)


def _box_plot(path: Path) -> None:
    write_box_plot(Evaluation({"A": Score({"V gap": np.arange(5.0) / 100})}), path)


WRITERS: dict[str, Callable[[Path], object]] = {
    "map.json": _map,
    "run.json": lambda path: write_log(RunLog(rows={f"{i}": RowRun(status="kept") for i in range(20)}), path),
    "stages/A/seen": lambda path: FolderCache(path.parents[2]).save("A", "seen", "print", NOISE.tobytes()),
    "box.png": _box_plot,
    "picture.png": lambda path: write_picture(path, NOISE),
    "map.ply": lambda path: write_with(lambda part: write_text(part, "ply\n" * 999), path),
    "map.own": lambda path: write_with(lambda part: part.write_bytes(bytes(5000)), path),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_one_line_and_leaves_what_was_there(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    before = {one: one.read_bytes() for one in tmp_path.rglob("*") if one.is_file()}
    assert len(before[path]) > 1000
    with little_room(), pytest.raises(OutputError) as caught:
        WRITERS[name](path)
    assert str(caught.value).startswith(f"{path}: cannot be written (file too large)")
    assert "\n" not in str(caught.value)
    assert {one: one.read_bytes() for one in tmp_path.rglob("*") if one.is_file()} == before


@pytest.mark.parametrize("name", WRITERS)
def test_a_folder_below_a_file_is_one_line(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be written"):
        WRITERS[name](tmp_path / "file" / name)


def test_a_folder_with_next_to_no_room_is_refused_at_once(tmp_path: Path) -> None:
    with little_room(LEAST_ROOM - 1), pytest.raises(OutputError, match=r"nothing can be written there: file too large"):
        prepare(tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []
    prepare(tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
def test_a_log_that_cannot_be_written_falls_silent(capfd: pytest.CaptureFixture[str]) -> None:
    with Console(FULL) as console:
        console.note("one line")
    assert capfd.readouterr() == ("", "one line\n")


def test_a_log_that_cannot_be_opened_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "savmap.log").mkdir()
    with pytest.raises(OutputError, match=r"savmap.log: cannot be written \(is a directory\)"):
        Console(tmp_path / "savmap.log")


@pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
def test_a_full_disk_behind_the_standard_output(tmp_path: Path) -> None:
    command = [sys.executable, "-c", MAIN, "plugins"]
    with FULL.open("w") as full:
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=600, check=False)
    assert ended.returncode == 9
    assert ended.stderr == (
        "savmap: standard output: cannot be written (no space left on device); choose another folder or free its space\n"
    )


@pytest.mark.slow
def test_export_by_the_command_line(tmp_path: Path) -> None:
    _map(tmp_path / "map.json")
    limited = f"import resource as r; r.setrlimit(r.RLIMIT_FSIZE, (300, 300)); {MAIN}"
    command = [sys.executable, "-c", limited, "export", "map.json", "--format", "csv", "-o", "map.csv"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False)
    assert (ended.returncode, ended.stdout) == (9, "")
    assert ended.stderr.startswith("savmap: map.csv: cannot be written (file too large)")
    assert len(ended.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["map.json"]


def test_footage_that_does_not_fit(tmp_path: Path) -> None:
    cart = Cart(start=(0, 1), end=(1, 1), height=1.5, frames=20, width=128)
    with little_room(), pytest.raises(OSError, match="File too large"):
        encode([NOISE] * 20, cart, tmp_path / "footage.mp4")


def test_errors_inside_a_run_are_not_taken_for_the_lock(tmp_path: Path) -> None:
    with pytest.raises(BlockingIOError), locked(tmp_path):
        raise BlockingIOError
