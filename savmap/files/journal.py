"""Records of long work, kept in parts while it goes on: work that was cut off, even by a power failure, goes on where
it stood. What was kept is read from its part when it is asked for, so that memory stays flat."""

import json
import logging
import shutil
import tempfile
import threading
import time
import weakref
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

from savmap.errors import OutputError
from savmap.files.serialization import packed, unpacked

KEEP_S, KEEP_BYTES = 4.0, 24 << 20
"""Between two parts, and the size of one at most: what is lost, and what is held, at most. A part of a few MB costs a
hundredth of a second to write."""
log = logging.getLogger("savmap")
Record = TypeVar("Record")
Place = tuple[str, int]


class Parts(Protocol):
    """Where parts are kept by number, each whole or not at all."""

    def load(self, part: int) -> bytes | None:
        """A part; None where there is none that fits."""
        ...

    def save(self, part: int, content: bytes) -> None:
        """Keep a part. Raises OutputError where it cannot be written."""
        ...

    def drop(self, part: int) -> bool:
        """Forget a part, whether it fits or not; False where there is none."""
        ...


class TemporaryParts:
    """Parts in a folder that is removed once nobody asks for them any more. Raises OutputError where none can be
    made."""

    def __init__(self) -> None:
        try:
            self._folder = Path(tempfile.mkdtemp(prefix="savmap-"))
        except OSError as error:
            raise OutputError(f"no temporary folder can be made ({error.strerror}): set TMPDIR to one") from error
        weakref.finalize(self, shutil.rmtree, self._folder, True)

    def load(self, part: int) -> bytes | None:
        path = self._path(part)
        return path.read_bytes() if path.is_file() else None

    def save(self, part: int, content: bytes) -> None:
        try:
            self._path(part).write_bytes(content)
        except OSError as error:
            raise OutputError(f"{self._path(part)}: cannot be written ({error.strerror})") from error

    def drop(self, part: int) -> bool:
        existed = self._path(part).is_file()
        self._path(part).unlink(missing_ok=True)
        return existed

    def _path(self, part: int) -> Path:
        return self._folder / str(part)


@dataclass(frozen=True, eq=False)
class _Part:
    """Packed records with the series that they are of and their numbers in these."""

    series: tuple[str, ...]
    numbers: tuple[int, ...]
    records: tuple[bytes, ...]


class Journal:
    """Records by the series that they are of and their number in it. Those of an earlier run are there from the start;
    new ones are kept every `KEEP_S` seconds or `KEEP_BYTES` and, however the block ends that it is entered for, at its
    end. Without `parts` they are kept for as long as the journal lives. Threads may share a journal.

    Part 0 says how many records there are of each series, so that this is known without reading them.
    """

    def __init__(self, parts: Parts | None = None) -> None:
        self._parts: Parts = TemporaryParts() if parts is None else parts
        self._written_s, self._next, self._full = time.monotonic(), 1, False
        self._part_of: dict[Place, int] = {}
        self._waiting: dict[Place, bytes] = {}
        self._last: tuple[int, dict[Place, bytes]] = (0, {})
        self._lock = threading.Lock()
        self.read_on()
        forget(self._parts, self._next)  # behind what does not fit: it would never be asked for
        self.earlier = Counter(series for series, _ in self._part_of)
        """How many records of an earlier run there are of each series."""

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        self.flush()

    def has(self, series: str, number: int) -> bool:
        """Whether there is a record."""
        with self._lock:
            return (series, number) in self._waiting or (series, number) in self._part_of

    def get(self, kind: type[Record], series: str, number: int) -> Record | None:
        """The record of this kind, if there is one. ValueError where it is of another kind."""
        place = series, number
        with self._lock:
            content = self._waiting.get(place)
            if content is None and place in self._part_of:
                content = self._records(self._part_of[place]).get(place)
        return None if content is None else unpacked(content, kind)

    def add(self, series: str, number: int, record: object) -> None:
        """Take a record, and keep those that wait if it is time."""
        content = packed(record, level=0)
        with self._lock:
            self._waiting[series, number] = content
            size = sum(map(len, self._waiting.values()))
        if not self._full and (time.monotonic() - self._written_s >= KEEP_S or size > KEEP_BYTES):
            self.flush()

    def flush(self) -> None:
        """Keep all records that wait. Where that cannot be done, they stay in memory: what is worked out is worth
        more."""
        with self._lock:
            if self._full or not self._waiting:
                return
            series, numbers = zip(*self._waiting, strict=True)
            places = dict.fromkeys(self._waiting, self._next)
            try:
                self._parts.save(self._next, packed(_Part(series, numbers, tuple(self._waiting.values())), level=0))
                self._parts.save(0, json.dumps(Counter(name for name, _ in {**self._part_of, **places})).encode())
            except OutputError as error:
                log.warning("what is measured is not kept meanwhile: %s", error)
                self._full = True
                return
            self._part_of |= places
            self._next, self._waiting, self._written_s = self._next + 1, {}, time.monotonic()

    def read_on(self) -> None:
        """Take the parts that another process has kept since, each once, up to the first that does not fit."""
        with self._lock:
            while records := self._records(self._next):
                self._part_of |= dict.fromkeys(records, self._next)
                self._next += 1

    def _records(self, part: int) -> dict[Place, bytes]:
        """The packed records of a part; none where there is no such part, or it does not fit."""
        if self._last[0] != part:
            content = self._parts.load(part)
            if content is None:
                return {}
            try:
                read = unpacked(content, _Part)
                self._last = part, dict(zip(zip(read.series, read.numbers, strict=True), read.records, strict=True))
            except (ValueError, TypeError) as error:
                log.warning("what an earlier run kept cannot be used, and is done again: %s", error)
                return {}
        return self._last[1]


def counts(parts: Parts) -> dict[str, int]:
    """How many records are kept of each series."""
    return dict(json.loads(parts.load(0) or b"{}"))


def forget(parts: Parts, first: int = 1) -> None:
    """Forget the parts from a number on, and, with the first, how many records there are."""
    if first == 1:
        parts.drop(0)
    while parts.drop(first):
        first += 1
