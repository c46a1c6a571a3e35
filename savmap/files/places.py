"""Places where files are written: new files under names that nobody can foresee, and no way out of an output folder by
a link.

A folder that is guarded keeps what is written below it inside: a folder in it that is a link is refused, and a file in
it that is a link is replaced, never followed. The folder itself may be one: the user named it.
"""

import errno
import os
import secrets
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from savmap.errors import OutputError

PREFIX = ".savmap-"
NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC
SYSTEM = tuple(map(Path, ("/dev", "/proc", "/sys")))
_guarded: set[Path] = set()


def guard(folder: Path) -> None:
    """Let nothing that this process writes below a folder leave it by a link."""
    _guarded.add(Path(os.path.abspath(folder)))


def require_plain(path: Path) -> None:
    """Raise OutputError for a device or a pipe, which no file may take the place of."""
    try:
        kind = path.stat().st_mode
    except OSError:
        kind = stat.S_IFREG
    special = not (stat.S_ISREG(kind) or stat.S_ISDIR(kind))
    if special or any(Path(os.path.abspath(path)).is_relative_to(place) for place in SYSTEM):
        raise OutputError(f"{path}: is a device or a pipe; name a file")


@contextmanager
def opened_folder(folder: Path) -> Iterator[int]:
    """A folder, made where missing, as a descriptor while this lasts. Raises OSError, and OutputError for a link below
    a guarded folder."""
    whole = Path(os.path.abspath(folder))
    root = next((place for place in (*reversed(whole.parents), whole) if place in _guarded), whole)
    root.mkdir(parents=True, exist_ok=True)
    place = os.open(root, FOLDER)
    try:
        for depth, name in enumerate(whole.relative_to(root).parts):
            inner = _inside(place, name, root.joinpath(*whole.relative_to(root).parts[: depth + 1]))
            os.close(place)
            place = inner
        yield place
    finally:
        os.close(place)


def require_free(files: Iterable[Path], root: Path) -> None:
    """Raise OutputError where one of the files could not be written below a folder: what stands there, or on the way,
    is of another kind, a link, or may not be written to. Nothing is made."""
    folders: set[Path] = set()
    for path in files:
        if path.is_dir() and not path.is_symlink():
            raise OutputError(f"{path}: is a folder, and a file is to be written there; remove it or choose another -o")
        require_plain(path)
        folders.add(next(above for above in path.parents if above == root or os.path.lexists(above)))
    for folder in folders:
        try:
            with opened_folder(folder) as place, new_file(place):
                pass
        except OSError as error:
            text = "is a file, not a folder" if folder.is_file() else (error.strerror or str(error)).lower()
            raise OutputError(
                f"{folder}: nothing can be written there: {text}; remove it or choose another -o"
            ) from None


@contextmanager
def new_file(place: int) -> Iterator[tuple[str, int]]:
    """The name and the descriptor of a new file in a folder; the file is gone afterwards unless it was given another
    name."""
    name = f"{PREFIX}{secrets.token_hex(4)}"
    descriptor = os.open(name, NEW, 0o666, dir_fd=place)
    try:
        yield name, descriptor
    finally:
        with suppress(OSError):
            os.unlink(name, dir_fd=place)


def _inside(place: int, name: str, path: Path) -> int:
    """A folder in a folder, which must be no link."""
    with suppress(FileExistsError):
        os.mkdir(name, dir_fd=place)
    try:
        return os.open(name, FOLDER | os.O_NOFOLLOW, dir_fd=place)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENOTDIR) and path.is_symlink():
            raise OutputError(
                f"{path}: is a link, and nothing is written through one; remove it, or choose another -o, which may be a link"
            ) from None
        raise
