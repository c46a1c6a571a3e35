"""What a file that savmap writes is, by the `format` that it names: for errors where one is given in place of
another."""

import re
from pathlib import Path

from savmap.files.texts import head_of

FORMAT = re.compile(r'"format"\s*:\s*"(savmap-[a-z]+)"')
KINDS = {
    "savmap-map": "a map",
    "savmap-site": "a site file",
    "savmap-survey": "a survey",
    "savmap-run": "the record of a run",
    "savmap-comparison": "a comparison of two maps",
    "savmap-inspection": "an inspection",
}
HEAD = 1 << 16
"""Bytes of a file in which its format stands."""


def kind_of(content: object) -> str:
    """What the content of a JSON file is, such as "a survey"; empty where it names no format of savmap's."""
    return _described(content.get("format")) if isinstance(content, dict) else ""


def kind_of_file(path: Path) -> str:
    """The same of a file, however large; empty where it cannot be read."""
    head = head_of(path, HEAD).decode(errors="replace")
    match = FORMAT.search(head) if head.lstrip().startswith("{") else None
    return _described(match[1]) if match else ""


def _described(name: object) -> str:
    if not isinstance(name, str) or not name.startswith("savmap-"):
        return ""
    return KINDS.get(name, f"a file of the format {name}")
