"""Locations of files: paths of this machine, or URLs that fsspec reads (`s3://`, `gs://`, `file://`; extra `cluster`).

A URL is a `UPath`, which does what a `Path` does; it is typed as one throughout.
"""

from pathlib import Path, PurePath
from typing import cast

from savmap.errors import SiteError

LOCAL = "file://"


def where(text: str | Path) -> Path:
    """The path of a text, at the beginning of which ~/ is the user's folder. Raises SiteError for an empty one, a URL of an unknown kind, or
    where the extra `cluster` is missing; TypeError for what is no path."""
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
    return Path(text).expanduser() if text.startswith("~/") else Path(text)


def is_url(path: Path) -> bool:
    """Whether a path is a URL."""
    return not isinstance(path, Path)


def beside(folder: Path, path: Path) -> Path:
    """A relative path taken from a folder; URLs and absolute paths are unchanged."""
    return path if is_url(path) else folder / path
