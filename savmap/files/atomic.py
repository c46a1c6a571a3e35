"""Files written whole or not at all; errors of reading and writing as one line."""

import errno
import hashlib
import json
import os
import tempfile
from collections.abc import Callable
from io import TextIOWrapper
from pathlib import Path
from urllib.parse import quote

from savmap.errors import OutputError
from savmap.files.places import PREFIX, new_file, opened_folder, require_plain
from savmap.files.texts import MOST_MB, bounded_text, json_of
from savmap.files.urls import is_url, likely

FOLDER_IS_FILE = "what would be its folder is a file"


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 with `\\n` line ends, whole or not at all. Raises OutputError."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content` to a new file of the same folder (made where missing), then put it in place of `path`; a link
    there is replaced.

    A URL's object is written in one request. Raises OutputError where the folder cannot be written or is full; `path`
    is then unchanged.
    """
    if is_url(path):
        return _put(path, content)
    require_plain(path)
    try:
        with opened_folder(path.parent) as place, new_file(place) as (part, descriptor):
            _write_through(descriptor, content)
            os.replace(part, path.name, src_dir_fd=place, dst_dir_fd=place)
    except OSError as error:
        advice = "choose another folder or free its space"
        raise OutputError(f"{path}: cannot be written ({reason(error)}); {advice}") from error


def opened_anew(path: Path) -> TextIOWrapper:
    """A new, empty text file in place of `path`, open for writing: a link is replaced, a device is written to. Raises
    OSError, and OutputError as `opened_folder` does."""
    if path.is_char_device() and not path.is_symlink():
        return path.open("w", encoding="utf-8")
    with opened_folder(path.parent) as place, new_file(place) as (part, descriptor):
        stream = open(descriptor, "w", encoding="utf-8")  # noqa: SIM115 -- the caller closes it
        try:
            os.replace(part, path.name, src_dir_fd=place, dst_dir_fd=place)
        except OSError:
            stream.close()
            raise
    return stream


def write_with(write: Callable[[Path], None], path: Path) -> None:
    """Let a function write a file of the same name in a temporary folder beside `path`, then move it into place.

    Raises OutputError where nothing can be written there, or where the function wrote nothing.
    """
    if is_url(path):
        with tempfile.TemporaryDirectory() as folder:
            write(Path(folder) / path.name)
            return _put(path, (Path(folder) / path.name).read_bytes())
    require_plain(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=PREFIX) as folder:
            part = Path(folder) / path.name
            write(part)
            with part.open("rb") as stream:
                os.fsync(stream.fileno())
            os.replace(part, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({reason(error)})") from error
    except OutputError as error:
        raise OutputError(str(error).replace(str(part), str(path))) from error


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
    """The operating system's message, in lower case; its "file exists", which no file that is put in another's place
    meets, in words. Of what is not there, with what is called alike."""
    text = FOLDER_IS_FILE if error.errno == errno.EEXIST else (error.strerror or str(error)).lower()
    named = (
        error.filename if isinstance(error, FileNotFoundError) and isinstance(error.filename, str | os.PathLike) else ""
    )
    return text + likely(Path(os.fsdecode(named))) if named else text


def _put(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except Exception as error:
        raise OutputError(f"{path}: cannot be written ({error})") from error


def _write_through(descriptor: int, content: bytes) -> None:
    with open(descriptor, "wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())


def file_name(row: str) -> str:
    """A row's name as (part of) the name of a file."""
    name = quote(row, safe=" ()+,=@", errors="replace") or "_"
    return name.replace(".", "%2E") if not name.strip(".") else name
