"""`view.html`: the viewer's script, style and data as one file that asks nothing of a network; and what lies beside it.

Beside it lie scripts that hand over a text, pictures as data URIs and covariances as base64: a page opened from a disk
may run scripts from there, and may neither read what lies there nor draw pictures from there into WebGL."""

import base64
import gzip
import hashlib
import html
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from string import Template

import cv2
import numpy as np

from savmap.apps.viewer.data import Before, Entry, Places, joint_text, page_data
from savmap.files.atomic import file_name, write_text
from savmap.report.orthophotos import scaled_down
from savmap.report.templating import digest, jpeg_address
from savmap.types import Evaluation, JointCovariance, Orthophoto, SiteMap, Still

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


def write_row_scripts(
    name: str,
    photo: Orthophoto | None,
    stills: Sequence[Still] | None,
    joint: JointCovariance | None,
    folder: Path,
) -> Entry:
    """Write a row's scripts, called `name`: its orthophoto, stills (None: those that lie there), and a joint covariance
    that is too large for the page. Returns what the page must know of them. Raises OutputError."""
    face = _written_face(name, photo, (SMALL, FACES), folder) if photo else None
    for still in stills or ():
        _write(folder, _still_path(name, still.frame), jpeg_address(still.picture.tobytes()))
    frames = _kept_frames(name, folder) if stills is None else [still.frame for still in stills]
    joint_path = f"{JOINTS}/{name}.js" if joint else ""
    if joint:
        _write(folder, joint_path, joint_text(joint))
    still_entries = [{"frame": frame, "path": _still_path(name, frame)} for frame in frames]
    return {"face": face, "stills": still_entries, "joint": joint_path}


def write_old_row_scripts(name: str, photo: Orthophoto | None, source: Path | None, folder: Path) -> Entry:
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


def remove_others(entries: Iterable[Entry], folder: Path, with_stills: bool) -> None:
    """Take away the scripts of earlier maps that a page does not load, of rows that are gone too. `with_stills`: also
    stills, which cannot be made again from a map. What savmap did not write stays."""
    kept: set[str] = set()
    for entry in entries:
        faces = (entry["face"], entry.get("old face"))
        kept |= {path for face in faces if face for path in face["pictures"]}
        kept |= {entry["joint"], *(still["path"] for still in (*entry["stills"], *entry.get("old stills", ())))}
    for part in (part for part in PARTS if with_stills or part != STILLS):
        for path in _scripts(part, folder) - kept:
            (folder / path).unlink(missing_ok=True)


def _written_face(name: str, photo: Orthophoto, parts: tuple[str, str], folder: Path) -> Entry:
    """A small picture, and a finer one for the face view, each in its part of the folder."""
    paths = [f"{part}/{name}.js" for part in parts]
    _write(folder, paths[0], jpeg_address(scaled_down(photo)))
    _write(folder, paths[1], jpeg_address(_at_most(photo)))
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


def _write(folder: Path, path: str, content: str) -> None:
    write_text(folder / path, f'{_head(path)}"{content}");\n')


def _head(path: str) -> str:
    return f"savmapPart({json.dumps(path)}, "


def _scripts(part: str, folder: Path) -> set[str]:
    """The paths of the scripts in a part of a folder that savmap wrote there."""
    scripts = set[str]()
    for path in (f"{part}/{file.name}" for file in (folder / part).glob("*.js")):
        head = _head(path).encode()
        with suppress(OSError), (folder / path).open("rb") as stream:
            scripts |= {path} if stream.read(len(head)) == head else set()
    return scripts


def _kept_frames(name: str, folder: Path) -> list[int]:
    """The frames of a row of which stills lie there."""
    if not (folder / STILLS).is_dir():
        return []
    named = re.compile(rf"{re.escape(name)}-(\d{{5,9}})\.js")
    matches = (named.fullmatch(file.name) for file in (folder / STILLS).iterdir())
    return sorted(int(match[1]) for match in matches if match)


