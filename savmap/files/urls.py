"""Locations of files: paths of this machine, or URLs that fsspec reads (`s3://`, `gs://`, `file://`; extra `cluster`).

A URL is a `UPath`, which does what a `Path` does; it is typed as one throughout.
"""

from pathlib import Path, PurePath
from typing import cast

from savmap.errors import SiteError

LOCAL = "file://"


def where(text: str | Path) -> Path:
    """The path of a text, at the beginning of which ~/ is the user's folder. Raises SiteError for an empty one, a URL
    of an unknown kind, or where the extra `cluster` is missing; TypeError for what is no path."""
    if not isinstance(text, str):
        if not isinstance(text, PurePath) and not hasattr(text, "protocol"):
            raise TypeError(f"a path is expected, as a text or a Path, not {type(text).__name__}")
        return text
    if not text.strip():
        raise SiteError("a path is expected, not an empty text")
    if text.startswith(LOCAL):
        return Path(text.removeprefix(LOCAL))
    if "://" not in text:
        return Path(text).expanduser() if text.startswith("~/") else Path(text)
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


def is_url(path: Path) -> bool:
    """Whether a path is a URL."""
    return not isinstance(path, Path)


def in_folder(folder: Path, path: Path) -> Path:
    """A relative path taken from a folder; URLs are unchanged."""
    return path if is_url(path) else folder / path
