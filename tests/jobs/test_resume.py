"""Runs that are killed, that fail in part, or that follow another: each row's stages are done once, and the map is the same."""

import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import pytest
import yaml

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"
KILLS, HALF_S = 3, 9
KEEPS_EACH_FRAME = """
from savmap.files import journal

journal.KEEP_S = 0.0
if __name__ == "__main__":
    from savmap.cli.app import main

    main()
"""
LOWEST_M = [0.30256, 0.17517]
"""Of the bays that this half shows."""


def site(folder: Path, **more: Any) -> Path:
    """The first half of the clip as two rows that share no frames, and no file, for they are of one face; `more` goes into row C."""
    content = yaml.safe_load((EXAMPLE / "site.yaml").read_text(encoding="utf-8"))
    row = content["rows"].pop("A")
    folder.mkdir(exist_ok=True)
    video, copied = EXAMPLE / "aisle-dev.mp4", folder / "copy.mp4"
    if not copied.is_file():
        shutil.copy(video, copied)
    for name, fps, clip in (("A", 1.0, video), ("C", 1.2, copied)):
        one = {**row["passes"][0], "video": str(clip), "fps": fps, "end_s": HALF_S}
        content["rows"][name] = {"passes": [one], "plugins": {"shelves": {"lowest_beam_bottom_height_m": LOWEST_M}}}
    content["rows"]["C"] |= more
    del content["survey"], content["references"]["travel_m"]
    path = folder / "site.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def savmap(path: Path, *options: str) -> "subprocess.Popen[str]":
    """`savmap map` of the site beside its file, shelves alone, in two processes."""
    script = path.with_suffix(".py")
    script.write_text(KEEPS_EACH_FRAME, encoding="utf-8")
    command = [sys.executable, str(script)]
    arguments = ["map", str(path), "--plugins", "shelves", "-o", str(path.parent / "out"), *options]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([*command, *arguments], text=True, start_new_session=True, **pipes)


def finish(path: Path, *options: str) -> tuple[int, str, dict[str, Any]]:
    """Exit code, what was said, and each row of run.json."""
    process = savmap(path, *options)
    out, error = process.communicate(timeout=3600)
    rows = json.loads((path.parent / "out" / "run.json").read_text(encoding="utf-8"))["rows"]
    return process.returncode, out + error, rows


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site after one run."""
    path = site(tmp_path_factory.mktemp("undisturbed"))
    code, said, rows = finish(path, "--jobs", "2")
    assert code == 0, said
    assert [row["status"] for row in rows.values()] == ["mapped", "mapped"]
    return path


def test_a_killed_run_repeated_gives_the_same_map(undisturbed: Path, tmp_path: Path) -> None:
    moments = random.Random(7)
    path = site(tmp_path)
    for _ in range(KILLS):
        process = savmap(path, "--jobs", "2")
        time.sleep(moments.uniform(0.5, 6.0))
        process.kill()
        process.communicate()
        assert not workers_of(process.pid)
    process = savmap(path, "--jobs", "2")
    while not any(kept_in(file) > 6 for file in tmp_path.glob("out/stages/*/frames")):
        assert process.poll() is None
        time.sleep(0.05)
    process.kill()
    process.communicate()
    assert not workers_of(process.pid)
    code, said, _ = finish(path, "--jobs", "2")
    assert code == 0, said
    assert "is kept from an earlier run" in said
    assert not list(tmp_path.glob("out/stages/*/frames*"))
    assert (tmp_path / "out" / "map.json").read_bytes() == (undisturbed.parent / "out" / "map.json").read_bytes()
    assert not list(tmp_path.rglob("*.part"))


def kept_in(file: Path) -> int:
    """Records of a journal that another process writes."""
    with suppress(sqlite3.OperationalError), closing(sqlite3.connect(file)) as journal:
        return int(journal.execute("select count(*) from records").fetchone()[0])
    return 0


def workers_of(session: int, patience_s: float = 600.0) -> list[int]:
    """Processes of a session that are still there after a while."""
    until = time.monotonic() + patience_s
    while left := _session(session):
        if time.monotonic() > until:
            os.killpg(session, signal.SIGKILL)
            return left
        time.sleep(0.2)
    return []


def _session(number: int) -> list[int]:
    listed = subprocess.run(["ps", "-A", "-o", "pid=,sess=,stat="], capture_output=True, text=True, check=True).stdout
    rows = [line.split() for line in listed.splitlines()]
    return [int(pid) for pid, session, state in rows if int(session) == number and not state.startswith("Z")]


def test_a_second_run_does_only_what_changed(undisturbed: Path) -> None:
    before = (undisturbed.parent / "out" / "map.json").read_bytes()
    _, _, rows = finish(undisturbed)
    assert [row["status"] for row in rows.values()] == ["kept", "kept"]
    assert (undisturbed.parent / "out" / "map.json").read_bytes() == before
    higher = {"plugins": {"shelves": {"lowest_beam_bottom_height_m": {"values": [one + 0.001 for one in LOWEST_M]}}}}
    _, _, rows = finish(site(undisturbed.parent, **higher))
    assert rows["A"]["status"] == "kept"
    assert set(rows["C"]["seconds"]) == {"solved", "pictured"}


def test_one_bad_row_stops_no_other(undisturbed: Path) -> None:
    lengths = [{"between": ["upright 1 / left", "upright 2 / right"], "value": 28.0, "sigma": 0.003}]
    path = site(undisturbed.parent, references={"lengths": lengths, "on_contradiction": "refuse"})
    code, said, rows = finish(path, "--jobs", "1")
    assert code == 10, said
    assert said.strip().splitlines()[-1].startswith("savmap: 1 of 2 rows could not be mapped: C")
    content = json.loads((path.parent / "out" / "map.json").read_text(encoding="utf-8"))
    assert list(content["rows"]) == ["A"]
    assert "contradict" in content["failed"]["C"] == rows["C"]["error"]
    assert json.loads((path.parent / "out" / "run.json").read_text(encoding="utf-8"))["status"] == "incomplete"
    assert rows["A"]["status"] == "kept"
