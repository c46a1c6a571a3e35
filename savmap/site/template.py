"""`savmap init`: a commented site file to start from, and the JSON Schema that its first line points editors to."""

import json
import os
import string
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic_core import PydanticUndefined, to_jsonable_python

from savmap.errors import OutputError
from savmap.files.atomic import write_text
from savmap.files.texts import bounded_text
from savmap.files.yaml_text import path_text
from savmap.plugin.manager import lacking, load_installed
from savmap.site.schema import TITLE, schema_text

if TYPE_CHECKING:
    from savmap.video.reader import VideoInfo

SCHEMA = "site.schema.json"
TEMPLATE = Path(__file__).with_name("starter.yaml.jinja")


def start(videos: Sequence[Path], path: Path, force: bool = False) -> tuple[Path, Path]:
    """Write a site file with a row for each video, and the schema beside it; gives the two paths.

    Raises VideoError for a video that cannot be used, SiteError for one whose name cannot be written, OutputError where
    a file is there already and `force` is not given.
    """
    from savmap.video.reader import probe

    infos = [probe(video) for video in videos]
    schema = path.with_name(SCHEMA)
    if not force and path.exists():
        raise OutputError(f"{path}: is there already; choose another file with -o, or overwrite it with --force")
    if not force and schema.exists() and not _is_ours(schema):
        raise OutputError(f"{schema}: is there already and is not savmap's; choose another folder with -o, or --force")
    text = starter_text(infos, path.parent)
    write_text(schema, schema_text(load_installed().classes))
    write_text(path, text)
    return path, schema


def starter_text(videos: "Sequence[VideoInfo]", folder: Path) -> str:
    """A commented site file for videos, in a folder; with a made-up video where there are none. It is valid as it
    stands."""
    from jinja2 import Template  # slow to import

    letters = string.ascii_uppercase
    names = letters if len(videos) <= len(letters) else map(str, range(1, len(videos) + 1))
    rows: list[tuple[str, str, Sequence[str]]] = []
    for name, info in zip(names, videos, strict=False):
        video = path_text(os.path.relpath(info.path.parent.resolve() / info.path.name, folder.resolve()))
        what = f"{info.width}x{info.height} {info.codec}, {info.rate_fps:.4g} frames a second"
        times = ("start_s: 0", f"end_s: {int(info.duration_s * 100) / 100:.12g}")
        rows.append((name, f"{video}  # {what}", times))
    template = Template(TEMPLATE.read_text(encoding="utf-8"), trim_blocks=True, keep_trailing_newline=True)
    return str(template.render(schema=SCHEMA, plugins=_plugins(), rows=rows or [("A", "aisle.mp4", ())]))


def _plugins() -> Iterator[str]:
    """Lines of the section `plugins:` with what every installed plugin lets one set, not in use; nor is a plugin that
    lacks a package or is broken."""
    plugins = load_installed()
    yield from (f"#  {name}:  # {reason}" for name, reason in plugins.broken.items())
    for name, plugin in plugins.classes.items():
        missing = " and ".join(lacking(plugin))
        yield f"#  {name}:  # {missing} not installed" if missing else f"  {name}:"
        for key, field in plugin.Config.model_fields.items():
            options = (field.annotation, *getattr(field.annotation, "__args__", ()))
            inner = [key for option in options for key in getattr(option, "model_fields", {})]  # of a section
            says = " ".join((field.description or "").split()) + (f" Keys: {', '.join(inner)}." if inner else "")
            default = field.get_default(call_default_factory=True)
            value = None if default is PydanticUndefined else to_jsonable_python(default)
            yield f"#    {key}: {json.dumps(value, ensure_ascii=False)}" + (f"  # {says}" if says else "")


def _is_ours(schema: Path) -> bool:
    try:
        return bool(json.loads(bounded_text(schema)).get("title") == TITLE)
    except (OSError, ValueError, AttributeError):
        return False
