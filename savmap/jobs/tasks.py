"""Tasks: what a worker does, in this process, in another one, or on another machine. No file is written but what is
kept of single frames."""

import logging
import resource
import sys
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from savmap.errors import SavmapError, SiteError, format_error, out_of_memory
from savmap.files.journal import Journal
from savmap.files.serialization import packed, unpacked
from savmap.jobs.executors import ForwardedMonitor
from savmap.jobs.run_clock import MEASURED, PICTURED, SOLVED
from savmap.pipeline.cutting import spaced_stills
from savmap.pipeline.records import MeasuredRow, RowMeasurements, RowRequest
from savmap.pipeline.row import map_rows, measure
from savmap.plugin import trace
from savmap.plugin.isolation import because, failed
from savmap.site.job import Job, plugins_for
from savmap.site.load import is_footage
from savmap.site.references import calibration_of, references_of
from savmap.types import Orthophoto, RowMap, RowStrips, Still
from savmap.types.progress import Monitor, NoteCollector
from savmap.vision.orthophoto import orthophoto

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
class RowRecords:
    """What is known of a row, by stage, packed: what was measured in its pictures (`RowMeasurements`), with strips of
    them (`RowStrips`) if pictures are wanted, its map (`RowMap`), and its picture (`RowPicture`); or why there is none.
    `plugins_failed`: those that failed, and how."""

    measured: bytes | None = None
    strips: bytes | None = None
    solved: bytes | None = None
    pictured: bytes | None = None
    failure: Failure | None = None
    plugins_failed: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class TaskResult:
    """What a task gave: by row, its records; notes for the user that nobody was told yet, seconds on the clock by
    stage, the largest memory of the worker so far, MB, and what another process had no log for."""

    rows: Mapping[str, RowRecords]
    notes: Sequence[str] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    peak_mb: float = 0.0
    logged: Sequence[str] = ()


def map_task(
    job: Job,
    rows: Mapping[str, RowRecords],
    monitor: Monitor | None = None,
    *,
    with_pictures: bool = False,
    frames: tuple[Path | None, str] = (None, ""),
) -> TaskResult:
    """All records of rows that are seen in the same frames, from those that an earlier run kept. `frames`: file and key
    of the journal in which what is measured in single frames is kept meanwhile.

    Linear algebra runs in one thread: sums then do not depend on how many cores a machine has. In another process no
    error is let out at all.
    """
    notes = NoteCollector()
    remote = monitor is None or isinstance(monitor, ForwardedMonitor)
    shown = monitor or notes
    group = _Group(job, dict(rows), shown)
    logged: Sequence[str] = ()
    try:
        with threadpool_limits(1, "blas"), warnings_as_notes(shown), trace.about(list(rows), keep=remote) as logged:
            group.measure(with_pictures, frames)
            group.solve()
            if with_pictures:
                group.picture()
    except Exception as error:
        expected = out_of_memory(error) or error
        if isinstance(expected, SavmapError):
            group.fail(Failure(expected))
        elif not remote:
            raise
        else:
            text = f"unexpected {format_error(error)}; please report it with savmap.log"
            group.fail(Failure(SavmapError(text), traceback.format_exc()))
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / PER_MB
    return TaskResult(group.rows, tuple(notes.lines), group.seconds, peak_mb, tuple(logged))


