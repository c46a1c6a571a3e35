"""Commands on machines without a home folder, with a terminal that lacks letters, and with variables that are set to nothing."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from savmap.cli import endings
from savmap.errors import ModelError, SiteError
from savmap.files.urls import where
from savmap.maps.map_file import write_map
from savmap.types import FrameTable, RowMap, SiteMap, Structure, Trajectory

NAME = "Ständer → 1"
HOMELESS = """
import os, pwd
def unknown(*_): raise KeyError("uid")
pwd.getpwuid = unknown
os.environ.pop("HOME", None)
"""
RUN = """
import sys
from savmap.cli.app import main
for line in {lines!r}:
    sys.argv = ["savmap", *line]
    try:
        main()
        code = 0
    except SystemExit as end:
        code = end.code
    print("==", line[0], code, flush=True)
"""


@pytest.fixture
def homeless(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_: object) -> None:
        raise KeyError("uid")

    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr("pwd.getpwuid", unknown)


@pytest.fixture
def named(tmp_path: Path) -> Path:
    """A folder with a map whose names are not ASCII."""
    labels = (f"{NAME} / a", f"{NAME} / b")
    post = Structure(NAME, "post", np.eye(2, 3), np.zeros((2, 3, 3)), labels, np.array([[0, 1]]))
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    row = RowMap("Gang Ä", FrameTable(np.zeros(0), ()), {}, path, {"posts": (post,)}, ())
    write_map(SiteMap({"Gang Ä": row}, {}), tmp_path / "map.json")
    return tmp_path


def ended(folder: Path, lines: list[list[str]], before: str = "", **variables: str) -> tuple[list[str], str]:
    """What is printed by command lines that one process runs in turn, and what it says on standard error."""
    command = [sys.executable, "-c", before + RUN.format(lines=lines)]
    environment = {**os.environ, **variables}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, timeout=600, check=False)
    return done.stdout.decode("latin-1").splitlines(), done.stderr.decode("latin-1")


def test_a_home_that_nobody_knows_is_one_line(homeless: None) -> None:
    with pytest.raises(
        SiteError, match=r"^~/o: the user has no home folder here \(~\): set HOME, or write the path in full$"
    ):
        where("~/o")


def test_an_empty_epoch_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    for empty in ("", " "):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", empty)
        with endings.plain_endings():
            assert "SOURCE_DATE_EPOCH" not in os.environ
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    with endings.plain_endings():
        assert os.environ["SOURCE_DATE_EPOCH"] == "86400"


def test_an_epoch_that_is_no_number_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "today")
    with pytest.raises(SystemExit) as caught, endings.plain_endings():
        pass
    assert caught.value.code == 3
    assert capsys.readouterr().err.startswith("savmap: SOURCE_DATE_EPOCH=today: a whole number of seconds since 1970")


@pytest.mark.parametrize("why", [MemoryError(), RuntimeError("std::bad_alloc"), OSError(12, "Cannot allocate memory")])
def test_no_memory_is_one_line_that_says_so(capsys: pytest.CaptureFixture[str], why: Exception) -> None:
    with pytest.raises(SystemExit) as caught, endings.plain_endings():
        raise ModelError("a.onnx: cannot be run") from why
    assert caught.value.code == 1
    assert capsys.readouterr().err.startswith("savmap: no memory is left (a.onnx: cannot be run): end other programs")
    with pytest.raises(SystemExit), endings.plain_endings():
        raise why
    assert capsys.readouterr().err.startswith("savmap: no memory is left (")


@pytest.mark.slow
def test_all_commands_without_home_letters_and_epoch(named: Path) -> None:
    from savmap.cli.commands import COMMANDS

    lines = [
        ["plugins"], ["schema", "site"], ["find", "map.json", NAME], ["find", "map.json", "Ständer → 9"],
        ["measure", "map.json", f"{NAME} / a", f"{NAME} / b"], ["export", "map.json", "-o", "ä.csv"], ["export", "map.json", "-o", "ä.dxf"],
        ["report", "map.json", "-o", "ä.html"], ["view", "map.json", "--no-open"], ["compare", "map.json", "map.json"], ["inspect", "map.json", "-o", "ä.html"],
        ["evaluate", "map.json", "ä.json"], ["align", "map.json", "ä.yaml", "-o", "ö.json"], ["import", "ä.dxf"], ["import", "ä.csv"],
        ["init", "-o", "ä.yaml"], ["check", "ä.yaml"], ["map", "ä.yaml", "-o", "~/o"], ["live", "ä.yaml", "-o", "~/o"], ["demo", "-o", "~/o"], ["split", "ä.mp4"],
        ["plane", "ä.mp4", "--side", "left", "--distance", "2"],
        ["simulate", "ä.yaml", "-o", "~/o"], ["train", "shelves", "--data", "ä"], ["label", "ä.mp4"], ["adapt", "ä.yaml"],
        ["plugin", "new", "ä"],
    ]  # fmt: skip
    assert set(COMMANDS) <= {line[0] for line in lines}
    out, error = ended(named, lines, HOMELESS, PYTHONIOENCODING="latin-1", SOURCE_DATE_EPOCH="")
    assert "Traceback" not in error, error
    assert len([line for line in out if line.startswith("==")]) == len(lines)
    assert "exporter" not in error
    assert any("Ständer \\u2192 1" in line for line in out)
    assert "== export 0" in out
