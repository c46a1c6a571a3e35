"""The terminal: progress bars and notes on standard error, and a log file in the output folder."""

import io
import logging
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from rich.console import Console as Terminal
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from savmap.cli.speech import say
from savmap.errors import OutputError, SavmapError, visible
from savmap.files.atomic import opened_anew, reason, write_text
from savmap.files.urls import is_url
from savmap.types.progress import SilentMonitor

Item = TypeVar("Item")
log = logging.getLogger("savmap")
EVERY_S = 10.0
"""Between lines on progress where there is no terminal."""


class LogFile(logging.FileHandler):
    """A new log file in place of an old one. One that cannot be written any more, because the disk is full, falls silent: results
    matter more.

    Raises OutputError where it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        try:
            super().__init__(path, mode="w", encoding="utf-8")
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({reason(error)})") from error

    def _open(self) -> TextIOWrapper:
        return opened_anew(Path(self.baseFilename))

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 -- logging's own name
        """Nothing: what cannot be logged is lost."""


class LogFormatter(logging.Formatter):
    """A line for a record, whatever its text holds, and lines for a traceback."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 -- logging's own name
        record.message = visible(record.message)
        return super().formatMessage(record)

    def formatException(self, ei: Any) -> str:  # noqa: N802 -- logging's own name
        return "\n".join(map(visible, super().formatException(ei).split("\n")))


class EchoMonitor(SilentMonitor):
    """A Monitor whose notes go to standard output."""

    def note(self, line: str) -> None:
        say(line)


class Console:
    """A Monitor that shows progress bars and notes, and writes the notes to a log file; one at a URL is written at the end."""

    def __init__(self, log_file: Path) -> None:
        self.terminal = Terminal(stderr=True, highlight=False)
        self.there = log_file if is_url(log_file) else None
        self.kept = io.StringIO()
        self.handler = logging.StreamHandler(self.kept) if self.there else LogFile(log_file)
        self.handler.setFormatter(LogFormatter("%(asctime)s %(levelname)s %(message)s"))

    def __enter__(self) -> "Console":
        log.setLevel(logging.INFO)
        log.addHandler(self.handler)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            log.error("%s", error, exc_info=None if isinstance(error, SavmapError) else error)
        log.removeHandler(self.handler)
        with suppress(OSError):
            self.handler.close()
        if self.there is not None:
            write_text(self.there, self.kept.getvalue())

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        """The items with a progress bar; where nobody looks at a terminal, with a line every `EVERY_S`."""
        if not self.terminal.is_terminal:
            log.info("%s", doing)
            yield from self._told(items, doing, total)
            return
        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
        )
        log.info("%s", doing)
        with Progress(*columns, console=self.terminal, transient=True) as progress:
            yield from progress.track(items, total=total, description=visible(doing))

    def _told(self, items: Iterable[Item], doing: str, total: int | None) -> Iterator[Item]:
        """The items, with a line now and then that says how many are done and how long the others will take."""
        begun = said = time.monotonic()
        for done, item in enumerate(items):
            now = time.monotonic()
            if done and now - said >= EVERY_S:
                said = now
                self.terminal.print(visible(_so_far(doing, done, total, now - begun)), markup=False, soft_wrap=True)
            yield item

    @contextmanager
    def meter(self, doing: str) -> Iterator[Callable[[float, str], None]]:
        """A bar that is set by calls with the share done (0..1) and a message."""
        with Progress(
            TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn(), console=self.terminal
        ) as bar:
            task = bar.add_task(visible(doing), total=1.0)

            def show(share: float, message: str) -> None:
                bar.update(task, completed=share, description=visible(f"{doing}: {message}"))
                log.info("%s", message)

            yield show

    def note(self, line: str) -> None:
        """A line on the terminal and in the log."""
        self.terminal.print(visible(line), markup=False, soft_wrap=True)
        log.info("%s", line)


def _so_far(doing: str, done: int, total: int | None, seconds: float) -> str:
    if not total:
        return f"{doing}: {done}"
    left = seconds * max(total - done, 0) / done
    clock = f"{left:.0f} s" if left < 120 else f"{left / 60:.0f} min"
    return f"{doing}: {done} of {total} ({done / total:.0%}), about {clock} left"
