"""Apps: found by entry points, unknown to the core, which works without those that come with savmap."""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from savmap.maps.map_file import write_map
from savmap.plugin.apps import apps
from savmap.types import SiteMap

from ..report import made_up_map

ROOT = Path(__file__).parents[2]
CORE = [path for path in (ROOT / "savmap").rglob("*.py") if path.relative_to(ROOT).parts[1] not in ("apps", "lab")]
PUBLIC = ROOT / "savmap" / "__init__.py"
FOR_APPS = {"apps", "errors", "maps", "plugin", "types"}
"""Packages of savmap that any app may import from."""
INSIDE = {
    "dates": "cli files jobs report",
    "exchange": "cli files jobs",
    "inspection": "cli files jobs report site",
    "live": "cli files geometry jobs pipeline site video vision",
    "plane": "cli files geometry graph pipeline site vision",
    "split": "cli files site video",
    "viewer": "cli files jobs report",
}
"""What savmap's apps import beside these: a list that is to get shorter, for others' apps cannot count on it."""
ODD = """
from savmap.plugin.apps import App, Command

APP = App({"gone": Command("nothing:here", "Is not there."), "map": Command("nothing:here", "")}, {"csv": "nothing:here"})
"""
PAGE = ROOT / "docs" / "apps.md"
BLOCK = re.compile(r"```python\n# (\S+)\n(.*?)```", re.DOTALL)
"""The files that the page shows."""


def test_the_core_names_no_app() -> None:
    """Neither by an import anywhere in a file nor by a string; savmap's public names lie where they are."""
    named = set()
    for path in CORE:
        texts = [node.value for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Constant)]
        modules = [text for text in texts if isinstance(text, str) and re.match(r"savmap\.apps\.", text)]
        if path != PUBLIC and (modules or re.search(r"(from|import) savmap\.apps\b", path.read_text("utf-8"))):
            named.add(path)
    assert named == set()


def test_apps_use_no_more_of_the_core_than_is_said() -> None:
    used = dict[str, set[str]]()
    for path in (ROOT / "savmap" / "apps").glob("*/**/*.py"):
        app = path.relative_to(ROOT / "savmap" / "apps").parts[0]
        for package in re.findall(r"(?:from|import) savmap\.(\w+)", path.read_text("utf-8")):
            used.setdefault(app, set()).add(package)
    assert {app: " ".join(sorted(names - FOR_APPS)) for app, names in used.items()} == INSIDE


def test_every_app_that_comes_with_savmap_is_installed() -> None:
    folders = {path.name for path in (ROOT / "savmap" / "apps").iterdir() if (path / "__init__.py").is_file()}
    assert {name for name, app in apps().items() if type(app).__module__ == "savmap.plugin.apps"} >= folders


def run(tree: Path, *arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """savmap of another tree, which is in the path before the one that is installed."""
    paths = [tree, *(tree / "plugins" / name for name in ("shelves", "lights", "signs"))]
    settings = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))}
    command = [sys.executable, "-m", "savmap", *arguments]
    return subprocess.run(command, cwd=folder, env=settings, capture_output=True, text=True, timeout=600, check=False)


def test_the_app_that_the_page_shows(tmp_path: Path) -> None:
    page = PAGE.read_text("utf-8")
    for name, text in BLOCK.findall(page):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    about = tmp_path / "counts-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: counts\nVersion: 1\n", encoding="utf-8")
    (point,) = re.findall(r'^counts = "(\S+)"$', page, re.MULTILINE)
    (tmp_path / "odd.py").write_text(ODD, encoding="utf-8")
    points = f"[savmap.apps]\nbroken = nothing:APP\ncounts = {point}\nodd = odd:APP\n"
    (about / "entry_points.txt").write_text(points, encoding="utf-8")
    write_map(SiteMap({"A": made_up_map.row("A")}, {}), tmp_path / "map.json")
    assert "  count     Say how many structures a map has.\n" in run(tmp_path, "--help", folder=tmp_path).stdout
    counted = run(tmp_path, "count", "map.json", folder=tmp_path)
    assert counted.stdout.startswith("1 spot, 2 post, 1 bar"), counted.stderr
    assert "app `broken` (nothing:APP) cannot be imported" in counted.stderr
    assert run(tmp_path, "export", "map.json", "-o", "hall.counts", folder=tmp_path).returncode == 0
    missing = run(tmp_path, "gone", folder=tmp_path)
    assert missing.returncode == 5
    assert "`nothing:here`, which an app names, cannot be imported" in missing.stderr
    assert run(tmp_path, "export", "map.json", "-o", "a.csv", folder=tmp_path).returncode == 0, "the core's format"
    assert re.fullmatch(r"A \d+\n", (tmp_path / "hall.counts").read_text("utf-8"))


@pytest.mark.slow
def test_without_apps_savmap_maps_and_evaluates(tmp_path: Path) -> None:
    for name in ("savmap", "plugins"):
        shutil.copytree(ROOT / name, tmp_path / "tree" / name, ignore=shutil.ignore_patterns("__pycache__", "*.mp4"))
    shutil.rmtree(tmp_path / "tree" / "savmap" / "apps")
    demo = ROOT / "savmap" / "demo"
    for file in ("site.yaml", "survey.json", "references.json", "aisle-dev.mp4"):
        shutil.copy(demo / file, tmp_path)
    mapped = run(tmp_path / "tree", "map", "site.yaml", "--plugins", "shelves", folder=tmp_path)
    assert mapped.returncode == 0, mapped.stderr
    assert "app `viewer`" in mapped.stderr
    assert not (tmp_path / "out" / "view.html").exists()
    assert (tmp_path / "out" / "report.html").is_file()
    scored = run(tmp_path / "tree", "evaluate", "out", "survey.json", folder=tmp_path)
    assert "missing: none; spurious: none" in scored.stdout
    asked = run(tmp_path / "tree", "report", "out", "--against", "out", folder=tmp_path)
    assert "an earlier map needs an app that compares maps, and none is installed" in asked.stderr
