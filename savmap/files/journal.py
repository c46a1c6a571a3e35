"""Records of long work, kept while it goes on: work that was cut off, even by a power failure, goes on where it stood.
What was kept is read from its file when it is asked for, so that memory stays flat."""

import hashlib
import logging
import sqlite3
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any, TypeVar

from savmap.errors import OutputError
from savmap.files.serialization import packed, unpacked

KEEP_S, KEEP_BYTES = 4.0, 24 << 20
"""Between two times at which records are kept, and their size then: what is lost, and what is held, at most. A few MB
take a hundredth of a second."""
LOCKED_S = 60.0
"""For which a file may be locked: whoever writes it is done after a fraction of a second."""
TABLE = """
create table if not exists records (
    key text, series text, number integer, digest blob, content blob, primary key (key, series, number)
)
"""
log = logging.getLogger("savmap")
Record = TypeVar("Record")


class Journal:
    """Records by the series that they are of and their number in it, in an SQLite file. Those that an earlier run kept
    under the same `key` are there from the start, up to the first one that is damaged; all others are forgotten. New
    ones are kept every `KEEP_S` seconds or `KEEP_BYTES` and, however the block ends that it is entered for, at its end.
    Without a file they are kept for as long as the journal lives. `is_reader`: nothing is forgotten, since another
    process writes the file. Threads may share a journal.

    Raises OutputError where the file cannot be opened.
    """

    def __init__(self, file: Path | None = None, key: str = "", is_reader: bool = False) -> None:
        self._key, self._lock, self._waiting = key, threading.Lock(), dict[tuple[str, int], bytes]()
        self._written_s, self._full = time.monotonic(), False
        try:
            self._kept = self._opened(file, is_reader)
        except (sqlite3.Error, OSError) as error:
            if file is None or is_reader or not file.is_file():
                raise OutputError(f"{file or 'a temporary file'}: cannot be opened ({error})") from error
            log.warning("what an earlier run kept cannot be used, and is done again: %s", error)
            forget(file)
            self._kept = self._opened(file, is_reader)
        counted = "select series, count(*) from records where key = ? group by series"
        self.earlier = Counter[str](dict(self._kept.execute(counted, (key,)).fetchall()))
        """How many records of an earlier run there are of each series."""

    def _opened(self, file: Path | None, is_reader: bool) -> sqlite3.Connection:
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            if file.is_symlink():
                file.unlink()
        kept = sqlite3.connect(file or "", LOCKED_S, check_same_thread=False)
        kept.execute(TABLE)
        if not is_reader:
            kept.create_function("sha256", 1, lambda content: hashlib.sha256(content).digest())
            damaged = "select min(rowid) from records where digest != sha256(content)"
            with kept:
                kept.execute("delete from records where key != ?", (self._key,))
                kept.execute(f"delete from records where rowid >= ({damaged})")
        return kept

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        self.flush()

    def has(self, series: str, number: int) -> bool:
        """Whether there is a record."""
        with self._lock:
            return (series, number) in self._waiting or self._column("1", series, number) is not None

    def get(self, kind: type[Record], series: str, number: int) -> Record | None:
        """The record of this kind, if there is one. ValueError where it is of another kind."""
        with self._lock:
            content = self._waiting.get((series, number)) or self._column("content", series, number)
        return None if content is None else unpacked(content, kind)

    def _column(self, name: str, series: str, number: int) -> Any:
        query = f"select {name} from records where key = ? and series = ? and number = ?"
        row = self._kept.execute(query, (self._key, series, number)).fetchone()
        return None if row is None else row[0]

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
            rows = [(self._key, *at, hashlib.sha256(record).digest(), record) for at, record in self._waiting.items()]
            if self._full or not rows:
                return
            try:
                with self._kept:
                    self._kept.executemany("insert or replace into records values (?, ?, ?, ?, ?)", rows)
            except sqlite3.Error as error:
                log.warning("what is measured is not kept meanwhile: %s", error)
                self._full = True
                return
            self._waiting, self._written_s = {}, time.monotonic()


def forget(file: Path) -> None:
    """Remove the file of a journal."""
    file.with_name(f"{file.name}-journal").unlink(missing_ok=True)  # first: SQLite would apply it to a new file
    file.unlink(missing_ok=True)
