"""The shape of the code: who imports whom, and that the core names no structure."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CORE = sorted((ROOT / "savmap").rglob("*.py"))
PLUGINS = sorted((ROOT / "plugins").rglob("*.py"))
FORBIDDEN_TO_PLUGINS = tuple(
    f"savmap.{name}" for name in ("engine", "rooms", "cli", "io", "job", "run", "tools", "observe")
)
LAYERS = {
    "geometry": {"geometry"},
    "types": {"geometry", "errors", "types"},
    "graph": {"geometry", "types", "errors", "graph"},
    "stages": {"geometry", "types", "errors", "stages"},
    "assembly": {"geometry", "types", "errors", "graph", "assembly"},
    "report": {"geometry", "types", "errors", "report", "io", "runlog", "rooms", "contained"},
}


def imports(path: Path) -> set[str]:
    """Modules imported at run time, anywhere in a file."""
    found: set[str] = set()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    checking = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if id(node) in checking:
            continue
        if isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
        elif isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
    return found


def code_words(path: Path) -> set[str]:
    """Whole words of a file's names, strings and comments, without its docstrings (prose)."""
    text = path.read_text(encoding="utf-8")
    prose = {
        ast.get_docstring(node, clean=False) or ""
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
    }
    for one in sorted(prose, key=len, reverse=True):
        text = text.replace(one, "")
    text = re.sub(r"\b(np|torch|math)\.sign\b|text=\"light\"", "", text)
    return {word.lower() for word in re.findall(r"[A-Za-z]+", text)}


@pytest.mark.parametrize("path", CORE, ids=str)
def test_core_names_no_structure(path: Path) -> None:
    named = code_words(path) & {"shelf", "shelves", "light", "lights", "sign", "signs"}
    if "sim" in path.relative_to(ROOT).parts or path.stem == "scenes":
        named -= {"light", "lights"}  # a renderer's own word for what illuminates a scene
    assert not named


@pytest.mark.parametrize("path", PLUGINS, ids=str)
def test_plugins_use_the_public_door(path: Path) -> None:
    own = next(part for part in path.parts if part.startswith("savmap_"))
    for module in imports(path):
        assert not module.startswith(FORBIDDEN_TO_PLUGINS), f"{path} imports {module}"
        assert not (module.startswith("savmap_") and not module.startswith(own)), (
            f"{path} imports another plugin: {module}"
        )


@pytest.mark.parametrize("layer", LAYERS)
def test_imports_go_one_way(layer: str) -> None:
    for path in CORE:
        parts = path.relative_to(ROOT / "savmap").with_suffix("").parts
        if parts[0] != layer:
            continue
        for module in imports(path):
            if module.startswith("savmap."):
                assert module.split(".")[1] in LAYERS[layer], f"{path} imports {module}"


def test_only_graph_imports_gtsam() -> None:
    users = {path for path in CORE + PLUGINS if any(module.split(".")[0] == "gtsam" for module in imports(path))}
    assert users
    assert all("graph" in path.parts for path in users)
