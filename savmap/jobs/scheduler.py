"""All rows of a job, each stage done once: what an earlier run kept is used, the rest is given to workers, one task for
rows that are seen in the same frames, and a row that fails stops no other."""

import logging
import os
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, Literal

from savmap.errors import SavmapError, SiteError
from savmap.files.journal import Journal, forget
from savmap.files.serialization import unpacked
from savmap.jobs import tasks
from savmap.jobs.cache import FolderCache
from savmap.jobs.cache_keys import digest, measurement_key, picture_key, solution_key, strips_key
from savmap.jobs.executors import Cluster, Shown, Task, WorkerCrashedError, in_processes, in_turn
from savmap.jobs.run_clock import MEASURED, PICTURED, SOLVED, RunClock, Walk
from savmap.maps.run_record import RowRun, RunLog
from savmap.pipeline.drive import frames_of
from savmap.plugin import trace
from savmap.site.job import Job
from savmap.types import Orthophoto, RowMap, Still
from savmap.types.progress import Monitor

log = logging.getLogger("savmap")
STRIPS = "strips"
Group = tuple[str, ...]
Executor = Callable[[Mapping[Hashable, Task]], Iterator[tuple[Any, Any]]]
"""Runs tasks, and gives key and result of each."""


@dataclass(frozen=True)
class RunOptions:
    """How a job is run: in so many processes (0: in this one; None: as fits the rows and this machine) or by the
    workers of the Dask scheduler at an address, and whether what an earlier run kept is forgotten first."""

    jobs: int | None = None
    fresh: bool = False
    cluster: str | None = None

    def executor(self, job: Job, groups: int, shown: Shown) -> tuple[Executor, int]:
        """What runs the tasks of so many groups of rows, and with how many workers. Raises SavmapError where a cluster
        cannot."""
        if self.cluster is not None:
            cluster = Cluster(self.cluster, job)
            return cluster.results, cluster.workers
        jobs = max(min(groups, (os.cpu_count() or 1) // 2), 1) if self.jobs is None else self.jobs
        if not jobs:
            return partial(in_turn, shown=shown), 1
        return partial(in_processes, processes=jobs, timeout_s=job.site.plugin_timeout_s, shown=shown), jobs


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
    job: Job, options: RunOptions, monitor: Monitor, cache: FolderCache, with_pictures: bool = False
) -> MappedRows:
    """Map all rows of a job, with the pictures of them that it asks for, if any are wanted. Raises the first row's
    error where none could be mapped, and KeyboardInterrupt that says what is kept."""
    begin = time.monotonic()
    groups = groups_of(job)
    clock = RunClock({group: Walk.of(job.site, group) for group in groups}, monitor, with_pictures)
    executor, workers = options.executor(job, len(groups), clock.task)
    progress = _Progress(job, cache, monitor, groups, clock, with_pictures, options.cluster is None)
    try:
        begun = {group: progress.begin(group) for group in groups}
        results = executor({group: task for group, task in begun.items() if task is not None})
        with clock.reported(workers):
            for _ in monitor.each(progress.rows_done(results), "rows mapped", len(job.site.rows)):
                pass
    except KeyboardInterrupt as interrupt:
        raise KeyboardInterrupt(progress.kept() or "nothing yet") from interrupt
    if not progress.solved:
        raise next(iter(progress.failed.values()))
    maps = {name: unpacked(progress.solved[name], RowMap) for name in job.site.rows if name in progress.solved}
    for name, row in maps.items():
        is_new = name in progress.runs and SOLVED in progress.runs[name].seconds
        for note in [str(text) for key, text in row.report.items() if not is_new and key.startswith(tasks.NOTE)]:
            monitor.note(f"row {name}: {note.removeprefix(f'row {name}: ')}")
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


@dataclass(eq=False)
class _Progress:
    """How far the rows are: cache keys, maps and pictures, the errors of rows that failed, and, of rows in which
    something was done, what that was. `wants_pictures`: whether pictures are made. `is_here`: whether tasks are run on
    this machine, where what is measured in single frames is kept. `solved_by`: the keys of groups' maps, as they were
    when the work on them began. `earlier`: by row, what an earlier run kept of it."""

    job: Job
    cache: FolderCache
    monitor: Monitor
    groups: Sequence[Group]
    clock: RunClock
    wants_pictures: bool
    is_here: bool
    keys: dict[str, str] = field(default_factory=dict)
    solved_by: dict[Group, str] = field(default_factory=dict)
    earlier: dict[str, tasks.RowRecords] = field(default_factory=dict)
    solved: dict[str, bytes] = field(default_factory=dict)
    pictures: dict[str, tasks.RowPicture] = field(default_factory=dict)
    failed: dict[str, SavmapError] = field(default_factory=dict)
    runs: dict[str, RowRun] = field(default_factory=dict)

    def begin(self, group: Group) -> Task | None:
        """Use what an earlier run kept of a group; the task that works out the rest, if there is any."""
        self.keys |= {name: measurement_key(self.job, name) for name in group}
        self.solved_by[group] = solution_key(self.job, self._keys_of(group))
        records_of = {name: self._known(name, self.solved_by[group]) for name in group}
        self.earlier |= records_of
        if all(records.solved is not None for records in records_of.values()):
            self.monitor.note(f"kept from an earlier run: row {' and '.join(group)}")
            if not self.wants_pictures or all(records.pictured is not None for records in records_of.values()):
                self.clock.end(group)
                for name, records in records_of.items():
                    self._show(name, records)
                return None
        frames = self._frames(group) if self.is_here else (None, "")
        return partial(tasks.map_task, with_pictures=self.wants_pictures, frames=frames), (self.job, records_of)

    def rows_done(self, results: Iterable[tuple[Group, Any]]) -> Iterator[None]:
        """Take what tasks gave; an item for each row that is done with."""
        counted = 0
        for group, result in chain([(None, None)], results):
            if group is not None:
                self.take(group, result)
            done = len(self.failed) + len(self.solved)
            yield from [None] * (done - counted)
            counted = done

    def take(self, group: Group, result: tasks.TaskResult | BaseException) -> None:
        """Keep what a task gave of its rows. What is not whole is not kept: where a plugin failed, it is tried again
        next time."""
        if isinstance(result, WorkerCrashedError):
            why = "out of memory, killed, crashed, or plugin_timeout_s in a hook"
            failure = tasks.Failure(SavmapError(f"its process ended before it was mapped: {why}"))
            result = tasks.TaskResult({name: tasks.RowRecords(failure=failure) for name in group})
        if isinstance(result, BaseException):
            raise result
        done = result
        self.clock.end(group)
        for line in done.notes:
            self.monitor.note(line)
        for line in done.logged:
            trace.log.info("%s", line)
        is_other = solution_key(self.job, self._keys_of(group)) != self.solved_by[group]
        for name, records in done.rows.items():
            if is_other and self.job.against is not None:
                text = f"--against: {self.job.against} was changed while row {name} was mapped; run it again"
                records = replace(records, solved=None, pictured=None, failure=tasks.Failure(SiteError(text)))
            self.runs[name] = RowRun(
                status="mapped" if {MEASURED, SOLVED}.intersection(done.seconds) else "kept",
                seconds={stage: round(spent / len(group), 3) for stage, spent in done.seconds.items()},
                peak_mb=round(done.peak_mb, 1),
                plugins_failed=dict(records.plugins_failed),
            )
            if not records.plugins_failed:
                self._save(name, records, self.solved_by[group])
            if records.failure is not None:
                self._fail(name, records.failure)
            else:
                self._show(name, records)
        frames, _ = self._frames(group)
        again = any(records.measured is None or records.plugins_failed for records in done.rows.values())
        if frames is not None and not again:
            forget(frames)

    def row_run(self, name: str, row: RowMap | None) -> RowRun:
        """What was done with a row, for run.json."""
        run = self.runs.get(name, RowRun(status="kept"))
        if row is None:
            return RowRun(status="failed", error=str(self.failed[name]), seconds=run.seconds)
        return run.model_copy(update={"used": len(row.frames), "skipped": row.skipped})

    def kept(self) -> str:
        """What a second run will not do again, in words; "" where nothing is kept."""
        measured = [name for name, records in self.earlier.items() if records.measured and name not in self.solved]
        said = [
            f"{_named(names)} ({stage})"
            for stage, names in (("mapped", [*self.solved]), ("measured", measured))
            if names
        ]
        for group in self.groups:
            frames, key = self._frames(group) if all(name in self.keys for name in group) else (None, "")
            is_kept = frames is not None and frames.is_file()
            for name, count in (Journal(frames, key, is_reader=True).earlier if is_kept else {}).items():
                if name in group and name not in (*self.solved, *measured):
                    said.append(f"row {name} ({count} of {frames_of(self.job.site.rows[name].passes)} frames)")
        return ", ".join(said)

    def _known(self, name: str, solved_by: str) -> tasks.RowRecords:
        """What an earlier run kept of a row. Where its pictures are wanted, and what they are made of is not kept, it
        is measured anew."""
        strips_by = strips_key(self.job, self.keys[name])
        strips = self.cache.load(name, STRIPS, strips_by)
        solved = self.cache.load(name, SOLVED, solved_by)
        pictured = self.cache.load(name, PICTURED, picture_key(strips_by, solved)) if solved else None
        measured = self.cache.load(name, MEASURED, self.keys[name])
        is_lost = self.wants_pictures and strips is None and pictured is None
        return tasks.RowRecords(None if is_lost else measured, strips, solved, pictured)

    def _save(self, name: str, records: tasks.RowRecords, solved_by: str) -> None:
        """Keep what an earlier run did not."""
        earlier, strips_by = self.earlier[name], strips_key(self.job, self.keys[name])
        solved = records.solved
        pictured_by = picture_key(strips_by, solved) if solved is not None else ""
        kept = [
            (MEASURED, self.keys[name], records.measured, earlier.measured),
            (STRIPS, strips_by, records.strips, earlier.strips),
            (SOLVED, solved_by, solved, earlier.solved),
            (PICTURED, pictured_by, records.pictured, earlier.pictured),
        ]
        for stage, key, record, before in kept:
            if record is not None and before is None:
                self.cache.save(name, stage, key, record)

    def _show(self, name: str, records: tasks.RowRecords) -> None:
        if records.solved is not None:
            self.solved[name] = records.solved
        if self.wants_pictures and records.pictured is not None:
            self.pictures[name] = unpacked(records.pictured, tasks.RowPicture)

    def _frames(self, group: Group) -> tuple[Path | None, str]:
        """File and key of the journal of what is measured in single frames of rows: with the first of them."""
        keys = {name: strips_key(self.job, self.keys[name]) for name in group}
        return self.cache.frames(group[0]), digest(frames=keys)

    def _keys_of(self, group: Group) -> Mapping[str, str]:
        return {name: self.keys[name] for name in group}

    def _fail(self, name: str, failure: tasks.Failure) -> None:
        if failure.trace:
            log.error("row %s: %s", name, failure.trace)
        self.failed[name] = failure.error
        if len(self.job.site.rows) > 1:
            self.monitor.note(f"row {name} is not mapped: {str(failure.error).removeprefix(f'row {name}: ')}")


def _named(rows: Sequence[str]) -> str:
    return f"{'row' if len(rows) == 1 else 'rows'} {', '.join(rows)}"
