"""Progress of long work: the callback that the public functions take as `monitor`."""

import logging
from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar

Item = TypeVar("Item")
log = logging.getLogger("savmap")


class Monitor(Protocol):
    """The two calls by which long work reports: give an object with these methods to show progress in your own program."""

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        """Yield the items while the work on each is done; `doing` says what that is, `total` how many items there are."""
        ...

    def note(self, line: str) -> None:
        """Take one line about the work."""
        ...


class SilentMonitor:
    """Shows no progress; notes go to the log."""

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        return iter(items)

    def note(self, line: str) -> None:
        log.info(line)


class NoteCollector(SilentMonitor):
    """Shows no progress; keeps the notes in `lines`."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def note(self, line: str) -> None:
        self.lines.append(line)
