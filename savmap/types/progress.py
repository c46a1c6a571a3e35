"""Progress of long work: the callback that the public functions take as `monitor`."""

import logging
from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar

Item = TypeVar("Item")
log = logging.getLogger("savmap")


class Monitor(Protocol):
    """The calls by which long work reports: give an object with these methods to show progress in your own program.
    Work within work, and rows that are mapped at the same time, in threads of their own, call them too."""

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        """Yield the items while the work on each is done; `doing` says what that is, `total` how many items there
        are."""
        ...

    def note(self, line: str) -> None:
        """Take one line about the work."""
        ...

    def left(self, seconds: float) -> None:
        """Take how long a run will still take, about once a second."""
        ...


class SilentMonitor:
    """Shows no progress; notes go to the log."""

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        return iter(items)

    def note(self, line: str) -> None:
        log.info(line)

    def left(self, seconds: float) -> None:
        """Nothing."""


class NoteCollector(SilentMonitor):
    """Shows no progress; keeps the notes in `lines`."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def note(self, line: str) -> None:
        self.lines.append(line)
