"""Telling the user how far a long piece of work is, and keeping notes for the log."""

import logging
from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar

Item = TypeVar("Item")
log = logging.getLogger("savmap")


class Monitor(Protocol):
    """Where stages say what they do."""

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        """The items, one by one, with progress shown."""
        ...

    def note(self, line: str) -> None:
        """A line for the user and the log."""
        ...


class SilentMonitor:
    """Shows nothing; notes go to the log alone."""

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        return iter(items)

    def note(self, line: str) -> None:
        log.info(line)


class NoteCollector(SilentMonitor):
    """Keeps its lines for whoever wants them."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def note(self, line: str) -> None:
        self.lines.append(line)
