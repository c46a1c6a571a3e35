"""Pictures of the views that the aim chooses, one a pass."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import cv2

from savmap.eyes import Eyes
from savmap.io.files import write_bytes
from savmap.observe import aim_pass, pass_names
from savmap.rooms import Room
from savmap.site import Pass
from savmap.stages.aim import Scout
from savmap.stages.overview import overview
from savmap.stages.render import Renderer
from savmap.store import file_name
from savmap.types import Floats


def previews(
    row: str, passes: Sequence[Pass], rooms: Sequence[Room], folder: Path, attitudes: Mapping[str, Floats]
) -> Iterator[Path]:
    """Write a picture of the chosen views of each pass of a row over its key frames; gives the paths written. `attitudes`:
    world_from_rig (3, 3) at the start of a pass where an earlier map gives it."""
    eyes = Eyes(rooms)
    for name, one in zip(pass_names(passes), passes, strict=True):
        path = folder / picture_name(row, name)
        preview(name, one, rooms, eyes, path, attitudes.get(name))
        yield path


def preview(
    name: str,
    one: Pass,
    rooms: Sequence[Room],
    eyes: Eyes,
    path: Path,
    attitude: Floats | None = None,
) -> Scout:
    """Write the picture of one pass; gives what was looked at to choose the views. Raises SavmapError's kinds."""
    renderer = Renderer()
    aimed, scout = aim_pass(name, one, rooms, eyes, renderer, attitude)
    picture = overview(scout.keys, list(dict.fromkeys(aimed.views().values())), renderer)
    write_bytes(path, cv2.imencode(".jpg", picture[..., ::-1])[1].tobytes())
    return scout


def picture_name(row: str, name: str) -> str:
    """Of a pass's picture: "views-A-pass-1.jpg"."""
    return f"views-{file_name(row)}-{name.replace(' ', '-')}.jpg"
