"""The shape of the code: layers, no cycles, and a core that names no structure."""

import ast
import re
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SAVMAP = ROOT / "savmap"
TEMPLATE = SAVMAP / "plugin" / "scaffold" / "project-template"
CORE = sorted(path for path in SAVMAP.rglob("*.py") if TEMPLATE not in path.parents)
PLUGINS = sorted((ROOT / "plugins").rglob("*.py"))
LAYERS = [
    "errors",
    "geometry",
    "types",
    "files",
    "video",
    "vision",
    "graph",
    "maps",
    "plugin",
    "site",
    "assembly",
    "pipeline",
    "split",
    "report",
    "jobs",
    "demo",
    "lab",
    "cli",
]
"""Packages from the lowest to the highest: a package imports from itself and from lower ones."""
PRIVATE = {"site", "pipeline", "jobs", "assembly", "cli", "report", "split"}
"""Packages that plugins do not import from."""
STRUCTURES = {"shelf", "shelves", "light", "lights", "lamp", "lamps", "sign", "signs", "rack", "racks"}
OTHER_MEANINGS = r"\b(np|torch|math)\.sign\b|text=\"light\""


def module_of(path: Path) -> str:
    """A file's module: "savmap.graph.keys"; a package's `__init__` has the package's name."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in CORE}


def imported(path: Path) -> Iterator[str]:
    """Modules that a file imports anywhere, under TYPE_CHECKING and in functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in MODULES else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def code_words(path: Path) -> set[str]:
    """Whole words of a file's names, strings and comments, without its docstrings (prose)."""
    text = path.read_text(encoding="utf-8")
    prose = {
        ast.get_docstring(node, clean=False) or ""
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
    }
    for docstring in sorted(prose, key=len, reverse=True):
        text = text.replace(docstring, "")
    return {word.lower() for word in re.findall(r"[A-Za-z]+", re.sub(OTHER_MEANINGS, "", text))}


def test_savmap_holds_packages_alone() -> None:
    entries = {path.name for path in SAVMAP.iterdir() if path.name != "__pycache__"}
    files = {"__init__.py", "__main__.py", "errors.py", "py.typed"}
    assert {name for name in entries if "." in name} == files
    assert entries - files == set(LAYERS) - {"errors"}
    assert len(entries) <= 24


@pytest.mark.parametrize("path", CORE, ids=module_of)
def test_imports_go_down(path: Path) -> None:
    parts = path.relative_to(SAVMAP).with_suffix("").parts
    if parts in (("__init__",), ("__main__",)):
        return  # the public surface and the command name what lies anywhere
    allowed = set(LAYERS[: LAYERS.index(parts[0]) + 1])
    layers = {module.split(".")[1] for module in imported(path) if module.startswith("savmap.")}
    assert layers <= allowed, f"{module_of(path)} imports from {', '.join(sorted(layers - allowed))}"


def test_no_import_cycle() -> None:
    graph: Mapping[str, set[str]] = {
        module: {name for name in imported(path) if name in MODULES and name != module}
        for module, path in MODULES.items()
        if module != "savmap"
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize("path", CORE, ids=module_of)
def test_core_names_no_structure(path: Path) -> None:
    named = code_words(path) & STRUCTURES
    if "sim" in path.parts or path.name == "scenes.py":
        named -= {"light", "lights", "lamp", "lamps"}  # the renderers' words for what illuminates a scene
    if "site" in path.parts:
        named -= {"rack", "racks"}  # `layout.rack_m` is a key of site files: what stands between two faces back to back
    assert not named


@pytest.mark.parametrize("path", PLUGINS, ids=str)
def test_plugins_use_the_public_door(path: Path) -> None:
    package = next(part for part in path.parts if part.startswith("savmap_"))
    for module in imported(path):
        parts = module.split(".")
        assert not (parts[0] == "savmap" and len(parts) > 1 and parts[1] in PRIVATE), f"{path} imports {module}"
        assert not (parts[0].startswith("savmap_") and parts[0] != package), f"{path} imports another plugin: {module}"


def test_only_graph_imports_gtsam() -> None:
    users = {path for path in CORE + PLUGINS if any(module.split(".")[0] == "gtsam" for module in imported(path))}
    assert users
    assert all("graph" in path.parts for path in users)


@pytest.mark.parametrize(
    "path", sorted(path for path in (ROOT / "tests").rglob("*.py") if "plugins" not in path.parts), ids=str
)
def test_tests_of_the_core_import_no_plugin(path: Path) -> None:
    if "integration" not in path.relative_to(ROOT).parts:
        named = {module.split(".")[0] for module in imported(path)}
        assert not named & {"savmap_shelves", "savmap_lights", "savmap_signs"}
