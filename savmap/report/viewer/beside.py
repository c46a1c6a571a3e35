"""What lies beside `view.html`: scripts that hand over a text, pictures as data URIs and covariances as base64, because a page opened from a
disk may run scripts that lie beside it, and may neither read what lies there nor draw pictures from there into WebGL."""

import base64
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from savmap.files.atomic import file_name, write_text
from savmap.report.orthophotos import scaled_down
from savmap.report.viewer.data import Entry, joint_text
from savmap.types import JointCovariance, Orthophoto, RowMap, Still

FACES, SMALL, STILLS, JOINTS = "face", "face/small", "pano", "joint"
LARGEST_PX = 4096
"""Of a side of the finer picture: every WebGL 2 takes that much, and phones have memory for it."""
JPEG_QUALITY = 85
MOST_JOINT = 300_000
"""Bytes of all rows' joint covariances that are in the page; more lie beside it."""


def joints_apart(rows: Mapping[str, RowMap]) -> bool:
    """Whether the joint covariances are too large for the page."""
    sizes = [len(row.joint.covariance) for row in rows.values() if row.joint]
    return sum(2 * size * (size + 1) for size in sizes) > MOST_JOINT


def written_beside(
    row: str, photo: Orthophoto | None, stills: Sequence[Still] | None, joint: JointCovariance | None, folder: Path
) -> Entry:
    """Write a row's scripts and take away those of an earlier map; what the page must know of them. `stills`: None for those that lie there.
    Raises OutputError."""
    face = _written_face(row, photo, folder) if photo else None
    for still in stills or ():
        _write(folder, _still_path(row, still.frame), _address(still.picture.tobytes()))
    frames = _kept_frames(row, folder) if stills is None else [still.frame for still in stills]
    found = [{"frame": frame, "path": _still_path(row, frame)} for frame in frames]
    joint_path = f"{JOINTS}/{file_name(row)}.js" if joint else ""
    if joint:
        _write(folder, joint_path, joint_text(joint))
    kept = {*(face["pictures"] if face else ()), *(one["path"] for one in found), joint_path}
    for path in _written(row, folder) - kept:
        (folder / path).unlink(missing_ok=True)
    return {"face": face, "stills": found, "joint": joint_path}


def _written_face(row: str, photo: Orthophoto, folder: Path) -> Entry:
    """A small picture, and a finer one for the face view."""
    name = file_name(row)
    paths = [f"{SMALL}/{name}.js", f"{FACES}/{name}.js"]
    _write(folder, paths[0], _address(scaled_down(photo)))
    _write(folder, paths[1], _address(_at_most(photo)))
    return {
        "origin_m": np.round(photo.origin, 6).tolist(),
        "right": photo.right.tolist(),
        "up": photo.up.tolist(),
        "width_m": photo.width * photo.pixel_m,
        "height_m": photo.height * photo.pixel_m,
        "pictures": paths,
    }


def _at_most(photo: Orthophoto) -> bytes:
    """The picture's JPEG, smaller where graphics would not take it."""
    scale = LARGEST_PX / max(photo.width, photo.height)
    if scale >= 1:
        return photo.picture.tobytes()
    image = np.asarray(cv2.imdecode(photo.picture, cv2.IMREAD_COLOR), np.uint8)
    size = max(round(scale * photo.width), 1), max(round(scale * photo.height), 1)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()


def _still_path(row: str, frame: int) -> str:
    return f"{STILLS}/{file_name(row)}-{frame:05d}.js"


def _address(jpeg: bytes) -> str:
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode('ascii')}"


def _write(folder: Path, path: str, content: str) -> None:
    write_text(folder / path, f'savmapPart({json.dumps(path)}, "{content}");\n')


def _written(row: str, folder: Path) -> set[str]:
    """A row's scripts that lie there."""
    name = file_name(row)
    alone = {f"{part}/{name}.js" for part in (SMALL, FACES, JOINTS)}
    stills = {_still_path(row, frame) for frame in _kept_frames(row, folder)}
    return {path for path in alone | stills if (folder / path).is_file()}


def _kept_frames(row: str, folder: Path) -> list[int]:
    """The frames of a row of which stills lie there."""
    if not (folder / STILLS).is_dir():
        return []
    named = re.compile(rf"{re.escape(file_name(row))}-(\d{{5,9}})\.js")
    found = (named.fullmatch(file.name) for file in (folder / STILLS).iterdir())
    return sorted(int(one[1]) for one in found if one)
