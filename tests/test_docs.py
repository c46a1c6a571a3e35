"""The documentation: pages made from the code name everything, links between files hold, pictures stay small."""

import importlib.util
import json
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from savmap.cli.commands import COMMANDS
from savmap.site.schema import schema_text
from savmap.types import FrameTable, RowMap, SiteMap, Structure, Trajectory, Verdict

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md", *sorted((ROOT / "docs").rglob("*.md"))]
SOURCES = ("savmap", "plugins", "tests", "bench", "docs", "examples")
GENERATED = {ROOT / "docs/reference/settings.md", ROOT / "docs/reference/command-line.md"}


@pytest.fixture(scope="module")
def generated() -> ModuleType:
    """docs/generated.py, which makes pages when the site is built."""
    spec = importlib.util.spec_from_file_location("generated", ROOT / "docs" / "generated.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_settings_page_names_every_key(generated: ModuleType) -> None:
    schema = json.loads(schema_text(generated.PLUGINS))
    page = generated.settings_page()
    for section in (schema, *schema["$defs"].values()):
        for key in section["properties"]:
            assert f"| `{key}` |" in page


def test_settings_page_links_to_its_own_sections(generated: ModuleType) -> None:
    page = generated.settings_page()
    assert set(re.findall(r"\]\(#([^)]+)\)", page)) <= set(re.findall(r"\{#([^}]+)\}", page))
    assert "| `threshold` | number, more than 0, less than 1 | `0.5` |" in page


def test_command_line_page_names_every_command(generated: ModuleType) -> None:
    page = generated.commands_page()
    for name in COMMANDS.keys() - {"plugin"} | {"plugin new"}:
        assert f"## savmap {name}\n" in page
    assert "--camera-height" in page


def test_python_page_reads_records_as_they_are() -> None:
    vertex = Structure("post 1", "post", np.zeros((1, 3)), np.eye(3)[None], ("foot",), np.empty((0, 2), np.int64))
    path = Trajectory(np.arange(1), np.eye(4)[None])
    row = RowMap("1", FrameTable(np.zeros(1), ("pass 1",)), {}, path, {"shelves": (vertex,)}, (), verdict=Verdict())
    names = {"site_map": SiteMap({"1": row}, {}), "np": np}
    page = (ROOT / "docs" / "python-api.md").read_text(encoding="utf-8").split("## What comes back")[1]
    for block in page.split("\n## ")[0].split("```python\n")[1:]:
        exec(block.split("```")[0], names)
    assert names["sigmas_m"] == pytest.approx(np.ones((1, 3)))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_to_files_hold(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        path = (page.parent / target).resolve()
        assert path in GENERATED or path.exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_modules_named_in_pages_exist(page: Path) -> None:
    files = [path.as_posix() for top in SOURCES for path in (ROOT / top).rglob("*.py")]
    for name in re.findall(r"`([\w./-]+\.py)`", page.read_text(encoding="utf-8")):
        assert any(path.endswith(f"/{name}") for path in files), name


def test_pictures_are_small() -> None:
    pictures = list((ROOT / "docs" / "pictures").iterdir())
    assert pictures
    assert [picture.name for picture in pictures if picture.stat().st_size > 300_000] == []


@pytest.fixture(scope="module")
def licences() -> ModuleType:
    """docs/licences.py, which makes the page of dependencies."""
    spec = importlib.util.spec_from_file_location("licences", ROOT / "docs" / "licences.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["licences"] = module
    spec.loader.exec_module(module)
    return module


def listed_licences() -> dict[str, str]:
    """Packages of the page, with their licences."""
    text = (ROOT / "docs" / "licences.md").read_text(encoding="utf-8")
    return {
        name.strip("*"): licence
        for name, licence in re.findall(r"^\| (?!package|---)(\S+) \| ([^|]+) \|", text, re.MULTILINE)
    }


def test_every_dependency_has_its_licence_listed(licences: ModuleType) -> None:
    listed = listed_licences()
    named = {name for names in licences.declared().values() for name in names}
    assert named - set(listed) == set(), "python docs/licences.py --write"
    found = {one.name: one.licence for one in licences.dependencies() if one.licence}
    assert {name: listed.get(name) for name in found} == found, "python docs/licences.py --write"


def test_every_dependency_has_an_upper_bound() -> None:
    """A release that did not yet exist when savmap was tried must not come by itself: one began to report to its maker."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = {"": project["dependencies"], **project["optional-dependencies"]}
    texts = [text for extra, texts in groups.items() if extra != "dev" for text in texts if "savmap[" not in text]
    assert [text for text in texts if "<" not in text.partition(";")[0]] == []


def test_no_licence_forbids_to_use_savmap_as_it_is(licences: ModuleType) -> None:
    listed = listed_licences()
    assert set(listed.values()) <= {short for _, short in licences.SHORT}
    strict = {name for name, licence in listed.items() if "GPL" in licence or "own" in licence}
    assert strict == {"ifcopenshell"}
