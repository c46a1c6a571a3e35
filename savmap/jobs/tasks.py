"""Tasks: what a worker does, in this process, in another one, or on another machine. No file is written but what is
kept of single frames."""

import logging
import resource
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from threadpoolctl import threadpool_limits

from savmap.errors import SavmapError, SiteError, format_error
from savmap.files.journal import Parts
from savmap.jobs.cache import StoredRecord
from savmap.jobs.executors import ForwardedMonitor
from savmap.pipeline.cutting import spaced_stills
from savmap.pipeline.orthophoto import orthophoto
from savmap.pipeline.records import FrameJournal, FrameRecord, RowMeasurements, RowRequest
from savmap.pipeline.row import map_rows, measure
from savmap.plugin import trace
from savmap.plugin.isolation import because, failed
from savmap.site.job import Job, plugins_for
from savmap.site.references import calibration_of, references_of
from savmap.types import Orthophoto, RowMap, RowStrips, Still, Trajectory
from savmap.types.progress import Monitor, NoteCollector

NOTE = "note "
PER_MB = 1 << 20 if sys.platform == "darwin" else 1 << 10


@dataclass(frozen=True)
class Failure:
    """Why a row could not be mapped: the error, and, where it was not an expected one, its traceback."""

    error: SavmapError
    trace: str = ""


@dataclass(frozen=True, eq=False)
class RowPicture:
    """The orthophoto of a row, if its face is known and was seen, and its stills."""

    orthophoto: Orthophoto | None
    stills: tuple[Still, ...] = ()


@dataclass(frozen=True, eq=False)
class TaskResult:
    """What a task gave: by row, a record, or why there is none; notes for the user that nobody was told yet, seconds on
    the clock, the largest memory of the worker so far, MB, what another process had no log for, by row, the plugins
    that failed and how, and strips of what was measured, if they were asked for."""

    records: Mapping[str, StoredRecord[Any] | Failure]
    notes: Sequence[str] = ()
    seconds: float = 0.0
    peak_mb: float = 0.0
    logged: Sequence[str] = ()
    plugins_failed: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    strips: Mapping[str, StoredRecord[RowStrips]] = field(default_factory=dict)


def measure_task(
    job: Job,
    row: str,
    monitor: Monitor | None = None,
    *,
    with_strips: bool = False,
    frames: Parts | None = None,
) -> TaskResult:
    """What is measured in one row's pictures, with strips of them if they are wanted. `frames`: where what is measured
    in single frames is kept meanwhile."""

    def work(shown: Monitor) -> TaskResult:
        request = request_for(job, row)
        if with_strips:
            request = replace(request, strips=job.site.orthophotos, stills=job.site.panoramas)
        with FrameJournal(FrameRecord, frames) as journal:
            if journal.count:
                shown.note(f"row {row}: what was measured in {journal.count} frames is kept from an earlier run")
            try:
                measured = measure(replace(request, journal=journal), shown)
            except SavmapError as error:
                raise because(error, failed(request.plugins)) from error
        return TaskResult(
            {row: StoredRecord(RowMeasurements, measured.measurements)},
            plugins_failed={row: measured.measurements.failed},
            strips={row: StoredRecord(RowStrips, measured.strips)} if with_strips else {},
        )

    return _result([row], work, monitor)


def solve_task(
    job: Job, measurements: Mapping[str, StoredRecord[RowMeasurements]], monitor: Monitor | None = None
) -> TaskResult:
    """Maps of rows that share passes, from what was measured of them."""

    def work(shown: Monitor) -> TaskResult:
        seen = {row: stored.record for row, stored in measurements.items()}
        requests = [replace(request_for(job, row), measurements=record) for row, record in seen.items()]
        warned = NoteCollector()
        with warnings_as_notes(warned):
            results = map_rows(requests, shown)
        plugins_failed = {
            request.name: {**seen[request.name].failed, **failed(request.plugins)} for request in requests
        }
        records = {
            row: StoredRecord(RowMap, with_notes(result, warned.lines))
            if isinstance(result, RowMap)
            else Failure(because(result, plugins_failed[row]))
            for row, result in zip(measurements, results, strict=True)
        }
        return TaskResult(records, plugins_failed=plugins_failed)

    return _result(list(measurements), work, monitor)


