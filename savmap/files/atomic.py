"""Files written whole or not at all, and read; errors of either as one line.

A new file is made in a temporary folder beside the old one, synchronised, and moved into its place (`os.replace`): a
process that is killed at any moment leaves the old file or the new one.
"""

import errno
import hashlib
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

from savmap.errors import OutputError
from savmap.files.texts import MOST_MB, bounded_text, json_of
from savmap.files.urls import is_url

PREFIX = ".savmap-"
"""Of temporary folders: a killed run leaves them, and the next one removes them."""


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 with `\\n` line ends, whole or not at all. Raises OutputError."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content`, whole or not at all, and make the folder where it is missing; a URL's object is written in one
    request. Raises OutputError where the folder cannot be written or is full; `path` is then unchanged."""
    write_with(lambda part: part.write_bytes(content), path)


def write_with(write: Callable[[Path], object], path: Path) -> None:
    """Let a function write a file of the same name in a temporary folder, then move it into place.

    Raises OutputError where nothing can be written there, or where the function wrote nothing.
    """
    if is_url(path):
        with tempfile.TemporaryDirectory() as folder:
            write(part := Path(folder) / path.name)
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(part.read_bytes())
            except Exception as error:  # each kind of URL has errors of its own
                raise OutputError(f"{path}: cannot be written ({error})") from error
        return
    require_no_device(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=PREFIX) as folder:
            part = Path(folder) / path.name
            write(part)
            with part.open("rb") as stream:
                os.fsync(stream.fileno())
            os.replace(part, path)
    except OSError as error:
        advice = "choose another folder or free its space"
        raise OutputError(f"{path}: cannot be written ({reason(error)}); {advice}") from error
    except OutputError as error:
        raise OutputError(str(error).replace(str(part), str(path))) from error


def require_no_device(path: Path) -> None:
    """Raise OutputError for a device or a pipe, which no file may take the place of."""
    if path.absolute().is_relative_to("/dev") or (path.exists() and not (path.is_file() or path.is_dir())):
        raise OutputError(f"{path}: is a device or a pipe; name a file")


def read_text(path: Path, most_mb: float = MOST_MB) -> str:
    """The text of a UTF-8 file of at most so many MB. Raises OutputError."""
    try:
        return bounded_text(path, most_mb)
    except OSError as error:
        raise OutputError(f"{path}: cannot be read ({reason(error)})") from error
    except ValueError as error:
        raise OutputError(f"{path}: {error}") from error


def read_json(path: Path, most_mb: float = MOST_MB) -> object:
    """What a JSON file of at most so many MB holds; NaN and infinities are refused. Raises OutputError."""
    text = read_text(path, most_mb)
    try:
        return json_of(text)
    except json.JSONDecodeError as error:
        raise OutputError(f"{path}: is not JSON (line {error.lineno}, column {error.colno}: {error.msg})") from error
    except ValueError as error:
        raise OutputError(f"{path}: is not JSON ({error})") from error


def sha256(path: Path) -> str:
    """The SHA-256 of a file's bytes in hexadecimal. Raises OutputError."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise OutputError(f"{path}: cannot be read ({reason(error)})") from error


def reason(error: OSError) -> str:
    """The operating system's message, in lower case. "File exists", which only a folder's place gives, in plainer
    words."""
    if error.errno == errno.EEXIST:
        return "what would be its folder is a file"
    return (error.strerror or str(error)).lower()


def file_name(row: str) -> str:
    """A row's name as (part of) the name of a file."""
    name = quote(row, safe=" ()+,=@", errors="replace") or "_"
    return name.replace(".", "%2E") if not name.strip(".") else name
