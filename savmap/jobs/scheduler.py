"""All rows of a job, each stage done once: what an earlier run kept is used, the rest is given to workers, and a row
that fails stops no other."""

import logging
import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from typing import Any, Literal, TypeVar

from savmap.errors import SavmapError
from savmap.files.journal import Parts, counts, forget
from savmap.jobs import tasks
from savmap.jobs.cache import RowCache, StoredRecord
from savmap.jobs.cache_keys import measurement_key, picture_key, solution_key, strips_key
from savmap.jobs.executors import DaskExecutor, ProcessExecutor, SerialExecutor, Shown, TaskExecutor, WorkerCrashedError
from savmap.jobs.run_clock import MEASURED, PICTURED, SOLVED, RunClock
from savmap.maps.run_record import RowRun, RunLog
from savmap.pipeline.measure import frames_of
from savmap.pipeline.records import RowMeasurements
from savmap.plugin import trace
from savmap.site.job import Job
from savmap.types import Orthophoto, RowMap, RowStrips, Still
from savmap.types.progress import Monitor

log = logging.getLogger("savmap")
STRIPS = "strips"
Record = TypeVar("Record")
Group = tuple[str, ...]
Key = tuple[str, Group]


@dataclass(frozen=True)
class RunOptions:
    """How a job is run: in so many processes (0: in this one; None: as fits the rows and this machine) or by the
    workers of the Dask scheduler at an address, and whether what an earlier run kept is ignored."""

    jobs: int | None = None
    fresh: bool = False
    cluster: str | None = None

    def executor(self, job: Job, groups: int, shown: Shown) -> tuple[TaskExecutor, int]:
        """Who runs the tasks of so many groups of rows, and with how many workers. Raises SavmapError where a cluster
        cannot."""
        if self.cluster is not None:
            dask = DaskExecutor(self.cluster, job)
            return dask, dask.count
        jobs = max(min(groups, (os.cpu_count() or 1) // 2), 1) if self.jobs is None else self.jobs
        return (ProcessExecutor(jobs, job.site.plugin_timeout_s, shown), jobs) if jobs else (SerialExecutor(shown), 1)


@dataclass(frozen=True, eq=False)
class MappedRows:
    """Rows' maps by name, in the site's order; the errors of the others; what was done; and, if they were asked for,
    orthophotos of the faces that are known and stills of the camera's path."""

    rows: Mapping[str, RowMap]
    failed: Mapping[str, SavmapError]
    log: RunLog
    orthophotos: Mapping[str, Orthophoto] = field(default_factory=dict)
    stills: Mapping[str, Sequence[Still]] = field(default_factory=dict)


def map_rows_of(
    job: Job, options: RunOptions, monitor: Monitor, cache: RowCache, with_pictures: bool = False
) -> MappedRows:
    """Map all rows of a job, with the pictures of them that it asks for, if any are wanted. Raises the first row's
    error where none could be mapped, and KeyboardInterrupt that says what is kept."""
    begin = time.monotonic()
    groups = groups_of(job)
    sizes = {name: (frames_of(row.passes), len(row.passes)) for name, row in job.site.rows.items()}
    clock = RunClock(sizes, groups, monitor, with_pictures)
    executor, workers = options.executor(job, len(groups), clock.task)
    progress = _Progress(job, cache, executor, monitor, groups, clock, with_pictures)
    try:
        for group in groups:
            progress.begin(group)
        with clock.reported(workers):
            for _ in monitor.each(progress.rows_done(executor.results()), "rows mapped", len(sizes)):
                pass
    except KeyboardInterrupt as interrupt:
        raise KeyboardInterrupt(progress.kept() or "nothing yet") from interrupt
    if not progress.solved:
        raise next(iter(progress.failed.values()))
    maps = {name: progress.solved[name].record for name in job.site.rows if name in progress.solved}
    for name, row in maps.items():
        if SOLVED not in progress.seconds.get(name, {}):
            _show_notes(row, monitor)
    runs = {name: progress.row_run(name, maps.get(name)) for name in job.site.rows}
    failed = {name: progress.failed[name] for name in job.site.rows if name in progress.failed}
    whole = not failed and not any(run.plugins_failed for run in runs.values())
    status: Literal["mapped", "incomplete"] = "mapped" if whole else "incomplete"
    log = RunLog(rows=runs, wall_s=round(time.monotonic() - begin, 2), jobs=workers, status=status)
    shown = {name: progress.pictures[name] for name in maps if name in progress.pictures}
    photos = {name: picture.orthophoto for name, picture in shown.items() if picture.orthophoto is not None}
    return MappedRows(maps, failed, log, photos, {name: picture.stills for name, picture in shown.items()})


def groups_of(job: Job) -> Sequence[Group]:
    """Rows by name in groups that are solved together; each alone where its camera path is known."""
    groups = job.site.joint_groups() if job.earlier is None else [[name] for name in job.site.rows]
    return [tuple(names) for names in groups]


def _show_notes(row: RowMap, monitor: Monitor) -> None:
    """Show the notes of a row that an earlier run mapped."""
    for key, text in row.report.items():
        if key.startswith(tasks.NOTE):
            monitor.note(f"row {row.name}: {str(text).removeprefix(f'row {row.name}: ')}")


@dataclass(eq=False)
class _Progress:
    """How far the rows are: cache keys, what was measured, maps, the errors of rows that failed, and, by row, the
    plugins that failed in it. `wants_pictures`: whether pictures are made, `pictured_next`: of which solved rows they
    still are; of strips only those are held that the cache does not keep."""

    job: Job
    cache: RowCache
    executor: TaskExecutor
    monitor: Monitor
    groups: Sequence[Group]
    clock: RunClock
    wants_pictures: bool = False
    keys: dict[str, str] = field(default_factory=dict)
    solution_keys: dict[Group, str] = field(default_factory=dict)
    measured: dict[str, StoredRecord[RowMeasurements]] = field(default_factory=dict)
    solved: dict[str, StoredRecord[RowMap]] = field(default_factory=dict)
    strips: dict[str, StoredRecord[RowStrips]] = field(default_factory=dict)
    pictures: dict[str, tasks.RowPicture] = field(default_factory=dict)
    pictured_next: set[str] = field(default_factory=set)
    failed: dict[str, SavmapError] = field(default_factory=dict)
    seconds: dict[str, dict[str, float]] = field(default_factory=dict)
    peak_mb: dict[str, float] = field(default_factory=dict)
    plugins_failed: dict[str, dict[str, str]] = field(default_factory=dict)

    def begin(self, group: Group) -> None:
        """Use what an earlier run kept of a group, and have the rest worked out."""
        self.keys |= {name: measurement_key(self.job, name) for name in group}
        if self._use_kept(group):
            return
        for name in group:
            measured = self._kept(name, MEASURED, RowMeasurements, self.keys[name])
            if measured is not None and (not self.wants_pictures or self._strips_of(name) is not None):
                self.measured[name] = measured
                self.clock.skip(name, MEASURED)
                continue
            frames = self._frames(name) if self.executor.shown is not None else None
            task = partial(tasks.measure_task, with_strips=self.wants_pictures, frames=frames)
            self.executor.submit((MEASURED, (name,)), task, self.job, name)
        self._solve_if_measured(group)

    def rows_done(self, results: Iterable[tuple[Key, Any]]) -> Iterator[None]:
        """Take what tasks gave; an item for each row that is done with."""
        counted = 0
        for key, result in chain([(None, None)], results):
            if key is not None:
                self.take(key, result)
            done = len(self.failed) + len(self.solved.keys() - self.pictured_next)
            yield from [None] * (done - counted)
            counted = max(done, counted)

    def take(self, key: Key, result: tasks.TaskResult | BaseException) -> None:
        """Keep what a task gave, and go on from there."""
        stage, names = key
        done = result if isinstance(result, tasks.TaskResult) else _crashed(key, result)
        for line in done.notes:
            self.monitor.note(line)
        trace.log_lines(done.logged)
        for name, record in done.records.items():
            self.clock.end(stage, name)
            self.plugins_failed.setdefault(name, {}).update(done.plugins_failed.get(name, {}))
            self.seconds.setdefault(name, {})[stage] = round(done.seconds / len(names), 3)
            self.peak_mb[name] = max(self.peak_mb.get(name, 0.0), round(done.peak_mb, 1))
            if isinstance(record, tasks.Failure):
                self._fail(name, stage, record)
            elif stage == MEASURED:
                self._take_measured(name, record, done.strips.get(name))
            elif stage == SOLVED:
                self._save(name, SOLVED, self._solution_key(names), record)
                self.solved[name] = record
                self.measured.pop(name, None)
                self._picture(name)
            else:
                self._save(name, PICTURED, self._picture_key(name, self.solved[name]), record)
                self._show(name, record)
        if stage == MEASURED:
            self._solve_if_measured(next(group for group in self.groups if names[0] in group))

    def row_run(self, name: str, row: RowMap | None) -> RowRun:
        """What was done with a row, for run.json."""
        seconds = self.seconds.get(name, {})
        if row is None:
            return RowRun(status="failed", error=str(self.failed[name]), seconds=seconds)
        return RowRun(
            status="mapped" if {MEASURED, SOLVED}.intersection(seconds) else "kept",
            seconds=seconds,
            used=len(row.frames),
            skipped=row.skipped,
            peak_mb=self.peak_mb.get(name, 0.0),
            plugins_failed=self.plugins_failed.get(name, {}),
        )

    def kept(self) -> str:
        """What a second run will not do again, in words; "" where nothing is kept."""
        stages = {"mapped": list(self.solved), "measured": [name for name in self.measured if name not in self.solved]}
        said = [f"{_named(names)} ({stage})" for stage, names in stages.items() if names]
        for name, row in self.job.site.rows.items():
            frames = self._frames(name)
            done = [] if frames is None or name in self.measured or name in self.solved else [*counts(frames).values()]
            said += [f"row {name} ({done[0]} of {frames_of(row.passes)} frames)"] if done else []
        return ", ".join(said) if self._frames(next(iter(self.keys))) is not None else ""

    def _kept(self, name: str, stage: str, kind: type[Record], key: str) -> StoredRecord[Record] | None:
        content = self.cache.load(name, stage, key)
        return None if content is None else StoredRecord(kind, content=content)

    def _save(self, name: str, stage: str, key: str, record: StoredRecord[Any]) -> None:
        """Keep what is whole: where a plugin failed, it is tried again next time."""
        if not self.plugins_failed[name]:
            self.cache.save(name, stage, key, record.content)

    def _take_measured(
        self, name: str, record: StoredRecord[RowMeasurements], strips: StoredRecord[RowStrips] | None
    ) -> None:
        """Strips that the cache does not keep are held until they are used."""
        self._save(name, MEASURED, self.keys[name], record)
        self.measured[name] = record
        if strips is not None:
            self._save(name, STRIPS, self._strips_key(name), strips)
            if self.cache.load(name, STRIPS, self._strips_key(name)) is None:
                self.strips[name] = strips
        frames = self._frames(name)
        if frames is not None and not self.plugins_failed[name]:
            forget(frames)

    def _solve_if_measured(self, group: Group) -> None:
        """Once all rows of a group were measured, or failed: solve those that were measured."""
        if not all(name in self.measured or name in self.failed for name in group):
            return
        names = tuple(name for name in group if name in self.measured)
        if names and not self._use_kept(names):
            measured = {name: self.measured[name] for name in names}
            self.executor.submit((SOLVED, names), tasks.solve_task, self.job, measured)

    def _use_kept(self, names: Group) -> bool:
        maps: dict[str, StoredRecord[RowMap]] = {}
        for name in names:
            row = self._kept(name, SOLVED, RowMap, self._solution_key(names))
            if row is None or (self.wants_pictures and not self._can_be_shown(name, row)):
                return False
            maps[name] = row
        self.monitor.note(f"kept from an earlier run: row {' and '.join(names)}")
        self.solved |= maps
        for name in names:
            self.clock.skip(name, MEASURED, SOLVED)
            self._picture(name)
        return True

    def _can_be_shown(self, name: str, row: StoredRecord[RowMap]) -> bool:
        """Whether a row's orthophoto is kept, or what it is made of."""
        return self._kept_picture(name, row) is not None or self._strips_of(name) is not None

    def _picture(self, name: str) -> None:
        """Use a row's orthophoto from an earlier run, or have it made."""
        if not self.wants_pictures:
            return
        row = self.solved[name]
        kept = self._kept_picture(name, row)
        strips = self._strips_of(name) if kept is None else None
        if strips is not None:
            self.pictured_next.add(name)
            self.executor.submit((PICTURED, (name,)), tasks.picture_task, self.job, {name: (row, strips)})
            self.strips.pop(name, None)
            return
        self.clock.skip(name, PICTURED)
        if kept is not None:
            self._show(name, kept)

    def _show(self, name: str, record: StoredRecord[tasks.RowPicture]) -> None:
        self.pictured_next.discard(name)
        self.pictures[name] = record.record

    def _kept_picture(self, name: str, row: StoredRecord[RowMap]) -> StoredRecord[tasks.RowPicture] | None:
        return self._kept(name, PICTURED, tasks.RowPicture, self._picture_key(name, row))

    def _strips_of(self, name: str) -> StoredRecord[RowStrips] | None:
        return self.strips.get(name) or self._kept(name, STRIPS, RowStrips, self._strips_key(name))

    def _frames(self, name: str) -> Parts | None:
        return self.cache.frames(name, self._strips_key(name))

    def _strips_key(self, name: str) -> str:
        return strips_key(self.job, self.keys[name])

    def _picture_key(self, name: str, row: StoredRecord[RowMap]) -> str:
        return picture_key(self._strips_key(name), row.content)

    def _solution_key(self, names: Group) -> str:
        if names not in self.solution_keys:
            self.solution_keys[names] = solution_key(self.job, {name: self.keys[name] for name in names})
        return self.solution_keys[names]

    def _fail(self, name: str, stage: str, failure: tasks.Failure) -> None:
        """A row without an orthophoto is mapped all the same."""
        if failure.trace:
            log.error("row %s: %s", name, failure.trace)
        if stage == PICTURED:
            self.pictured_next.discard(name)
            self.monitor.note(f"row {name}: no orthophoto: {failure.error}")
            return
        self.failed[name] = failure.error
        self.measured.pop(name, None)
        self.clock.skip(name, MEASURED, SOLVED, PICTURED)
        if len(self.job.site.rows) > 1:
            self.monitor.note(f"row {name} is not mapped: {str(failure.error).removeprefix(f'row {name}: ')}")


def _named(rows: Sequence[str]) -> str:
    return f"{'row' if len(rows) == 1 else 'rows'} {', '.join(rows)}"


def _crashed(key: Key, error: BaseException) -> tasks.TaskResult:
    """The failure of rows whose process ended without a result. Any other error is raised."""
    stage, names = key
    if not isinstance(error, WorkerCrashedError):
        raise error
    what = f"its process ended before it was {stage}: out of memory, killed, crashed, or plugin_timeout_s in a hook"
    return tasks.TaskResult({name: tasks.Failure(SavmapError(what)) for name in names})
