"""Passes as rows of a site file, for a person to confirm: a new file, or rows added to an existing one."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.nodes import CollectionNode, MappingNode, Node

from savmap.apps.split.contact_sheet import clock
from savmap.apps.split.records import DetectedPass
from savmap.errors import OutputError, SiteError, visible
from savmap.files.atomic import read_text, write_text
from savmap.files.yaml_text import path_text
from savmap.site.load import load_site
from savmap.site.model import Pass, Row

_STEM = "pass"
_HEAD = """\
# Passes that `savmap split` found in {video}. Look through them, with the contact sheet beside you:
# - strike out rows that are no rows, and name the others as you like;
# - times are seconds in the video: check them where the confidence is below 0.5;
# - a face seen in several passes is one row: put its passes under one name;
# - add what is known (references, plugins, survey), see docs/site-file.md, then run `savmap check` and `savmap map` on
#   this file.
format: savmap-site
version: 1
"""


def check_new(path: Path) -> None:
    """Raise OutputError where the file exists already."""
    if path.exists():
        raise OutputError(f"{path}: already exists; add the rows to it with --into, or give another name with -o")


def new_site(passes: Sequence[DetectedPass], video: Path, path: Path) -> None:
    """Write a site file with a row for each side of each pass. Raises OutputError where the file exists already."""
    check_new(path)
    write_text(
        path, _HEAD.format(video=visible(video.name)) + "rows:\n" + _rows(passes, _relative(video, path), 1, "  ")
    )


def add_to_site(passes: Sequence[DetectedPass], video: Path, path: Path) -> None:
    """Add the rows to the end of a site file's `rows`, and leave every other byte as it is.

    Raises SiteError where the file is not a site file, or has its rows within braces.
    """
    load_site(path)
    text = read_text(path)
    root = YAML(typ="safe", pure=True).compose(text)
    pairs = root.value if isinstance(root, MappingNode) else []
    rows = next(value for key, value in pairs if key.value == "rows")
    if not isinstance(rows, MappingNode) or rows.flow_style:
        raise SiteError(
            f"{path}:{rows.start_mark.line + 1}: rows within braces cannot be added to; write them line by line"
        )
    names = [str(key.value) for key, _ in rows.value]
    taken = [int(match[1]) for name in names if (match := re.match(rf"{_STEM}-(\d+)-", name))]
    indent = " " * rows.value[0][0].start_mark.column
    at = _past_comments(text, _after(text, rows.value[-1][1]), indent)
    before = text[:at] if text[:at].endswith("\n") else text[:at] + "\n"
    added = _rows(passes, _relative(video, path), max(taken, default=0) + 1, indent)
    write_text(
        path, f"{before}{indent}# found by `savmap split` in {visible(video.name)}: to be confirmed\n{added}{text[at:]}"
    )


def rows_of(passes: Sequence[DetectedPass], recorded: Pass, first: int = 1) -> dict[str, Row]:
    """The rows that `new_site` writes, for a site that is mapped at once: `recorded` is the whole recording as a pass,
    `first` the first pass's number."""
    return {
        _name(number, side): Row(
            passes=(recorded.model_copy(update={"start_s": detected.start_s, "end_s": detected.end_s, "side": side}),)
        )
        for number, detected in enumerate(passes, start=first)
        for side in detected.sides
    }


def _name(number: int, side: str) -> str:
    return f"{_STEM}-{number}-{side}"


def _after(text: str, node: Node) -> int:
    """The index in the text at which the line after a node begins."""
    while isinstance(node, CollectionNode) and node.value and not node.flow_style:
        last = node.value[-1]
        node = last[1] if isinstance(last, tuple) else last
    end = text.find("\n", max(node.end_mark.index - 1, node.start_mark.index))
    return len(text) if end < 0 else end + 1


def _past_comments(text: str, at: int, indent: str) -> int:
    """The index after the comments from `at` on that belong to the last row: they are indented further than its
    name."""
    match = re.compile(rf"(?:{indent} +#[^\n]*(?:\n|$))*").match(text, at)
    return match.end() if match else at


def _rows(passes: Sequence[DetectedPass], video: str, first: int, indent: str) -> str:
    lines = []
    for number, detected in enumerate(passes, start=first):
        span = f"{clock(detected.start_s)} to {clock(detected.end_s)}"
        heading = f"heading {detected.heading_deg:+.0f} degrees against the first pass"
        lines.append(f"# pass {number}: {span}, {heading}, confidence {detected.confidence:.2f}")
        for side in detected.sides:
            lines += [
                f"{_name(number, side)}:",
                "  passes:",
                f"    - video: {path_text(video)}",
                f"      start_s: {detected.start_s:.2f}",
                f"      end_s: {detected.end_s:.2f}",
                f"      side: {side}",
            ]
    return "".join(f"{indent}{line}\n" for line in lines)


def _relative(video: Path, site: Path) -> str:
    """The video's path from the site file's folder."""
    try:
        return Path(os.path.relpath(video.resolve(), site.resolve().parent)).as_posix()
    except ValueError:
        return video.resolve().as_posix()