class _Group:
    """Rows that are mapped together, and how far they are. A row that fails keeps what was known of it before."""

    def __init__(self, job: Job, rows: dict[str, RowRecords], shown: Monitor) -> None:
        self.job, self.rows, self.shown = job, rows, shown
        self.seconds: dict[str, float] = {}
        self.requests: dict[str, RowRequest] = {}
        self.measured: dict[str, RowMeasurements] = {}
        for row in rows:
            try:
                self.requests[row] = request_for(job, row)
            except SavmapError as error:
                self._update(row, failure=Failure(error))

    def measure(self, with_strips: bool, frames: tuple[Path | None, str]) -> None:
        """Walk along the rows' footage, but for those that are measured."""
        new = [row for row in self._sound() if self.rows[row].measured is None]
        if not new:
            return
        requests = [self.requests[row] for row in new]
        if with_strips:
            site = self.job.site
            requests = [replace(request, strips=site.orthophotos, stills=site.panoramas) for request in requests]
        with self._timed(MEASURED), Journal(*frames) as journal:
            for row in new:
                if count := journal.earlier[row]:
                    self.shown.note(f"row {row}: what was measured in {count} frames is kept from an earlier run")
            for request, measured in zip(requests, measure(requests, journal, self.shown), strict=True):
                if isinstance(measured, SavmapError):
                    self._fail(request, measured)
                    continue
                self.measured[request.name] = measured.measurements
                self._update(
                    request.name,
                    measured=packed(measured.measurements),
                    strips=packed(measured.strips) if with_strips else None,
                    plugins_failed=measured.measurements.failed,
                )

    def solve(self) -> None:
        """Solve the rows together, unless all of them are solved."""
        names = self._sound()
        if all(self.rows[row].solved is not None for row in names):
            return
        with self._timed(SOLVED):
            warned = NoteCollector()
            for name in set(names) - self.measured.keys():
                self.measured[name] = unpacked(self.rows[name].measured or b"", RowMeasurements)
            measured = [MeasuredRow(self.requests[name], self.measured[name]) for name in names]
            with warnings_as_notes(warned):
                results = map_rows(measured, self.shown)
            for row, result in zip(measured, results, strict=True):
                request, failures = row.request, {**row.measurements.failed, **failed(row.request.plugins)}
                self._update(request.name, plugins_failed=failures)
                if isinstance(result, SavmapError):
                    self._fail(request, result)
                else:
                    self._update(request.name, solved=packed(with_notes(result, warned.lines)))

    def picture(self) -> None:
        """Orthophotos of the rows' faces, none of a row in which no face is known; and stills of the camera's path. A
        row without them is mapped all the same."""
        with self._timed(PICTURED):
            for row in self._sound():
                records = self.rows[row]
                if records.pictured is None and records.solved is not None and records.strips is not None:
                    try:
                        picture = picture_of(unpacked(records.solved, RowMap), unpacked(records.strips, RowStrips))
                    except SavmapError as error:
                        self.shown.note(f"row {row}: no orthophoto: {error}")
                    else:
                        self._update(row, pictured=packed(picture))

    def fail(self, failure: Failure) -> None:
        """What is not mapped by now fails."""
        for row, records in self.rows.items():
            if records.solved is None:
                self._update(row, failure=failure)

    def _sound(self) -> list[str]:
        return [row for row, records in self.rows.items() if records.failure is None]

    def _update(self, row: str, **stages: Any) -> None:
        self.rows[row] = replace(self.rows[row], **stages)

    def _fail(self, request: RowRequest, error: SavmapError) -> None:
        failures = {**self.rows[request.name].plugins_failed, **failed(request.plugins)}
        self._update(request.name, failure=Failure(because(error, failures)), plugins_failed=failures)

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        begin = time.monotonic()
        yield
        self.seconds[stage] = time.monotonic() - begin


def picture_of(row: RowMap, strips: RowStrips) -> RowPicture:
    """The picture of a mapped row."""
    picture = orthophoto(row.face, strips, row.trajectory) if row.face is not None else None
    return RowPicture(picture, spaced_stills(strips.stills, row.trajectory))


def request_for(job: Job, row: str) -> RowRequest:
    """What the job asks of one of its rows. Raises PluginError, SiteError."""
    references, earlier = job.site.row_references(row), earlier_row(job, row)
    return RowRequest(
        name=row,
        passes=job.site.rows[row].passes,
        plugins=plugins_for(job, row),
        references=references_of(references),
        travel_m=references.travel_m,
        path=None if earlier is None else earlier.trajectory,
        path_s=None if earlier is None else frozenset(zip(earlier.frames.passes, earlier.frames.stamps_s, strict=True)),
        calibration=calibration_of(job.site.row_calibration(row)),
        appearance=job.site.row_appearance(row),
        against=mapped_rows(job, row),
    )


def mapped_rows(job: Job, row: str) -> Mapping[str, RowMap]:
    """The rows of an earlier map that a row's passes may show: the one that the user names, by an option or by the
    row's name in a site file, else all."""
    from savmap.maps.map_file import read_map  # loads the JSON Schema's library, which few runs need

    if job.against is None:
        return {}
    rows = read_map(job.against).rows
    chosen = job.against_row or (None if is_footage(job.source) else row)
    return {chosen: rows[chosen]} if chosen is not None and chosen in rows else rows


def earlier_row(job: Job, row: str) -> RowMap | None:
    """The row in an earlier map, whose path of the camera is used, if the job has one. Raises SiteError where that has
    no such row."""
    from savmap.maps.map_file import read_map  # loads the JSON Schema's library, which few runs need

    if job.earlier is None:
        return None
    rows = read_map(job.earlier).rows
    if row not in rows:
        raise SiteError(f"{job.earlier}: has no row `{row}` whose camera path could be used; it has {', '.join(rows)}")
    return rows[row]


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
