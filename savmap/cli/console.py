"""The terminal: progress bars and notes on standard error, and a log file in the output folder."""

import io
import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from rich.console import Console as Terminal
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from savmap.cli.speech import say
from savmap.errors import OutputError, SavmapError, visible
from savmap.files.atomic import reason, write_text
from savmap.files.urls import is_url
from savmap.types.progress import SilentMonitor

Item = TypeVar("Item")
log = logging.getLogger("savmap")
EVERY_S, REDRAWN_S = 30.0, 0.1
"""Between lines on one thing where there is no terminal, and between its looks where there is one."""


class LogFile(logging.FileHandler):
    """A new log file in place of an old one. One that cannot be written any more, because the disk is full, falls
    silent: results matter more.

    Raises OutputError where it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            super().__init__(path, mode="w", encoding="utf-8")
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({reason(error)})") from error

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


@dataclass(eq=False)
class _Work:
    """Work under way: how much of it is done, since when, when that was said last, and its bar where there is a
    terminal."""

    doing: str
    total: int | None
    begun_s: float
    said_s: float
    done: int = 0
    bar: TaskID | None = None


class Console:
    """A Monitor that shows progress bars and notes, and writes the notes to a log file; one at a URL is written at the
    end.

    Of work within work, and of rows that are mapped at the same time, all bars are shown. How long a run will take
    stands with the outermost.
    """

    def __init__(self, log_file: Path) -> None:
        self.terminal = Terminal(stderr=True, highlight=False)
        self.there = log_file if is_url(log_file) else None
        self.kept = io.StringIO()
        self.handler = logging.StreamHandler(self.kept) if self.there else LogFile(log_file)
        self.handler.setFormatter(LogFormatter("%(asctime)s %(levelname)s %(message)s"))
        self.works: list[_Work] = []
        self.bars: Progress | None = None
        self.run_left_s: float | None = None
        self.lock = threading.RLock()

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
        log.info("%s", doing)
        work = self._begin(doing, total)
        try:
            for item in items:
                self._show(work)
                yield item
                work.done += 1
        finally:
            self._end(work)

    def left(self, seconds: float) -> None:
        """How long the run will take, with the outermost work."""
        with self.lock:
            self.run_left_s = seconds
            if self.works:
                self._show(self.works[0])

    def _begin(self, doing: str, total: int | None) -> _Work:
        now = time.monotonic()
        work = _Work(doing, total, now, now)
        with self.lock:
            self.works.append(work)
            if self.terminal.is_terminal:
                if self.bars is None:
                    said = TextColumn("{task.fields[said]}", markup=False)
                    columns = TextColumn("{task.description}", markup=False), BarColumn(), said
                    self.bars = Progress(*columns, console=self.terminal, transient=True)
                    self.bars.start()
                work.bar = self.bars.add_task(visible(doing), total=total, said="")
        return work

    def _end(self, work: _Work) -> None:
        with self.lock:
            self.works.remove(work)
            if self.bars is not None and work.bar is not None:
                self.bars.remove_task(work.bar)
            if not self.works:
                self.run_left_s = None
                if self.bars is not None:
                    self.bars.stop()
                    self.bars = None

    def _show(self, work: _Work) -> None:
        """Say how far work is, if it is time: of a run only the outermost says how long it will take."""
        now = time.monotonic()
        if now - work.said_s < (EVERY_S if work.bar is None else REDRAWN_S):
            return
        with self.lock:
            said, left_s = f"{work.done}", self.run_left_s if work is self.works[0] else None
            if work.total:
                said = f"{work.done} of {work.total} ({work.done / work.total:.0%})"
                if self.run_left_s is None and work.done:  # it goes on as it did
                    left_s = (now - work.begun_s) * max(work.total - work.done, 0) / work.done
            if left_s is not None:
                said += f", about {f'{left_s:.0f} s' if left_s < 120 else f'{left_s / 60:.0f} min'} left"
            if self.bars is not None and work.bar is not None:
                self.bars.update(work.bar, completed=work.done, said=said)
            elif work.done or left_s is not None:
                self.terminal.print(visible(f"{work.doing}: {said}"), markup=False, soft_wrap=True)
            else:
                return
            work.said_s = now

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
