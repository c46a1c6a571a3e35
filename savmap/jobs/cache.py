"""The cache: what was worked out of each row, kept in the output folder, so that a second run does only what changed.

A stage's file holds the key of what made it (see `cache_keys`), a digest of its content, and the content. It is written
whole or not at all, by one process alone; one that does not fit, or is damaged, is made again.
"""

import fcntl
import hashlib
import logging
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from savmap.errors import OutputError
from savmap.files.atomic import file_name, reason, write_bytes
from savmap.files.journal import Parts
from savmap.files.serialization import packed, unpacked
from savmap.files.urls import is_url

log = logging.getLogger("savmap")
FOLDER = "stages"
LEFT_BEHIND = re.compile(r"\.savmap-\w{8}|\..+\.\d+\.part")


Record = TypeVar("Record")


class StoredRecord(Generic[Record]):
    """A record with its bytes for the cache, either of which is made of the other when it is first asked for. It goes
    from process to process as bytes."""

    def __init__(self, kind: type[Record], record: Record | None = None, content: bytes | None = None) -> None:
        self._kind, self._record, self._content = kind, record, content

    def __reduce__(self) -> tuple[Any, ...]:
        return StoredRecord, (self._kind, None, self.content)

    @property
    def record(self) -> Record:
        """The record. ValueError where the bytes are not one."""
        if self._record is None:
            self._record = unpacked(self.content, self._kind)
        return self._record

    @property
    def content(self) -> bytes:
        """The bytes."""
        if self._content is None:
            self._content = packed(self._record)
        return self._content


class NoCache:
    """Keeps nothing."""

    def load(self, row: str, stage: str, key: str) -> bytes | None:
        """None."""

    def save(self, row: str, stage: str, key: str, content: bytes) -> None:
        """Nothing."""

    def frames(self, row: str, key: str) -> Parts | None:
        """None."""


@dataclass(frozen=True)
class FolderCache:
    """What runs worked out of each row, by stage and by the key of what it was made of (see `cache_keys`), in an output
    folder."""

    folder: Path

    def load(self, row: str, stage: str, key: str) -> bytes | None:
        """What a stage of a row gave when it was made of the same; None where nothing fits."""
        try:
            content = self._path(row, stage).read_bytes()
        except OSError:
            return None
        head, _, body = content.partition(b"\n")
        return body if head == _head(key, body) else None

    def latest(self, row: str, stage: str) -> bytes | None:
        """What a stage of a row gave last, of whatever it was made; None where nothing is kept, or it is damaged."""
        try:
            head, _, body = self._path(row, stage).read_bytes().partition(b"\n")
        except OSError:
            return None
        return body if head.endswith(hashlib.sha256(body).hexdigest().encode()) else None

    def save(self, row: str, stage: str, key: str, content: bytes) -> None:
        """Keep what a stage of a row gave. Raises OutputError where it cannot be written."""
        write_bytes(self._path(row, stage), _head(key, content) + b"\n" + content)

    def drop(self, row: str, stage: str) -> bool:
        """Forget what a stage of a row gave; False where nothing is kept of it."""
        try:
            self._path(row, stage).unlink()
        except OSError:
            return False
        return True

    def clear(self, rows: Iterable[str]) -> None:
        """Forget all that is kept of rows. Raises OutputError where it cannot be removed."""
        for row in rows:
            for path in (self.folder / FOLDER / file_name(row)).glob("*"):
                try:
                    path.unlink()
                except OSError as error:
                    raise OutputError(f"{path}: cannot be removed ({reason(error)}); choose another -o") from error

    def frames(self, row: str, key: str) -> Parts:
        """Where what is measured in single frames of a row is kept, until all of them are measured."""
        return _FrameParts(self, row, key)

    def _path(self, row: str, stage: str) -> Path:
        return self.folder / FOLDER / file_name(row) / stage


RowCache = FolderCache | NoCache


@dataclass(frozen=True)
class _FrameParts:
    """Parts of what was measured in single frames of a row, each in a file of its own."""

    cache: FolderCache
    row: str
    key: str

    def load(self, part: int) -> bytes | None:
        return self.cache.load(self.row, f"frames-{part}", self.key)

    def save(self, part: int, content: bytes) -> None:
        self.cache.save(self.row, f"frames-{part}", self.key, content)

    def drop(self, part: int) -> bool:
        return self.cache.drop(self.row, f"frames-{part}")


def _head(key: str, body: bytes) -> bytes:
    return f"savmap-stage {key} {hashlib.sha256(body).hexdigest()}".encode()


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other runs out of an output folder, and sweep up what a killed one left there; a URL's is nobody's. Raises
    OutputError while another run is at work in it."""
    if is_url(folder):
        yield
        return
    try:
        place = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be opened ({reason(error)})") from error
    try:
        _lock(place, folder)
        _sweep(folder)
        yield
    finally:
        os.close(place)


def _lock(place: int, folder: Path) -> None:
    try:
        fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise OutputError(f"{folder}: another savmap is writing there; wait for it or choose another -o") from None
    except OSError as error:
        log.info("%s: cannot be locked (%s)", folder, reason(error))


def _sweep(folder: Path) -> None:
    """Remove what a killed run was writing, and leave all else alone."""
    for left in [*folder.glob(".*"), *(folder / FOLDER).rglob(".*")]:
        if not LEFT_BEHIND.fullmatch(left.name):
            continue
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)
