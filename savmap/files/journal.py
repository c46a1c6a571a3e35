"""Records of long work, kept in parts while it goes on: work that was cut off, even by a power failure, goes on where
it stood."""

import json
import logging
import time
from collections import Counter
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from savmap.errors import OutputError
from savmap.files.serialization import packed, unpacked

KEEP_S = 10.0
"""Between two parts: what is lost at most, and a part of a few MB costs a hundredth of a second to write."""
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


@dataclass(frozen=True, eq=False)
class _Part:
    """Records with the walks that they are of and their numbers in these."""

    walks: tuple[str, ...]
    numbers: tuple[int, ...]
    records: tuple[Any, ...]


class Journal(Generic[Record]):
    """Records by the walk that they are of and their number in it. Those of an earlier run are there from the start;
    new ones are kept every `KEEP_S` seconds and, however the block ends that it is entered for, at its end. Without
    `parts` nothing is.

    Part 0 says how many records there are of each walk, so that this is known without reading them.
    """

    def __init__(self, kind: type[Record], parts: Parts | None = None) -> None:
        self._parts, self._written_s = parts, time.monotonic()
        self._records: dict[Place, Record] = {}
        self._new: dict[Place, Record] = {}
        self._next = 1
        if parts is not None:
            self._load(parts, kind)
        self._counts = Counter(walk for walk, _ in self._records)

    def __enter__(self) -> "Journal[Record]":
        return self

    def __exit__(self, *_: object) -> None:
        self.flush()

    @property
    def count(self) -> int:
        """How many records of an earlier run there are."""
        return len(self._records)

    def get(self, walk: str, number: int) -> Record | None:
        """The record of an earlier run, if there is one."""
        return self._records.get((walk, number))

    def add(self, walk: str, number: int, record: Record) -> None:
        """Take a record, and keep those that wait if it is time."""
        if self._parts is not None:
            self._new[walk, number] = record
            if time.monotonic() - self._written_s >= KEEP_S:
                self.flush()

    def flush(self) -> None:
        """Keep all records that wait. Where that cannot be done, no more are taken: what is worked out is worth
        more."""
        if self._parts is None or not self._new:
            return
        walks, numbers = zip(*self._new, strict=True)
        counts = self._counts + Counter(walks)
        try:
            self._parts.save(self._next, packed(_Part(walks, numbers, tuple(self._new.values())), level=0))
            self._parts.save(0, json.dumps(counts).encode())
        except OutputError as error:
            log.warning("what is measured is not kept meanwhile: %s", error)
            self._parts = None
            return
        self._next, self._counts, self._new = self._next + 1, counts, {}
        self._written_s = time.monotonic()

    def _load(self, parts: Parts, kind: type[Record]) -> None:
        """Take what fits, up to the first part that does not, and forget what is behind that: it would never be asked
        for."""
        while (content := parts.load(self._next)) is not None:
            try:
                part = unpacked(content, _Part)
                if not all(isinstance(record, kind) for record in part.records):
                    raise ValueError(f"not records of {kind.__name__}")
                self._records |= dict(zip(zip(part.walks, part.numbers, strict=True), part.records, strict=True))
            except (ValueError, TypeError) as error:
                log.warning("what an earlier run kept cannot be used, and is done again: %s", error)
                break
            self._next += 1
        forget(parts, self._next)


def counts(parts: Parts) -> dict[str, int]:
    """How many records are kept of each walk, in the order of the walks."""
    return dict(json.loads(parts.load(0) or b"{}"))


def forget(parts: Parts, first: int = 1) -> None:
    """Forget the parts from a number on, and, with the first, how many records there are."""
    if first == 1:
        parts.drop(0)
    while parts.drop(first):
        first += 1
