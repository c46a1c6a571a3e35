"""`savmap init`: a commented site file to start from, and the JSON Schema that its first line points editors to."""

import json
import os
import string
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic_core import PydanticUndefined, to_jsonable_python

from savmap.errors import OutputError
from savmap.files.atomic import write_text
from savmap.files.texts import bounded_text
from savmap.plugin.manager import lacking, load_installed
from savmap.site.schema import TITLE, schema_text

if TYPE_CHECKING:
    from savmap.video.reader import VideoInfo

SCHEMA = "site.schema.json"
HEAD = f"""\
# yaml-language-server: $schema={SCHEMA}
# A site for savmap. Lengths are metres, times seconds, angles degrees; paths are relative to this file.
# A "#" without a space after it, or with more than one, stands before a setting that is not in use: take it away.
# `savmap check` says whether all is well and what a run will take; `savmap map` maps. All keys: docs/site-file.md.
"""
REFERENCES = """
# What is known without mapping, for all rows; rows may say otherwise. The map's scale comes from here: give the
# camera's height, or a length, or a marker, for every row.
#references:
#  camera_height_m: {value: 3.05, sigma: 0.02}  # above the floor
#  travel_m: 15  # roughly how far the camera goes: a first guess
#  lengths:  # measured between labelled edges of the map
#    - {between: [upright 1 / left, upright 5 / right], value: 14.162, sigma: 0.003}
#  markers:  # fiducial markers somewhere in the footage
#    - {dictionary: tag36h11, id: 7, size_m: 0.20, sigma_m: 0.0005}

# What a surveyor measured, if anything: scores are printed, and drawn under the map.
#survey: survey.json

# For all passes; rows and passes may say otherwise.
#fps: 15  # sampling rate
#appearance: false  # whether points of any kind help with the camera's motion

# What of the camera is estimated with the map.
#calibration:
#  panorama: false  # the fit of the panorama's two halves
#  vertical_scale: false  # one factor of all elevations, of panoramas that were cropped
#  lens_distance: false  # the distance between the two lenses, whose seam crosses the face
#  rolling_shutter: false  # the time from the first row of the panorama to the last one

# Where rows stand in the site's frame, if they are regularly spaced: face to face across an aisle, then back to back,
# and so on. A row may have a `place` of its own instead.
#layout:
#  aisle_m: 3.0  # from a face to the one across the aisle
#  rack_m: 2.2  # from a face to the one behind its back
#  length_m: 14.0  # from the outer edge of a row's first element to the outer edge of its last

# One face of one aisle each. The two faces of an aisle that were seen on one drive are two rows with the same video
# and times, one with `side: left`, one with `side: right`.
rows:
"""
OF_PASS = """\
#        side: left  # the hand the face is on as one drives along
#        views:  # aimed by hand; wins over the automatic aim
#          face: {yaw_deg: -90, pitch_deg: 0, roll_deg: 0, hfov_deg: 120}
"""
OF_ROW = """\
#    place: {x_m: 0, z_m: 0, heading_deg: 0}  # the row's left end, as one faces it; which way it runs to the right
"""


def start(videos: Sequence[Path], path: Path, force: bool = False) -> tuple[Path, Path]:
    """Write a site file with a row for each video, and the schema beside it; gives the two paths.

    Raises VideoError for a video that cannot be used, OutputError where a file is there already and `force` is not
    given.
    """
    from savmap.video.reader import probe

    infos = [probe(video) for video in videos]
    schema = path.with_name(SCHEMA)
    if not force and path.exists():
        raise OutputError(f"{path}: is there already; choose another file with -o, or overwrite it with --force")
    if not force and schema.exists() and not _is_ours(schema):
        raise OutputError(f"{schema}: is there already and is not savmap's; choose another folder with -o, or --force")
    write_text(schema, schema_text(load_installed().classes))
    write_text(path, starter_text(infos, path.parent))
    return path, schema


def starter_text(videos: "Sequence[VideoInfo]", folder: Path) -> str:
    """A commented site file for videos, in a folder; with a made-up video where there are none. It is valid as it
    stands."""
    rows = [_row(name, info, folder) for name, info in zip(_names(len(videos)), videos, strict=True)]
    made_up = f"  A:\n    passes:\n      - video: aisle.mp4\n{OF_PASS}{OF_ROW}"
    return HEAD + _plugins() + REFERENCES + ("\n".join(rows) or made_up)


def _row(name: str, info: "VideoInfo", folder: Path) -> str:
    video = os.path.relpath(info.path.parent.resolve() / info.path.name, folder.resolve())
    text = json.dumps(video, ensure_ascii=False)
    what = f"{info.width}x{info.height} {info.codec}, {info.rate_fps:.4g} frames a second"
    times = f"        start_s: 0\n        end_s: {int(info.duration_s * 100) / 100:.12g}\n"
    return f"  {name}:\n    passes:\n      - video: {text}  # {what}\n{times}{OF_PASS}{OF_ROW}"


def _names(count: int) -> Iterable[str]:
    letters = string.ascii_uppercase
    return letters[:count] if count <= len(letters) else [str(number) for number in range(1, count + 1)]


def _plugins() -> str:
    """The section `plugins:` with what every installed plugin lets one set, not in use; nor is a plugin that lacks a
    package or is broken."""
    lines = ["", "# Which structures to map, with settings for all rows; rows may say otherwise.", "plugins:"]
    plugins = load_installed()
    lines += [f"#  {name}:  # {reason}" for name, reason in plugins.broken.items()]
    for name, plugin in plugins.classes.items():
        missing = " and ".join(lacking(plugin))
        lines.append(f"#  {name}:  # {missing} not installed" if missing else f"  {name}:")
        for key, field in plugin.Config.model_fields.items():
            inner = _keys(field.annotation)
            says = " ".join((field.description or "").split()) + (f" Keys: {', '.join(inner)}." if inner else "")
            lines.append(
                f"#    {key}: {_value(field.get_default(call_default_factory=True))}" + (f"  # {says}" if says else "")
            )
    return "\n".join(lines) + "\n"


def _value(default: object) -> str:
    return "null" if default is PydanticUndefined else json.dumps(to_jsonable_python(default), ensure_ascii=False)


def _keys(annotation: Any) -> list[str]:
    """Keys of a setting that is a section."""
    options = (annotation, *getattr(annotation, "__args__", ()))
    return [key for option in options for key in getattr(option, "model_fields", {})]


def _is_ours(schema: Path) -> bool:
    try:
        return bool(json.loads(bounded_text(schema)).get("title") == TITLE)
    except (OSError, ValueError, AttributeError):
        return False
