"""SAVMAP_TRACE=1: every call of a hook as a line on standard error and in the log."""

import logging
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import Any

from savmap.errors import format_error, visible
from savmap.types import View

VARIABLE = "SAVMAP_TRACE"
PARTS = ("keys", "views", "boxes", "deviations")
log = logging.getLogger("savmap.trace")
_row: ContextVar[str] = ContextVar("row", default="")


@contextmanager
def call(hook: str, arguments: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Trace the call of a hook ("plugin.hook") that is made meanwhile, where the environment asks for it: what is put
    under "answer", or how it failed."""
    outcome: dict[str, Any] = {}
    if os.environ.get(VARIABLE, "").strip().lower() in ("", "0", "false", "no"):
        yield outcome
        return
    begin_s, says = time.perf_counter(), ""
    try:
        yield outcome
        says = _answer(outcome["answer"])
    except BaseException as error:
        says = f"raised {format_error(error)}"
        raise
    finally:
        view, row = arguments.get("view"), getattr(arguments.get("facts"), "name", None) or _row.get()
        parts = [f"row {row}"] if row else []
        if isinstance(view, View):
            parts += [f"frame {view.frame}", view.spec.name]
        place = f" [{', '.join(parts)}]" if parts else ""
        line = f"{hook}{place}: {1e3 * (time.perf_counter() - begin_s):.2f} ms, {says}"
        with suppress(OSError, ValueError):  # what cannot be printed goes into the log only
            print(f"trace: {visible(line)}", file=sys.stderr, flush=True)
        log.info("trace: %s", line)


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
    logger = logging.getLogger("savmap")
    handler, level, token = _Kept(lines), logger.level, _row.set(" and ".join(rows))
    if keep:
        logger.setLevel(logging.INFO)
        logger.addHandler(handler)
    try:
        yield lines
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        _row.reset(token)


def _answer(answer: object) -> str:
    """What kind of answer it is, and how large by the first of its `PARTS`: "Constraints of 6 keys". A plugin may
    return anything, so a part that cannot be counted is passed over."""
    kind = type(answer).__name__
    if isinstance(answer, list | tuple):
        kinds = sorted({type(item).__name__ for item in answer})
        return f"{len(answer)} {' and '.join(kinds)}" if answer else f"an empty {kind}"
    for name in PARTS:
        with suppress(Exception):
            return f"{kind} of {len(getattr(answer, name))} {name}"
    return kind
