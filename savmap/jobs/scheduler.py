"""All rows of a job, each stage done once: what was kept is taken, the rest is given to workers, and one bad row stops no other."""

import logging
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from savmap.errors import SavmapError
from savmap.jobs import tasks
from savmap.jobs.cache import Store
from savmap.jobs.cache_keys import measurement_key, solution_key
from savmap.jobs.executors import Beside, Here, WorkerCrashedError, Workers
from savmap.maps.map_file import map_of
from savmap.maps.run_record import RowRun, RunLog
from savmap.plugin import trace
from savmap.site.job import Job
from savmap.types import RowMap
from savmap.types.progress import Monitor

log = logging.getLogger("savmap")
SEEN, SOLVED = "seen", "solved"
Key = tuple[str, tuple[str, ...]]


@dataclass(frozen=True)
class RunOptions:
    """How a job is done: in so many processes (0: in this one; None: as fits the rows and this machine) or by the workers of the
    Dask scheduler at an address, and whether nothing that was kept is believed."""

    jobs: int | None = None
    fresh: bool = False
    cluster: str | None = None

    def workers(self, job: Job, joint_groups: int, monitor: Monitor) -> tuple[Workers, int]:
        """Who works on so many drives, and how many of them there are. Raises SavmapError where a cluster cannot."""
        if self.cluster is not None:
            from savmap.jobs.dask_executor import Cluster

            cluster = Cluster(self.cluster, job)
            return cluster, cluster.count
        jobs = self.jobs
        if jobs is None:
            jobs = min(joint_groups, max((os.cpu_count() or 1) // 2, 1)) if joint_groups > 1 else 0
        return (Beside(jobs), jobs) if jobs else (Here(monitor), 1)


@dataclass(frozen=True)
class Mapped:
    """Rows' maps by name, in the site's order; the errors of the others; what was done."""

    rows: Mapping[str, RowMap]
    failed: Mapping[str, SavmapError]
    log: RunLog


def mapped_rows(job: Job, way: RunOptions, monitor: Monitor) -> Mapped:
    """Map all rows. Raises the first row's error where none could be mapped."""
    begin = time.monotonic()
    joint_groups = drives_of(job)
    workers, jobs = way.workers(job, len(joint_groups), monitor)
    rows = Rows(job, Store(job.output, way.fresh), workers, monitor, joint_groups)
    for drive in joint_groups:
        rows.begin(drive)
    pieces = workers.results()
    if workers.monitor is None:
        pieces = monitor.each(pieces, "rows seen and solved", len(job.site.rows) + len(joint_groups))
    for key, result in pieces:
        rows.take(key, result)
    if not rows.texts:
        raise next(iter(rows.failed.values()))
    order = [name for name in job.site.rows if name in rows.texts]
    maps = {name: map_of(rows.texts[name].decode(), name).rows[name] for name in order}
    for name, row in maps.items():
        if name not in rows.seconds:
            log_lines(row, monitor)
    done = {name: rows.told(name, maps.get(name)) for name in job.site.rows}
    failed = {name: rows.failed[name] for name in job.site.rows if name in rows.failed}
    return Mapped(maps, failed, RunLog(rows=done, wall_s=round(time.monotonic() - begin, 2), jobs=jobs))


def log_lines(row: RowMap, monitor: Monitor) -> None:
    """The notes of a row that was kept from an earlier run."""
    for key, text in row.report.items():
        if key.startswith(tasks.NOTE):
            monitor.note(f"row {row.name}: {str(text).removeprefix(f'row {row.name}: ')}")


def drives_of(job: Job) -> Sequence[tuple[str, ...]]:
    """Rows by name in groups that are solved together; each alone where its camera path is known."""
    groups = job.site.joint_groups() if job.earlier is None else [[name] for name in job.site.rows]
    return [tuple(names) for names in groups]


@dataclass
class Rows:
    """How far the rows are: fingerprints and content of what was seen, the texts of maps, the errors of rows that failed,
    and, by row, the plugins without which it was mapped."""

    job: Job
    store: Store
    workers: Workers
    monitor: Monitor
    joint_groups: Sequence[tuple[str, ...]]
    prints: dict[str, str] = field(default_factory=dict)
    solved_prints: dict[tuple[str, ...], str] = field(default_factory=dict)
    seen: dict[str, bytes] = field(default_factory=dict)
    texts: dict[str, bytes] = field(default_factory=dict)
    failed: dict[str, SavmapError] = field(default_factory=dict)
    seconds: dict[str, dict[str, float]] = field(default_factory=dict)
    peak_mb: dict[str, float] = field(default_factory=dict)
    lacking: dict[str, dict[str, str]] = field(default_factory=dict)

    def begin(self, drive: tuple[str, ...]) -> None:
        """Take what was kept of a drive, and have the rest worked out."""
        self.prints |= {name: measurement_key(self.job, name) for name in drive}
        if self._take_kept(drive):
            return
        for name in drive:
            kept = self.store.kept(name, SEEN, self.prints[name])
            if kept is not None:
                self.seen[name] = kept
            else:
                self._submit((SEEN, (name,)), tasks.see, name)
        self._solve_if_seen(drive)

    def take(self, key: Key, result: tasks.Done | BaseException) -> None:
        """Keep what a piece of work gave, and go on from there."""
        stage, names = key
        done = result if isinstance(result, tasks.Done) else _lost(names, result)
        for line in done.notes:
            self.monitor.note(line)
        trace.log_lines(done.logged)
        for name, content in done.content.items():
            self.lacking.setdefault(name, {}).update(done.lacking.get(name, {}))
            self.seconds.setdefault(name, {})[stage] = round(done.seconds / len(names), 3)
            self.peak_mb[name] = max(self.peak_mb.get(name, 0.0), round(done.peak_mb, 1))
            if isinstance(content, tasks.Failure):
                self._fail(name, content)
            elif stage == SEEN:
                self._keep(name, SEEN, self.prints[name], content)
                self.seen[name] = content
            else:
                self._keep(name, SOLVED, self._solved_print(names), content)
                self.texts[name] = content
        if stage == SEEN:
            self._solve_if_seen(next(drive for drive in self.joint_groups if names[0] in drive))

    def told(self, name: str, row: RowMap | None) -> RowRun:
        """What was done with a row, for run.json."""
        if row is None:
            return RowRun(status="failed", error=str(self.failed[name]), seconds=self.seconds.get(name, {}))
        seconds = self.seconds.get(name, {})
        return RowRun(
            status="mapped" if seconds else "kept",
            seconds=seconds,
            used=len(row.frames),
            peak_mb=self.peak_mb.get(name, 0.0),
            plugins_failed=self.lacking.get(name, {}),
        )

    def _keep(self, name: str, stage: str, print_: str, content: bytes) -> None:
        """Keep what is whole: where a plugin failed, it is tried again next time."""
        if not self.lacking[name]:
            self.store.keep(name, stage, print_, content)

    def _solve_if_seen(self, drive: tuple[str, ...]) -> None:
        """Once all rows of a drive were seen, or failed: solve those that were seen."""
        if not all(name in self.seen or name in self.failed for name in drive):
            return
        names = tuple(name for name in drive if name in self.seen)
        if names and not self._take_kept(names):
            self._submit((SOLVED, names), tasks.solve, {name: self.seen[name] for name in names})
        for name in names:
            del self.seen[name]

    def _take_kept(self, names: tuple[str, ...]) -> bool:
        kept = {name: self.store.kept(name, SOLVED, self._solved_print(names)) for name in names}
        found = {name: text for name, text in kept.items() if text is not None}
        if len(found) < len(names):
            return False
        self.monitor.note(f"kept from an earlier run: row {' and '.join(names)}")
        self.texts |= found
        return True

    def _solved_print(self, names: tuple[str, ...]) -> str:
        if names not in self.solved_prints:
            self.solved_prints[names] = solution_key(self.job, {name: self.prints[name] for name in names})
        return self.solved_prints[names]

    def _submit(self, key: Key, do: Callable[..., tasks.Done], what: object) -> None:
        talk = () if self.workers.monitor is None else (self.workers.monitor,)
        self.workers.submit(key, do, self.job, what, *talk)

    def _fail(self, name: str, failure: tasks.Failure) -> None:
        self.failed[name] = failure.error
        if len(self.job.site.rows) > 1:
            self.monitor.note(f"row {name} is not mapped: {str(failure.error).removeprefix(f'row {name}: ')}")
        if failure.trace:
            log.error("row %s: %s", name, failure.trace)


def _lost(names: tuple[str, ...], error: BaseException) -> tasks.Done:
    if not isinstance(error, WorkerCrashedError):
        raise error
    return tasks.Done({name: tasks.Failure(SavmapError(str(error))) for name in names})