def picture_task(
    job: Job,
    rows: Mapping[str, tuple[StoredRecord[RowMap], StoredRecord[RowStrips]]],
    monitor: Monitor | None = None,
) -> TaskResult:
    """Orthophotos of rows' faces, from their maps and the strips of what was measured, none of a row in which no face
    is known; and stills of the camera's path."""

    def work(shown: Monitor) -> TaskResult:
        pictures: dict[str, StoredRecord[Any] | Failure] = {}
        for row, (mapped, strips) in rows.items():
            face, path = mapped.record.face, mapped.record.trajectory
            picture = orthophoto(face, strips.record, path) if face is not None else None
            pictures[row] = StoredRecord(RowPicture, RowPicture(picture, spaced_stills(strips.record.stills, path)))
        return TaskResult(pictures)

    return _result(list(rows), work, monitor)


def request_for(job: Job, row: str) -> RowRequest:
    """What the job asks of one of its rows. Raises PluginError, SiteError."""
    references = job.site.row_references(row)
    return RowRequest(
        name=row,
        passes=job.site.rows[row].passes,
        plugins=plugins_for(job, row),
        references=references_of(references),
        travel_m=references.travel_m,
        path=earlier_path(job, row),
        calibration=calibration_of(job.site.row_calibration(row)),
        appearance=job.site.row_appearance(row),
    )


def earlier_path(job: Job, row: str) -> Trajectory | None:
    """The camera's path in a row of an earlier map, if the job has one. Raises SiteError where that has no such row."""
    from savmap.maps.map_file import read_map  # loads the JSON Schema's library, which few runs need

    if job.earlier is None:
        return None
    rows = read_map(job.earlier).rows
    if row not in rows:
        raise SiteError(f"{job.earlier}: has no row `{row}` whose camera path could be used; it has {', '.join(rows)}")
    return rows[row].trajectory


def _result(rows: Sequence[str], work: Callable[[Monitor], TaskResult], monitor: Monitor | None) -> TaskResult:
    """Do it; an expected error is the failure of all rows named. In another process no error is let out at all.

    Linear algebra runs in one thread: sums then do not depend on how many cores a machine has.
    """
    notes = NoteCollector()
    begin = time.monotonic()
    remote = monitor is None or isinstance(monitor, ForwardedMonitor)
    shown = monitor or notes
    logged: Sequence[str] = ()
    try:
        with threadpool_limits(1, "blas"), warnings_as_notes(shown), trace.about(rows, keep=remote) as logged:
            result = work(shown)
    except SavmapError as error:
        result = TaskResult({row: Failure(error) for row in rows})
    except Exception as error:
        if not remote:
            raise
        text = f"unexpected {format_error(error)}; please report it with savmap.log"
        failure = Failure(SavmapError(text), traceback.format_exc())
        result = TaskResult(dict.fromkeys(rows, failure))
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / PER_MB
    seconds = time.monotonic() - begin
    return replace(result, notes=tuple(notes.lines), seconds=seconds, peak_mb=peak_mb, logged=tuple(logged))


class _NoteHandler(logging.Handler):
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
    handler = _NoteHandler(monitor)
    logging.getLogger().addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)


def with_notes(row: RowMap, lines: Sequence[str]) -> RowMap:
    """The row's map with those of the lines in its report that begin with its name."""
    of_row = [line.removeprefix(f"row {row.name}: ") for line in lines if line.startswith(f"row {row.name}: ")]
    first = 1 + sum(name.startswith(NOTE) for name in row.report)
    return replace(row, report={**row.report, **{f"{NOTE}{n}": line for n, line in enumerate(of_row, first)}})
