"""The shape of the code: layers, no cycles, a core that names no structure, a laboratory apart, plain names, short lines."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SAVMAP = ROOT / "savmap"
TEMPLATES = {"project-template", "locates-camera"}
CORE = sorted(path for path in SAVMAP.rglob("*.py") if not TEMPLATES & set(path.parts))
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
    "report",
    "jobs",
    "demo",
    "cli",
    "apps",
    "lab",
]
"""Packages from the lowest to the highest: a package imports from itself and from lower ones. The laboratory is the
highest: nothing outside imports it."""
PRIVATE = {"site", "pipeline", "jobs", "assembly", "cli", "report", "apps"}
"""Packages that plugins do not import from."""
STRUCTURES = {"shelf", "shelves", "light", "lights", "lamp", "lamps", "sign", "signs", "rack", "racks"}
OTHER_MEANINGS = r"\b(np|torch|math)\.sign\b|text=\"light\""


VAGUE = {
    *("own", "one", "found", "told", "judged", "apart", "gone", "beside", "aside", "amiss", "there", "thing"),
    *("alone", "known", "look", "likes", "strange", "plain"),
}
"""Names that say nothing of what a variable holds."""
LONGEST_LINE = 120


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(ast.parse(text_of(path))))


def module_of(path: Path) -> str:
    """A file's module: "savmap.graph.keys"; a package's `__init__` has the package's name."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in CORE}


@cache
def imported(path: Path) -> frozenset[str]:
    """Modules that a file imports anywhere, under TYPE_CHECKING and in functions too."""
    names = set()
    for node in nodes_of(path):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {name if name in MODULES else node.module for name in inner}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return frozenset(names)


def words_of(path: Path) -> set[str]:
    """Whole words of a file's names, strings and comments, without its docstrings (prose)."""
    text = text_of(path)
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef
    prose = {ast.get_docstring(node, clean=False) or "" for node in nodes_of(path) if isinstance(node, kinds)}
    for docstring in sorted(prose, key=len, reverse=True):
        text = text.replace(docstring, "")
    return {word.lower() for word in re.findall(r"[A-Za-z]+", re.sub(OTHER_MEANINGS, "", text))}


def names_bound(path: Path) -> Iterator[str]:
    """Variables, arguments, functions and classes that a file gives a name."""
    for node in nodes_of(path):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name.lower()


def test_savmap_holds_packages_alone() -> None:
    entries = {path.name for path in SAVMAP.iterdir() if path.name != "__pycache__"}
    files = {"__init__.py", "__main__.py", "errors.py", "py.typed"}
    assert {name for name in entries if "." in name} == files
    assert entries - files == set(LAYERS) - {"errors"}


def test_imports_go_down() -> None:
    upwards = {}
    for path in CORE:
        parts = path.relative_to(SAVMAP).with_suffix("").parts
        if parts not in (("__init__",), ("__main__",)):  # the public surface and the command name what lies anywhere
            layers = {module.split(".")[1] for module in imported(path) if module.startswith("savmap.")}
            upwards[module_of(path)] = layers - set(LAYERS[: LAYERS.index(parts[0]) + 1])
    assert {module: layers for module, layers in upwards.items() if layers} == {}


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


def test_core_names_no_structure() -> None:
    named = {}
    for path in CORE:
        words = words_of(path) & STRUCTURES
        if path.is_relative_to(SAVMAP / "lab"):
            words -= {"light", "lights", "lamp", "lamps"}  # the renderers' words for what illuminates a scene
        if "site" in path.parts:
            words -= {"rack", "racks"}  # `layout.rack_m` is a key of site files: what stands between two faces
        named[module_of(path)] = words
    assert {module: words for module, words in named.items() if words} == {}


def test_plugins_use_the_public_door() -> None:
    wrong = []
    for path in PLUGINS:
        package = next(part for part in path.parts if part.startswith("savmap_"))
        for module in imported(path):
            parts = module.split(".")
            private = parts[0] == "savmap" and len(parts) > 1 and parts[1] in PRIVATE
            if private or (parts[0].startswith("savmap_") and parts[0] != package):
                wrong.append(f"{path} imports {module}")
    assert wrong == []


def in_lab(module: str) -> bool:
    return re.match(r"(savmap|savmap_\w+)\.lab\b", module) is not None


def test_plugins_for_mapping_import_nothing_of_the_laboratory() -> None:
    """`test_imports_go_down` says the same of savmap."""
    outside = [path for path in PLUGINS if "lab" not in path.parts]
    assert {path: lab for path in outside if (lab := [name for name in imported(path) if in_lab(name)])} == {}


@pytest.mark.slow
def test_all_that_maps_is_imported_without_the_laboratory() -> None:
    names = [name for name in MODULES if not in_lab(name) and not name.endswith("__main__")]
    code = f"""
import sys
from importlib import import_module
from savmap.plugin.manager import load_installed
for name in {names}:
    import_module(name)
assert load_installed().classes
print(*sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=600)
    assert "savmap.pipeline.row" in done.stdout.split()
    assert [module for module in done.stdout.split() if in_lab(module)] == []


def test_only_graph_imports_gtsam() -> None:
    users = {path for path in CORE + PLUGINS if any(module.split(".")[0] == "gtsam" for module in imported(path))}
    assert users
    assert all("graph" in path.parts for path in users)


def test_tests_of_the_core_import_no_plugin() -> None:
    paths = (path.relative_to(ROOT) for path in (ROOT / "tests").rglob("*.py"))
    core = [path for path in paths if "plugins" not in path.parts and "integration" not in path.parts]
    plugins = {"savmap_shelves", "savmap_lights", "savmap_signs"}
    users = {path for path in core if {module.split(".")[0] for module in imported(ROOT / path)} & plugins}
    assert users == set()


def test_names_say_what_they_hold() -> None:
    kept = CORE + PLUGINS
    vague = {module_of(path): VAGUE & set(names_bound(path)) for path in kept}
    vague["savmap.lab.sim.scene.files"].remove("look")  # a key of scene files
    assert {module: names for module, names in vague.items() if names} == {}


def test_lines_are_short() -> None:
    kept = CORE + PLUGINS
    long = {module_of(path): sum(len(line) > LONGEST_LINE for line in text_of(path).splitlines()) for path in kept}
    assert {module: count for module, count in long.items() if count} == {}
