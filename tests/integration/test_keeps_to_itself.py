"""Nothing leaves the machine and nothing is written at home, in a process of savmap's and in its workers; a home is not needed."""

import json
import shutil
import signal
from pathlib import Path

import pytest
import yaml

from savmap_lights.plugin import Lights

from .sealed import SEALS, sealed

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"
UNWRITABLE = Path("/dev/null/home")
"""Not even root can write there."""
LABORATORY = ("savmap.lab", "savmap_shelves.lab", "savmap_lights.lab", "savmap_signs.lab")
OF_EXTRAS = ("onnx", "embreex", "distributed", "upath", "rapidocr", "zxingcpp", "ezdxf", "ifcopenshell", "pxr")
UNNEEDED = (*LABORATORY, *OF_EXTRAS)
"""Modules that mapping does without: importing one of them fails where they are None."""


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """An empty one."""
    (tmp_path / "home").mkdir()
    return tmp_path / "home"


@pytest.mark.skipif(not SEALS, reason="another kernel")
@pytest.mark.parametrize("code", ["socket.getaddrinfo('a.invalid', 80)", "sys.exit(subprocess.call(['bash', '-c', '>/dev/udp/192.0.2.1/9']))"])  # fmt: skip
def test_whoever_connects_is_killed(code: str, home: Path, tmp_path: Path) -> None:
    imports = "import socket, subprocess, sys; ends = socket.socketpair(); ends[0].send(b'1');"
    assert sealed(["-c", imports], home, tmp_path).returncode == 0
    assert sealed(["-c", f"{imports} {code}"], home, tmp_path).returncode in (-signal.SIGSYS, 256 - signal.SIGSYS)


@pytest.mark.parametrize("first", ["savmap", "savmap.lab.train.quantise", "savmap_signs.reading"])
def test_an_opened_network_reports_to_nobody(first: str, home: Path, tmp_path: Path) -> None:
    code = f"import {first}, onnxruntime; onnxruntime.InferenceSession({str(Lights.model)!r})"
    done = sealed(["-c", code], home, tmp_path)
    assert done.returncode == 0, done.stderr
    assert not list(home.rglob("*"))


@pytest.mark.slow
def test_rows_are_mapped_by_workers_without_a_network(home: Path, tmp_path: Path) -> None:
    done = sealed(
        ["-m", "savmap", "map", site(tmp_path, A=1.0, C=1.2), "--plugins", "shelves", "--jobs", "2"], home, tmp_path
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert set(mapped(tmp_path)) == {"A", "C"}
    assert not list(home.rglob("*"))


@pytest.mark.slow
def test_a_row_is_mapped_without_home_extras_and_laboratory(tmp_path: Path) -> None:
    code = f"import sys; sys.modules.update(dict.fromkeys({UNNEEDED!r})); from savmap.cli import main; main()"
    done = sealed(
        ["-c", code, "map", site(tmp_path, A=1.0), "--plugins", "shelves", "--jobs", "0"], UNWRITABLE, tmp_path
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert mapped(tmp_path) == ["A"]


def site(folder: Path, **fps: float) -> Path:
    """Half of the clip as rows that share no file, by their rates: each may have a worker."""
    content = yaml.safe_load((EXAMPLE / "site.yaml").read_text(encoding="utf-8"))
    lowest = content["rows"]["A"]["plugins"]["shelves"]["lowest_beam_bottom_height_m"]["values"][:2]
    content["rows"] = {}
    for name, rate in fps.items():
        shutil.copy(EXAMPLE / "aisle-dev.mp4", folder / f"{name}.mp4")
        one = {"video": f"{name}.mp4", "side": "left", "fps": rate, "end_s": 9}
        settings = {"shelves": {"lowest_beam_bottom_height_m": lowest}}
        content["rows"][name] = {"passes": [one], "plugins": settings}
    del content["survey"], content["references"]["travel_m"]
    (folder / "site.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return folder / "site.yaml"


def mapped(folder: Path) -> list[str]:
    rows = json.loads((folder / "out" / "run.json").read_text(encoding="utf-8"))["rows"]
    return [name for name, row in rows.items() if row["status"] == "mapped"]


@pytest.mark.slow
def test_signs_are_read_without_home_or_network(home: Path, tmp_path: Path) -> None:
    code = "import numpy, savmap_signs.reading as signs; signs._text_reader()(numpy.zeros((64, 256, 3), numpy.uint8))"
    done = sealed(["-c", code], home, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not list(home.rglob("*"))
