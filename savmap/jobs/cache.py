"""What was worked out of each row, kept in the output folder, so that a second run does only what changed.

A stage's file holds the fingerprint of what made it (see `fingerprint`), a digest of its content, and the content. It is written
whole or not at all, by one process alone; one that does not fit, or is damaged, is made again.
"""

import fcntl
import hashlib
import logging
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from savmap.errors import OutputError
from savmap.files.atomic import reason, write_bytes
from savmap.files.urls import is_url

log = logging.getLogger("savmap")
FOLDER = "stages"
LEFT_BEHIND = re.compile(r"\..+\.\d+\.part|\.savmap-\w{8}")


def file_name(row: str) -> str:
    """A row's name as (part of) the name of a file."""
    return quote(row, safe=" ()+,=@") or "_"


@dataclass(frozen=True)
class Store:
    """Stages of all rows in a folder. `fresh`: nothing that was kept is believed."""

    folder: Path
    fresh: bool = False

    def kept(self, row: str, stage: str, fingerprint: str) -> bytes | None:
        """What a stage of a row gave when it was made of the same things; None where there is no such thing."""
        try:
            content = b"" if self.fresh else self._path(row, stage).read_bytes()
        except OSError:
            return None
        head, _, body = content.partition(b"\n")
        return body if head == _head(fingerprint, body) else None

    def keep(self, row: str, stage: str, fingerprint: str, content: bytes) -> None:
        """Keep what a stage of a row gave. Raises OutputError where it cannot be written."""
        write_bytes(self._path(row, stage), _head(fingerprint, content) + b"\n" + content)

    def _path(self, row: str, stage: str) -> Path:
        return self.folder / FOLDER / file_name(row) / stage


def _head(fingerprint: str, body: bytes) -> bytes:
    return f"savmap-stage {fingerprint} {hashlib.sha256(body).hexdigest()}".encode()


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other runs out of an output folder, and sweep up what a killed one left there; a URL's is nobody's. Raises OutputError
    while another run is at work in it."""
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
    for place in (folder, *(folder / FOLDER).glob("*")):
        for left in (path for path in place.iterdir() if LEFT_BEHIND.fullmatch(path.name)):
            if left.is_dir():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)
