"""The one place that authors import from: every name is there, documented, and costs nothing until it is used."""

import re
import subprocess
import sys
from pathlib import Path

import savmap.plugin as door

DOCS = Path(__file__).parents[2] / "docs" / "plugin-api.md"


def test_every_public_name_is_there() -> None:
    for name in door.__all__:
        assert getattr(door, name) is not None
    assert dir(door) == sorted(door.__all__)
    assert not hasattr(door, "open_plugin_somehow")


def test_every_public_name_is_documented_and_no_other() -> None:
    table = [line for line in DOCS.read_text(encoding="utf-8").splitlines() if line.startswith("| ")][2:]
    assert {name for line in table for name in re.findall(r"`(\w+)`", line)} == set(door.__all__)


def test_importing_the_place_imports_neither_graph_nor_pictures() -> None:
    code = "import sys, savmap.plugin; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert not {"gtsam", "cv2", "numpy", "pluggy"} & set(loaded)


def test_plugins_import_their_tools_from_there_alone() -> None:
    templates = Path(door.__file__).parent / "scaffold"
    for path in templates.glob("*/src/savmap_pillars/plugin.py"):
        modules = set(re.findall(r"^(?:from|import) (savmap[\w.]*)", path.read_text(encoding="utf-8"), re.MULTILINE))
        assert modules == {"savmap.plugin"}, path
