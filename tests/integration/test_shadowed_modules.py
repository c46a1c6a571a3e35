"""A working folder may be full of files that are called as modules are: no process of savmap runs them."""

import multiprocessing
import operator
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from savmap.apps.exchange.imports import model
from savmap.apps.live.mapper import Mapper
from savmap.errors import MustCheckError
from savmap.jobs.executors import in_processes

from ..video.made_up_video import demos_beginning

SCRIPT = Path(sys.executable).with_name("savmap")
RUN = 'open(__file__ + ".run", "w").close()\nraise SystemExit("a module of the working folder is run")\n'
OTHERS = ("av", "cv2", "gtsam", "ifcopenshell", "matplotlib", "numpy", "onnxruntime", "pydantic", "scipy", "typer")
NOTHING: Any = None


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The working folder, with a file called as each module of Python, and some that savmap uses. None of them was run
    in the end."""
    for name in (*sys.stdlib_module_names, *OTHERS):
        (tmp_path / f"{name}.py").write_text(RUN, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    yield tmp_path
    assert [path.name for path in tmp_path.rglob("*.run")] == []


def savmap(*arguments: object) -> str:
    """What a command prints that ends well, or with a row to be checked."""
    done = subprocess.run([SCRIPT, *map(str, arguments)], capture_output=True, text=True, timeout=1800, check=False)
    assert done.returncode in (0, MustCheckError.exit_code), done.stdout + done.stderr
    return done.stdout


def test_the_command_runs_no_module_of_the_working_folder(folder: Path) -> None:
    assert savmap("--version").startswith("savmap ")


def test_as_a_module_it_runs_none_of_the_working_folder(folder: Path) -> None:
    """But for those that `python -m` itself imports before it comes to savmap."""
    (folder / "elsewhere").mkdir()
    (folder / "elsewhere" / "told.py").write_text("import sys\nprint(*sys.modules)", encoding="utf-8")
    of_python = as_module("told", folder=folder / "elsewhere").split()
    for name in of_python:
        (folder / f"{name}.py").unlink(missing_ok=True)
    as_module("savmap", "schema", "map", folder=folder)


def as_module(*arguments: str, folder: Path) -> str:
    """What `python -m` prints in a folder."""
    command = [sys.executable, "-m", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_workers_run_no_module_of_the_working_folder(folder: Path) -> None:
    assert dict(in_processes({"one": (operator.mul, (2, 21))}, 1)) == {"one": 42}


def test_the_live_mapper_runs_no_module_of_the_working_folder(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """It comes as far as its job, which is none."""
    mapper = Mapper(NOTHING, "A", "key", NOTHING, {})
    (process,) = (child for child in multiprocessing.active_children() if child.name == "savmap-live")
    process.join(600)
    mapper.close()
    assert "'NoneType' object has no attribute 'site'" in capfd.readouterr().err


def test_the_reader_of_models_runs_no_module_of_the_working_folder(folder: Path) -> None:
    (folder / "asked").mkdir()
    model._run(folder / "hall.ifc", folder / "asked")  # it asks for nothing


@pytest.mark.slow
@pytest.mark.extra("bim")
def test_a_folder_of_shadows_maps_exports_and_imports(folder: Path) -> None:
    demos_beginning(folder / "aisle.mp4", 8.0)
    options = ("--plugins", "shelves", "--side", "left", "--set", "fps=1")
    savmap("live", "aisle.mp4", *options, "--camera-height", "3.055", "--pace", "0", "-o", "out")
    savmap("export", "out/map.json", "-o", "hall.ifc")
    savmap("import", "hall.ifc", "--map", "out/map.json", "-o", "survey.json")
    savmap("inspect", "out/map.json", "--drawing", "survey.json")
    assert Path("survey.json").is_file()
