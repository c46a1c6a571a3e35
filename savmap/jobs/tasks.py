"""What a worker does, in this process, in another one, or on another machine: from a job to bytes, without writing a file."""

import logging
import resource
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from savmap.errors import SavmapError, SiteError, format_error
from savmap.plugin import trace
from savmap.plugin.isolation import because, failed
from savmap.site.job import Job, plugins_for
from savmap.types import RowMap, SiteMap, Trajectory
from savmap.types.progress import Monitor, NoteCollector

if TYPE_CHECKING:
    from savmap.pipeline.row import Row

NOTE = "note "
PER_MB = 1 << 20 if sys.platform == "darwin" else 1 << 10


@dataclass(frozen=True)
class Failure:
    """Why a row could not be mapped: the error, and, where it was not an expected one, its traceback."""

    error: SavmapError
    trace: str = ""


@dataclass(frozen=True)
class Done:
    """What a piece of work gave: content by row, or why there is none; lines for the user, seconds on the clock, the largest
    memory of the worker so far, MB, what another process had no log for, and, by row, the plugins that failed and how."""

    content: Mapping[str, bytes | Failure]
    notes: Sequence[str] = ()
    seconds: float = 0.0
    peak_mb: float = 0.0
    logged: Sequence[str] = ()
    lacking: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


def see(job: Job, name: str, monitor: Monitor | None = None) -> Done:
    """What is seen of one row, as stored bytes."""
    from savmap.files.serialization import packed
    from savmap.pipeline.row import look

    lacking: dict[str, Mapping[str, str]] = {}

    def seen(notes: Monitor) -> dict[str, bytes | Failure]:
        plugins = plugins_for(job, name)
        try:
            found = look(row_of(job, name), plugins, notes)
        except SavmapError as error:
            raise because(error, failed(plugins)) from error
        lacking[name] = found.failed
        return {name: packed(found)}

    return replace(_done([name], seen, monitor), lacking=lacking)


def solve(job: Job, seen: Mapping[str, bytes], monitor: Monitor | None = None) -> Done:
    """Maps of rows that share passes, each as the text of a map file, from what was seen of them."""
    from savmap.files.serialization import unpacked
    from savmap.maps.map_file import map_text
    from savmap.pipeline.measure import RowMeasurements
    from savmap.pipeline.row import map_rows

    lacking: dict[str, Mapping[str, str]] = {}

    def mapped(notes: Monitor) -> dict[str, bytes | Failure]:
        rows = [
            (row_of(job, name), plugins_for(job, name), unpacked(content, RowMeasurements))
            for name, content in seen.items()
        ]
        heard = NoteCollector()
        with warnings_as_notes(heard):
            found = map_rows(rows, notes)
        lacking.update({row.name: {**observed.failed, **failed(plugins)} for row, plugins, observed in rows})
        return {
            name: map_text(SiteMap({name: with_notes(own, heard.lines)}, {})).encode()
            if isinstance(own, RowMap)
            else Failure(because(own, lacking[name]))
            for name, own in zip(seen, found, strict=True)
        }

    return replace(_done(list(seen), mapped, monitor), lacking=lacking)


def _done(
    names: Sequence[str], work: Callable[[Monitor], Mapping[str, bytes | Failure]], monitor: Monitor | None
) -> Done:
    """Do it; an error is the failure of all rows named. Without a monitor (in another process) no error is let out at all.

    Linear algebra runs in one thread: sums then do not depend on how many cores a machine has.
    """
    notes = NoteCollector()
    begin = time.monotonic()
    logged: Sequence[str] = ()
    content: Mapping[str, bytes | Failure]
    talk = monitor or notes
    try:
        with threadpool_limits(1, "blas"), warnings_as_notes(talk), trace.about(names, keep=monitor is None) as logged:
            content = work(talk)
    except SavmapError as error:
        content = {name: Failure(error) for name in names}
    except Exception as error:
        if monitor is not None:
            raise
        content = {name: _unexpected(error) for name in names}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / PER_MB
    return Done(content, tuple(notes.lines), time.monotonic() - begin, peak, tuple(logged))


class _Telling(logging.Handler):
    """Warnings of plugins and libraries, as notes."""

    def __init__(self, monitor: Monitor) -> None:
        super().__init__(logging.WARNING)
        self.monitor = monitor

    def emit(self, record: logging.LogRecord) -> None:
        if record.name != "savmap":
            self.monitor.note(record.getMessage())


@contextmanager
def warnings_as_notes(monitor: Monitor) -> Iterator[None]:
    """While this lasts, what plugins and libraries log as a warning goes to the user and the log as a note."""
    handler = _Telling(monitor)
    logging.getLogger().addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)


def _unexpected(error: Exception) -> Failure:
    text = f"unexpected {format_error(error)}; please report it with savmap.log"
    return Failure(SavmapError(text), traceback.format_exc())


def with_notes(row: RowMap, lines: Sequence[str]) -> RowMap:
    """The row's map with those of the lines in its report that begin with its name."""
    own = [line.removeprefix(f"row {row.name}: ") for line in lines if line.startswith(f"row {row.name}: ")]
    first = 1 + sum(name.startswith(NOTE) for name in row.report)
    return replace(row, report={**row.report, **{f"{NOTE}{n}": line for n, line in enumerate(own, first)}})


def map_one(job: Job, name: str, monitor: Monitor) -> RowMap:
    """The map of one of the job's rows, by itself. Raises SavmapError's kinds."""
    from savmap.pipeline.row import look, map_rows

    row, plugins = row_of(job, name), plugins_for(job, name)
    (found,) = map_rows([(row, plugins, look(row, plugins, monitor))], monitor)
    if isinstance(found, SavmapError):
        raise found
    return found


def row_of(job: Job, name: str) -> "Row":
    """What the job says of one of its rows."""
    from savmap.pipeline.row import Row
    from savmap.site.references import calibration_of, references_of

    known = job.site.row_references(name)
    return Row(
        name,
        job.site.rows[name].passes,
        references_of(known),
        known.travel_m,
        earlier_path(job, name),
        calibration_of(job.site.row_calibration(name)),
        job.site.row_appearance(name),
    )


def earlier_path(job: Job, name: str) -> Trajectory | None:
    """The camera's path in a row of an earlier map, if the job has one."""
    from savmap.maps.map_file import read_map

    if job.earlier is None:
        return None
    rows = read_map(job.earlier).rows
    if name not in rows:
        raise SiteError(f"{job.earlier}: has no row `{name}` whose camera path could be used; it has {', '.join(rows)}")
    return rows[name].trajectory