POLICY = (
    "default-src 'none'; script-src 'sha256-{script}' 'self' file:; style-src 'sha256-{style}'; "
    "img-src data: blob:; base-uri 'none'; form-action 'none'"
)
"""Scripts: the page's own, and the pictures' that lie beside it (`file:` is what some browsers call 'self' there)."""


ORIGIN = re.compile(rb'<meta name="savmap-view" content="map=(\w*) survey=(\w*) against=(\w*) by=([^"]*)">')
HEAD = 4096
"""Bytes of a page in which its origin stands."""


@dataclass(frozen=True)
class Origin:
    """The files that a page is made of: SHA-256 of the map's, of the survey's and of the earlier map's; empty for none,
    or where nobody told."""

    map_digest: str = ""
    survey_digest: str = ""
    against_digest: str = ""

    def is_of(self, page: Path) -> bool:
        """Whether a page was made of this map by this viewer, and, where there are any here, with this survey and this
        earlier map."""
        try:
            with page.open("rb") as stream:
                match = ORIGIN.search(stream.read(HEAD))
        except OSError:
            return False
        if match is None or not self.map_digest:
            return False
        map_digest, survey_digest, against_digest, by = (part.decode(errors="replace") for part in match.groups())
        asked = self.survey_digest in ("", survey_digest) and self.against_digest in ("", against_digest)
        return map_digest == self.map_digest and asked and by == _viewer()

    def __str__(self) -> str:
        return f"map={self.map_digest} survey={self.survey_digest} against={self.against_digest} by={_viewer()}"


@dataclass(frozen=True, eq=False)
class View:
    """What the viewer shows: a map, its scores where there is a survey, and by row its orthophoto and stills, where
    there are any; None for the stills that lie where the page is written. `before`: an earlier date to show with it.
    `places`: by row and plugin, places between structures that have a name, such as what lies between two of them,
    whose sizes are shown."""

    site_map: SiteMap
    evaluation: Evaluation | None = None
    title: str = "Site map"
    photos: Mapping[str, Orthophoto] = field(default_factory=dict)
    stills: Mapping[str, Sequence[Still]] | None = None
    origin: Origin = Origin()
    before: Before | None = None
    places: Places = field(default_factory=dict)


def write_view(view: View, path: Path) -> None:
    """Write the page, and beside it the pictures that it loads when they are looked at. Raises OutputError."""
    folder, stills, before = path.parent, view.stills, view.before
    rows, names = view.site_map.rows, script_names(view.site_map.rows)
    sizes = [len(row.joint.covariance) for row in rows.values() if row.joint]
    outside = sum(2 * size * (size + 1) for size in sizes) > MOST_JOINT
    files = {
        name: write_row_scripts(
            names[name],
            view.photos.get(name),
            None if stills is None else stills.get(name, ()),
            row.joint if outside else None,
            folder,
        )
        for name, row in rows.items()
    }
    for name, script in script_names(before.site_map.rows).items() if before else ():
        if before and before.is_shown(name):
            old = write_old_row_scripts(script, before.photo(name), before.folder, folder)
            files[name] = files.get(name, NOTHING) | old
    write_text(path, page_text(view, files))
    remove_others(files.values(), folder, with_stills=stills is not None)


def page_text(view: View, files: Mapping[str, Entry]) -> str:
    """The page. Texts of the map are in it packed, as base64: none of them can be taken for HTML or script."""
    style, script = _resource("viewer.css"), _resource("viewer.js")
    data = page_data(view.site_map, view.title, view.evaluation, files, view.before, view.places)
    packed = gzip.compress(json.dumps(data, separators=(",", ":"), allow_nan=False).encode(), mtime=0)
    return Template(_resource("page.html")).substitute(
        policy=POLICY.format(script=digest(script), style=digest(style)),
        made_of=html.escape(str(view.origin)),
        title=html.escape(view.title),
        style=style,
        script=script,
        data=base64.b64encode(packed).decode(),
    )


def _viewer() -> str:
    """savmap's version, and what tells its viewers of one version apart."""
    return f"{version('savmap')}+{digest(_resource('viewer.js') + _resource('viewer.css'))[:12]}"


def _resource(name: str) -> str:
    return (files("savmap.apps.viewer") / name).read_text(encoding="utf-8")
