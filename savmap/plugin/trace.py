"""SAVMAP_TRACE=1: every call of a hook as a line on standard error and in the log. Without it, calls go through no
extra code."""

import logging
import os
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import Any

import pluggy

from savmap.errors import format_error, visible
from savmap.types import View

VARIABLE = "SAVMAP_TRACE"
PARTS = ("keys", "views", "boxes", "deviations")
log = logging.getLogger("savmap.trace")
_row: ContextVar[str] = ContextVar("row", default="")


def wanted() -> bool:
    """Whether the environment asks for a trace."""
    return os.environ.get(VARIABLE, "").strip().lower() not in ("", "0", "false", "no")


def watch(manager: pluggy.PluginManager, plugin: str) -> None:
    """Trace every call of a plugin's hooks, if a trace is wanted."""
    if not wanted():
        return
    begun = threading.local()

    def before(hook: str, implementations: Sequence[Any], arguments: Mapping[str, Any]) -> None:
        begun.__dict__.setdefault("times", []).append(time.perf_counter())

    def after(
        outcome: pluggy.Result[Any], hook: str, implementations: Sequence[Any], arguments: Mapping[str, Any]
    ) -> None:
        seconds = time.perf_counter() - begun.times.pop()
        write_line(f"{plugin}.{hook}{_place(arguments)}: {1e3 * seconds:.2f} ms, {_answer(outcome)}")

    manager.add_hookcall_monitoring(before, after)


def write_line(line: str) -> None:
    """Write a line of the trace; one that cannot be printed goes into the log alone."""
    with suppress(OSError, ValueError):
        print(f"trace: {visible(line)}", file=sys.stderr, flush=True)
    log.info("trace: %s", line)


def log_lines(lines: Sequence[str]) -> None:
    """Write lines into this process's log that another process had no log for."""
    for line in lines:
        log.info("%s", line)


class _Kept(logging.Handler):
    def __init__(self, lines: list[str]) -> None:
        super().__init__(logging.INFO)
        self.lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(self.format(record))


@contextmanager
def about(rows: Sequence[str], keep: bool) -> Iterator[list[str]]:
    """While this lasts, calls without a row among their arguments are taken to be about these rows. `keep`: all that is
    logged is gathered, the trace with it, for a process that has no log."""
    lines: list[str] = []
    own = logging.getLogger("savmap")
    handler, level, token = _Kept(lines), own.level, _row.set(" and ".join(rows))
    if keep:
        own.setLevel(logging.INFO)
        own.addHandler(handler)
    try:
        yield lines
    finally:
        own.removeHandler(handler)
        own.setLevel(level)
        _row.reset(token)


def _place(arguments: Mapping[str, Any]) -> str:
    """Row, frame and view of a call, as far as its arguments say: " [row A, frame 12, pass 1 / face]"."""
    view = arguments.get("view")
    row = getattr(arguments.get("facts"), "name", None) or _row.get()
    known = [f"row {row}"] if row else []
    if isinstance(view, View):
        known += [f"frame {view.frame}", view.spec.name]
    return f" [{', '.join(known)}]" if known else ""


def _answer(outcome: pluggy.Result[Any]) -> str:
    if outcome.exception is not None:
        return f"raised {format_error(outcome.exception)}"
    answer = outcome.get_result()
    if isinstance(answer, list | tuple):
        kinds = sorted({type(one).__name__ for one in answer})
        return f"{len(answer)} {' and '.join(kinds)}" if answer else f"an empty {type(answer).__name__}"
    return f"{type(answer).__name__}{_amount(answer)}"


def _amount(answer: object) -> str:
    """How large an answer is, by the first of its `PARTS`: " of 6 keys". Empty for an answer without such a part, or
    with one that cannot be counted: a plugin may return anything."""
    for name in PARTS:
        with suppress(Exception):
            part = getattr(answer, name)
            return f" of {len(part)} {name}"
    return ""
