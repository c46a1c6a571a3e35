"""What a run will take, found by looking at a few frames of each kind of footage on this machine."""

import resource
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import TypeVar

from savmap.errors import OutputError
from savmap.files.serialization import packed
from savmap.jobs.run_clock import MEASURED, PICTURED, SOLVED, FrameCost
from savmap.jobs.tasks import PER_MB, request_for
from savmap.maps.run_record import read_log
from savmap.pipeline.row import measure
from savmap.pipeline.second_look import warnings_held_back
from savmap.site.job import Job, plugins_for
from savmap.site.preflight import Footage

Item = TypeVar("Item")
FRAMES, WARM = 14, 4


@dataclass
class ProbeMonitor:
    """A Monitor that lets only the first few frames of a pass through, and notes, on the clock and in the processor's
    seconds, when each was asked for in the first walk."""

    ticks: list[tuple[float, float]] = field(default_factory=list)

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        ticks = self.ticks if not self.ticks else []
        for item in islice(items, FRAMES):
            ticks.append(_now())
            yield item
        ticks.append(_now())

    def note(self, line: str) -> None:
        """Lines are for runs."""

    def left(self, seconds: float) -> None:
        """So is this."""


def _now() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


@dataclass(frozen=True)
class Rate:
    """Seconds to choose a pass's views, what a frame costs, and bytes a frame of what is kept of it."""

    plan_s: float
    cost: FrameCost
    frame_bytes: float


@dataclass(frozen=True)
class ResourceEstimate:
    """What a run will take with one worker: frames, seconds of measuring them, seconds of all that comes after that, MB
    on disk for what is kept of the rows, MB of memory that were in use after a few frames. A second look at the frames,
    which most rows do not need, is not in it."""

    frames: int
    measure_s: float
    after_s: float
    disk_mb: float
    memory_mb: float

    def lines(self) -> Iterator[str]:
        """For people."""
        yield f"{self.frames} frames; measuring them will take about {duration(self.measure_s)} with one worker on this machine"
        yield f"solving and writing come on top: about {duration(self.after_s)}; so does measuring once more where a row needs a second look"
        yield f"about {self.disk_mb:.1f} MB of disk for what is kept of the rows; at least {self.memory_mb:.0f} MB of memory a worker"


def resource_estimate(job: Job, footage: Sequence[Footage]) -> ResourceEstimate:
    """What the footage will take. Raises SavmapError's kinds where a few frames of it cannot be measured."""
    rates: dict[tuple[object, ...], Rate] = {}
    for part in footage:
        kind = _kind(job, part)
        if kind not in rates:
            rates[kind] = _rate(job, part)
    parts = [(part.frames, rates[_kind(job, part)]) for part in footage]
    frames = sum(count for count, _ in parts)
    solving = _solve_rate(job.output)
    later = [PICTURED] if solving is not None else [SOLVED, PICTURED]
    return ResourceEstimate(
        frames,
        sum(rate.plan_s + count * rate.cost.frame_s + rate.cost.after_s(count, [MEASURED]) for count, rate in parts),
        sum(rate.cost.after_s(count, later) + rate.cost.drawn_s(count) for count, rate in parts)
        + frames * (solving or 0.0),
        sum(count * rate.frame_bytes for count, rate in parts) / 1e6,
        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / PER_MB,
    )


def duration(seconds: float) -> str:
    """Seconds, minutes, or hours and minutes, in words."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02d} min"


def _kind(job: Job, part: Footage) -> tuple[object, ...]:
    """What decides how long a frame takes."""
    models = tuple(plugin.model for plugin in plugins_for(job, part.row))
    extras = (job.site.row_appearance(part.row), bool(job.site.row_references(part.row).markers))
    return part.info.width, part.info.codec, part.info.rate_fps, part.row_pass.rate, models, extras


def _rate(job: Job, part: Footage) -> Rate:
    """Measure the first frames of a pass as a run does."""
    probe = ProbeMonitor()
    begin = time.perf_counter()
    request = replace(
        request_for(job, part.row),
        passes=(part.row_pass,),
        strips=job.site.orthophotos,
        stills=job.site.panoramas,
    )
    with warnings_held_back():  # of a few frames, which show a part of the row
        measured = measure(request, probe)
    stored = packed(measured.measurements) + packed(measured.strips)
    ticks = probe.ticks
    cost = FrameCost.of(ticks[min(WARM, len(ticks) - 2) :])
    return Rate(ticks[0][0] - begin, cost, len(stored) / (len(ticks) - 1))


def _solve_rate(output: Path) -> float | None:
    """Seconds a frame that solving took in the last run into a folder, if there was one."""
    try:
        rows = read_log(output / "run.json").rows.values()
    except OutputError:
        return None
    solved = [row for row in rows if row.used and SOLVED in row.seconds]
    return sum(row.seconds[SOLVED] for row in solved) / sum(row.used for row in solved) if solved else None
