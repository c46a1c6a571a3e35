"""What lies beside `view.html`: scripts that hand over a text, pictures as data URIs and covariances as base64, because
a page opened from a disk may run scripts that lie beside it, and may neither read what lies there nor draw pictures
from there into WebGL."""

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from savmap.files.atomic import file_name, write_text
from savmap.report.orthophotos import scaled_down
from savmap.report.viewer.data import joint_text
from savmap.report.viewer.packed import Entry
from savmap.types import JointCovariance, Orthophoto, RowMap, Still

FACES, SMALL, STILLS, JOINTS = "face", "face/small", "pano", "joint"
OLD_FACES, OLD_SMALL, OLD_STILLS = "face/old", "face/old/small", "pano/old"
PARTS = (SMALL, FACES, STILLS, OLD_SMALL, OLD_FACES, OLD_STILLS, JOINTS)
"""The folders of the scripts."""
NOTHING: Entry = {"face": None, "stills": [], "joint": ""}
"""What lies beside the page of a row that the map has not."""
LARGEST_PX = 4096
"""Of a side of the finer picture: every WebGL 2 takes that much, and phones have memory for it."""
JPEG_QUALITY = 85
PICTURE = re.compile(r'"data:image/jpeg;base64,[A-Za-z0-9+/=]*"\);\n')
"""A still's script after its head."""
MOST_JOINT = 300_000
"""Bytes of all rows' joint covariances that are in the page; more lie beside it."""

MARK = 8
"""Hexadecimal digits of the mark of a row whose name another has but for letters' case."""


def joints_apart(rows: Mapping[str, RowMap]) -> bool:
    """Whether the joint covariances are too large for the page."""
    sizes = [len(row.joint.covariance) for row in rows.values() if row.joint]
    return sum(2 * size * (size + 1) for size in sizes) > MOST_JOINT


def script_names(rows: Iterable[str]) -> dict[str, str]:
    """By row, what its scripts are called: as the row, and with a mark of their own where rows differ in nothing but
    letters' case, for many disks are blind to that. `!` is in no row's `file_name`."""
    names: dict[str, str] = {}
    taken: set[str] = set()
    for row in sorted(rows):
        name = file_name(row)
        if name.casefold() in taken:
            name = f"{name}!{hashlib.sha256(row.encode(errors='replace')).hexdigest()[:MARK]}"
        taken.add(name.casefold())
        names[row] = name
    return names


@dataclass(frozen=True, eq=False)
class Beside:
    """What of a row lies beside the page: its orthophoto, stills (None: those that lie there), and a joint covariance
    that is too large for the page."""

    photo: Orthophoto | None = None
    stills: Sequence[Still] | None = None
    joint: JointCovariance | None = None


def written_beside(name: str, row: Beside, folder: Path) -> Entry:
    """Write a row's scripts, called `name`; what the page must know of them. Raises OutputError."""
    stills, joint = row.stills, row.joint
    face = _written_face(name, row.photo, (SMALL, FACES), folder) if row.photo else None
    for still in stills or ():
        _write(folder, _still_path(name, still.frame), _address(still.picture.tobytes()))
    frames = _kept_frames(name, folder) if stills is None else [still.frame for still in stills]
    found = [{"frame": frame, "path": _still_path(name, frame)} for frame in frames]
    joint_path = f"{JOINTS}/{name}.js" if joint else ""
    if joint:
        _write(folder, joint_path, joint_text(joint))
    return {"face": face, "stills": found, "joint": joint_path}


def old_beside(name: str, photo: Orthophoto | None, source: Path | None, folder: Path) -> Entry:
    """Write the scripts of a row's earlier date, called `name`: its orthophoto, and copies of the stills that lie
    beside the earlier map's page, in `source`; what the page must know of them. Raises OutputError."""
    face = _written_face(name, photo, (OLD_SMALL, OLD_FACES), folder) if photo else None
    stills = []
    for frame in _kept_frames(name, source) if source and source.resolve() != folder.resolve() else ():
        path = f"{OLD_STILLS}/{name}-{frame:05d}.js"
        content = _content_of(_still_path(name, frame), source) if source else None
        if content is not None:
            write_text(folder / path, _head(path) + content)
            stills.append({"frame": frame, "path": path})
    return {"old face": face, "old stills": stills}


def _content_of(path: str, folder: Path) -> str | None:
    """A script's text after its head; None where savmap did not write it, or it cannot be read."""
    try:
        text = (folder / path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
    return text.removeprefix(_head(path)) if PICTURE.fullmatch(text.removeprefix(_head(path))) else None


def remove_others(beside: Iterable[Entry], folder: Path, with_stills: bool) -> None:
    """Take away the scripts of earlier maps that a page does not load, of rows that are gone too. `with_stills`: also
    stills, which cannot be made again from a map. What savmap did not write stays."""
    kept: set[str] = set()
    for entry in beside:
        faces = (entry["face"], entry.get("old face"))
        kept |= {path for face in faces if face for path in face["pictures"]}
        kept |= {entry["joint"], *(one["path"] for one in (*entry["stills"], *entry.get("old stills", ())))}
    for part in (part for part in PARTS if with_stills or part != STILLS):
        for path in _scripts(part, folder) - kept:
            (folder / path).unlink(missing_ok=True)


def _written_face(name: str, photo: Orthophoto, parts: tuple[str, str], folder: Path) -> Entry:
    """A small picture, and a finer one for the face view, each in its part of the folder."""
    paths = [f"{part}/{name}.js" for part in parts]
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


def _still_path(name: str, frame: int) -> str:
    return f"{STILLS}/{name}-{frame:05d}.js"


def _address(jpeg: bytes) -> str:
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode('ascii')}"


def _write(folder: Path, path: str, content: str) -> None:
    write_text(folder / path, f'{_head(path)}"{content}");\n')


def _head(path: str) -> str:
    return f"savmapPart({json.dumps(path)}, "


def _scripts(part: str, folder: Path) -> set[str]:
    """The paths of the scripts in a part of a folder that savmap wrote there."""
    if not (folder / part).is_dir():
        return set()
    files = (file for file in (folder / part).iterdir() if file.suffix == ".js" and file.is_file())
    return {f"{part}/{file.name}" for file in files if _is_own(file, f"{part}/{file.name}")}


def _is_own(file: Path, path: str) -> bool:
    head = _head(path).encode()
    try:
        with file.open("rb") as stream:
            return stream.read(len(head)) == head
    except OSError:
        return False


def _kept_frames(name: str, folder: Path) -> list[int]:
    """The frames of a row of which stills lie there."""
    if not (folder / STILLS).is_dir():
        return []
    named = re.compile(rf"{re.escape(name)}-(\d{{5,9}})\.js")
    found = (named.fullmatch(file.name) for file in (folder / STILLS).iterdir())
    return sorted(int(one[1]) for one in found if one)
