"""Locations of files: paths of this machine, or URLs that fsspec reads (`s3://`, `gs://`, `file://`; extra `cluster`).

A URL is a `UPath`, which does what a `Path` does; it is typed as one throughout.
"""

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path, PurePath
from typing import cast
from unicodedata import normalize

from savmap.errors import SiteError

LOCAL = "file://"


def where(text: str | Path) -> Path:
    """The path of a text, at the beginning of which ~/ is the user's folder. Raises SiteError for an empty one, a URL
    of an unknown kind, or where the extra `cluster` is missing; TypeError for what is no path."""
    if not isinstance(text, str | PurePath) and not hasattr(text, "protocol"):
        raise TypeError(f"a path is expected, as a text or a Path, not {type(text).__name__}")
    if isinstance(text, str) and not text.strip():
        raise SiteError("a path is expected, not an empty text")
    if not isinstance(text, str) or "://" not in text:
        return _local(text) if isinstance(text, str) else text
    if text.startswith(LOCAL):
        return Path(text.removeprefix(LOCAL))
    try:
        from fsspec import get_filesystem_class
        from upath import UPath
    except ImportError:
        raise SiteError(f"{text}: reading URLs needs the extra `cluster`: pip install 'savmap[cluster]'") from None
    try:
        path = UPath(text)
        get_filesystem_class(path.protocol)  # raises where the package of this kind of URL is missing
        return cast(Path, path)
    except (ImportError, ValueError) as error:
        raise SiteError(f"{text}: cannot be read: {error}") from None


def _local(text: str) -> Path:
    if not text.startswith("~/"):
        return on_disk(Path(text))
    if not os.path.isdir(home := os.path.expanduser("~")):
        raise SiteError(f"{text}: the user has no home folder here ({home}): set HOME, or write the path in full")
    return on_disk(Path(home) / text.removeprefix("~/"))


def on_disk(path: Path) -> Path:
    """The path as the disk has it: a name that is not there is taken for one that differs in nothing but its Unicode
    normal form, as names from Macs do (u with a diaeresis, in one character or two)."""
    return path if is_url(path) else _alike(path, partial(normalize, "NFC")) or path


def likely(path: Path) -> str:
    """A hint at what a path that is not there may mean, such as "; there is Aisle.MP4"; empty where nothing is called
    alike."""
    near = None if is_url(path) else _alike(path, lambda name: normalize("NFC", name).casefold())
    return f"; there is {near}" if near and near != path else ""


def _alike(path: Path, key: Callable[[str], str]) -> Path | None:
    """What is there under a path, each part of which is the only one in its folder with the same key; None where there
    is nothing."""
    existing = Path(path.anchor)
    for part in path.parts[bool(path.anchor) :]:
        try:
            if not os.path.lexists(existing / part):
                (part,) = [name for name in os.listdir(existing) if key(name) == key(part)]
        except (OSError, ValueError):
            return None
        existing /= part
    return existing


def is_url(path: Path) -> bool:
    """Whether a path is a URL."""
    return not isinstance(path, Path)


def in_folder(folder: Path, path: Path) -> Path:
    """A relative path taken from a folder, as the disk has it; URLs are unchanged."""
    return path if is_url(path) else on_disk(folder / path)
