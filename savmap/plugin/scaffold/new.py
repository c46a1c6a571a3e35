"""A project for a new plugin, from those that lie beside this file: the same, under another name, with a network."""

import ast
import keyword
import os
import re
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path

from savmap.errors import OutputError, SiteError
from savmap.files import yaml_text
from savmap.files.atomic import reason
from savmap.plugin.manager import installed
from savmap.plugin.scaffold.stub import stub_network

TEMPLATE = Path(__file__).parent / "project-template"
LOCATES_CAMERA = Path(__file__).parent / "locates-camera"
TEMPLATE_NAME, TITLE, LAB = "pillars", "Pillars", "PillarsLab"
PART = "part"
"""Beside an object's number in a track's place (`savmap.plugin.track_of`)."""
NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
LONGEST = 40
LEFT_OUT = {"__pycache__", ".pytest_cache", ".ruff_cache", ".mypy_cache"}


def new_plugin(name: str, folder: Path | None = None, locates_camera: bool = False) -> Iterator[str]:
    """Write the project of a plugin into a new folder (default: savmap-NAME here), whole or not at all; yields lines
    for the user.

    locates_camera: one that finds the face and locates the camera by itself, so that it can be mapped alone.

    Raises SiteError for a name that will not do, OutputError for a folder that is there already or cannot be written.
    """
    require_name(name)
    folder = folder or Path(f"savmap-{name.replace('_', '-')}")
    write_folder(project_files(name, locates_camera), folder)
    yield f"wrote {folder}: a plugin `{name}` with the class `{thing_of(name)}`"
    yield f"next: cd {folder} && python -m pip install -e '.[test]' && python -m pytest; its README.md says what then"


def require_name(name: str) -> None:
    """Raises SiteError for what cannot name a new plugin: the name goes into a Python package, site files and the map's
    labels."""
    if not NAME.fullmatch(name) or len(name) > LONGEST:
        near = re.sub(r"[^a-z0-9]+", "_", name.lower()).lstrip("_0123456789")[:LONGEST].rstrip("_")
        hint = f", such as `{near}`" if NAME.fullmatch(near) else ""
        raise SiteError(
            f"plugin name `{name}`: give at most {LONGEST} small letters, digits and single underscores, "
            f"a letter first{hint}"
        )
    for word in (name, thing_of(name)):
        if yaml_text.load(word) != word:
            raise SiteError(
                f"plugin name `{name}`: `{word}` is a word of YAML, in which site files are; choose another"
            )
    title = title_of(name)
    if keyword.iskeyword(title) or title in names_of(TEMPLATE) | names_of(LOCATES_CAMERA):
        raise SiteError(f"plugin name `{name}`: the project's own code calls something `{title}`; choose another")
    if title.startswith("Test"):
        raise SiteError(f"plugin name `{name}`: pytest takes a class `{title}` for a test; choose another")
    if thing_of(name) == PART:
        raise SiteError(f"plugin name `{name}`: savmap calls the points of any object `{PART}`; choose another")
    if name in installed():
        raise SiteError(
            f"plugin name `{name}`: a plugin of that name is installed ({installed()[name].value}); choose another"
        )


def thing_of(name: str) -> str:
    """What one of a plugin's things is called: pillars, pillar; its network's class and the labels in the map."""
    return name.removesuffix("s") if len(name) > 2 and not name.endswith(("ss", "us", "is")) else name


def title_of(name: str) -> str:
    """What the plugin's class is called: lamp_posts, LampPosts."""
    return "".join(part.capitalize() for part in name.split("_"))


@cache
def names_of(folder: Path) -> frozenset[str]:
    """All names in a project's code, but for its plugin's classes: a class of such a name would get into its way."""
    nodes = [node for path in folder.rglob("*.py") for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
    return frozenset(str(getattr(node, key, "")) for node in nodes for key in ("id", "arg", "name", "asname")) - {
        TITLE,
        LAB,
    }


def project_files(name: str, locates_camera: bool = False) -> dict[str, bytes]:
    """A new project's files by their paths in it; those of a plugin that locates the camera take the place of
    others."""
    folders = (TEMPLATE, LOCATES_CAMERA) if locates_camera else (TEMPLATE,)
    files = {
        renamed(str(path.relative_to(folder).as_posix()), name): renamed(
            path.read_text(encoding="utf-8"), name
        ).encode()
        for folder in folders
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not LEFT_OUT & set(path.parts)
    }
    return files | {f"src/savmap_{name}/model/{name}.onnx": stub_network(thing_of(name), version("savmap"))}


def renamed(text: str, name: str) -> str:
    """A text of the template with its plugin's name, and what it calls one thing, replaced."""
    words: Mapping[str, str] = {
        f"savmap-{TEMPLATE_NAME}": f"savmap-{name.replace('_', '-')}",
        TITLE: title_of(name),
        TEMPLATE_NAME: name,
        "pillar": thing_of(name),
    }
    return re.sub("|".join(words), lambda match: words[match.group()], text)


def write_folder(files: Mapping[str, bytes], folder: Path) -> None:
    """Write files into a folder that is not there yet, or is empty: all of them or none. Raises OutputError."""
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise OutputError(f"{folder}: is there already, and nothing is overwritten; choose another folder with -o")
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".savmap-", dir=folder.parent) as temporary:
            part = Path(temporary) / "project"
            for name, content in files.items():
                (part / name).parent.mkdir(parents=True, exist_ok=True)
                (part / name).write_bytes(content)
            os.replace(part, folder)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({reason(error)}); choose another folder with -o") from error
