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

from savmap.errors import OutputError
from savmap.files.atomic import file_name, reason, write_bytes
from savmap.files.urls import is_url

log = logging.getLogger("savmap")
FOLDER = "stages"
LEFT_BEHIND = re.compile(r"\.savmap-\w{8}|\..+\.\d+\.part")


@dataclass(frozen=True)
class FolderCache:
    """What runs worked out of each row, by stage and by the key of what it was made of (see `cache_keys`), in an output
    folder."""

    folder: Path

    def load(self, row: str, stage: str, key: str | None) -> bytes | None:
        """What a stage of a row gave when it was made of the same, or last, of whatever it was made (None); None where
        nothing fits, or it is damaged."""
        try:
            head, _, body = self._path(row, stage).read_bytes().partition(b"\n")
        except OSError:
            return None
        made_of = head.decode(errors="replace").split()[1:2] if key is None else [key]
        return body if made_of and head == _head(made_of[0], body) else None

    def save(self, row: str, stage: str, key: str, content: bytes) -> None:
        """Keep what a stage of a row gave. Raises OutputError where it cannot be written."""
        write_bytes(self._path(row, stage), _head(key, content) + b"\n" + content)

    def clear(self, rows: Iterable[str]) -> None:
        """Forget all that is kept of rows. Raises OutputError where it cannot be removed."""
        for row in rows:
            for path in (self.folder / FOLDER / file_name(row)).glob("*"):
                try:
                    path.unlink()
                except OSError as error:
                    raise OutputError(f"{path}: cannot be removed ({reason(error)}); choose another -o") from error

    def frames(self, row: str) -> Path | None:
        """The file of the journal of what is measured in single frames of a row, until all of them are measured; none
        at a URL."""
        return None if is_url(self.folder) else self._path(row, "frames")

    def _path(self, row: str, stage: str) -> Path:
        return self.folder / FOLDER / file_name(row) / stage


def _head(key: str, body: bytes) -> bytes:
    return f"savmap-stage {key} {hashlib.sha256(body).hexdigest()}".encode()


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other runs out of an output folder, and remove what a killed one was writing there; a URL's is nobody's.
    Raises OutputError while another run is at work in it."""
    if is_url(folder):
        yield
        return
    try:
        place = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be opened ({reason(error)})") from error
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(f"{folder}: another savmap is writing there; wait for it or choose another -o") from None
        except OSError as error:
            log.info("%s: cannot be locked (%s)", folder, reason(error))
        for left in [*folder.glob(".*"), *(folder / FOLDER).rglob(".*")]:
            if LEFT_BEHIND.fullmatch(left.name) and left.is_dir():
                shutil.rmtree(left, ignore_errors=True)
            elif LEFT_BEHIND.fullmatch(left.name):
                left.unlink(missing_ok=True)
        yield
    finally:
        os.close(place)
