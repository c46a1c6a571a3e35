"""How far the rows of a run are, and how long the rest of it will take."""

import heapq
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass, field
from typing import TypeVar

import numpy as np

from savmap.types.progress import Monitor

MEASURED, SOLVED, PICTURED = "measured", "solved", "pictured"
PLAN_FRAMES = 28
"""Choosing a pass's views takes as long as measuring so many frames: it looks at a fixed number of key frames."""
SHARES = {MEASURED: 0.45, SOLVED: 0.32, PICTURED: 0.04}
DRAWN = 0.03
"""What follows the walk over a row's frames, in shares of the processor time of that: all frames put together, the
solve, the orthophoto; and the files that are written of it in the end. They are those of the rows of the demo's aisle,
and count until a row of the run has been through a stage."""
LEAST_STEPS, STEPS = 8, 40
"""Frames from which the time of a frame is told: at least, and at most the last so many."""
KEPT = 5.0
"""A frame that is only decoded takes a tenth of one that is measured."""
TICK_S = 1.0
Item = TypeVar("Item")


@dataclass(frozen=True)
class FrameCost:
    """What measuring a frame takes: seconds on the clock, and of what follows the walk for each frame, which is work
    for one core: the processor's seconds, or those on the clock where the machine gives a process less than a core."""

    frame_s: float
    single_s: float

    @classmethod
    def of(cls, ticks: Sequence[tuple[float, float]]) -> "FrameCost":
        """From the clock's and the processor's seconds (n > 1) at the ends of frames."""
        wall, processor = ((ticks[-1][k] - ticks[0][k]) / (len(ticks) - 1) for k in (0, 1))
        return cls(wall, max(wall, processor))

    def plan_s(self, passes: int) -> float:
        """Of choosing the views of passes."""
        return PLAN_FRAMES * self.single_s * passes

    def after_s(self, frames: int, stages: Iterable[str] = SHARES) -> float:
        """Of what follows the walk over so many frames, but for the files that are written in the end."""
        return frames * self.single_s * sum(SHARES[stage] for stage in stages)

    def drawn_s(self, frames: int) -> float:
        """Of the files that are written of so many frames in the end."""
        return DRAWN * frames * self.single_s


@dataclass(eq=False)
class _Row:
    """How far a row is: the stages that are not done, the one in work, since when and for how many frames of all its
    rows, walks that began and ended, and how many frames of the last walk are done."""

    frames: int
    passes: int
    stages: list[str]
    stage: str = ""
    since_s: float = 0.0
    at_once: int = 0
    begun: int = 0
    ended: int = 0
    done: int = 0
    ticks: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=STEPS))

    @property
    def is_walked(self) -> bool:
        """Whether all passes were walked through: what comes now are second looks, and what needs no frames."""
        return self.ended >= self.passes


class RunClock:
    """The rows of a run by name, with their frames and passes, in groups that are solved together. Tells the monitor
    every second how long the rest will take, once a row's frames tell how long they take."""

    def __init__(
        self,
        rows: Mapping[str, tuple[int, int]],
        groups: Iterable[Sequence[str]],
        monitor: Monitor,
        pictures: bool,
    ) -> None:
        stages = [MEASURED, SOLVED, *([PICTURED] if pictures else [])]
        self.rows = {name: _Row(frames, passes, [*stages]) for name, (frames, passes) in rows.items()}
        self.groups = [[self.rows[name] for name in names] for names in groups]
        self.monitor, self._lock = monitor, threading.Lock()
        self._seen: dict[str, list[float]] = {stage: [] for stage in stages}

    def task(self, key: tuple[str, tuple[str, ...]], processor_s: Callable[[], float]) -> Monitor:
        """A task begins: its monitor. `processor_s`: gives the seconds that its process has used of the processor."""
        stage, names = key
        with self._lock:
            for name in names:
                row = self.rows[name]
                row.stage, row.since_s, row.begun, row.ended, row.done = stage, time.monotonic(), 0, 0, 0
                row.at_once = sum(self.rows[name].frames for name in names)
                if stage == MEASURED:
                    row.ticks.clear()
        return _TaskMonitor(self, self.rows[names[0]], processor_s)

    def end(self, stage: str, name: str) -> None:
        """A stage of a row is done."""
        with self._lock:
            row = self.rows[name]
            if row.stage == stage:
                spent_s = time.monotonic() - row.since_s
                if stage != MEASURED or row.ended == row.passes:  # with a second look there is no telling
                    self._seen[stage].append(spent_s / row.at_once)
            row.stage = ""
        self.skip(name, stage)

    def skip(self, name: str, *stages: str) -> None:
        """Stages of a row that are not done: an earlier run did, or the row failed."""
        with self._lock:
            self.rows[name].stages = [stage for stage in self.rows[name].stages if stage not in stages]

    def left_s(self, workers: int) -> float | None:
        """Seconds that the run will still take; None while nothing tells. All rows are measured before the last ones
        are solved."""
        with self._lock:
            timed = {row: FrameCost.of([*row.ticks]) for row in self.rows.values() if len(row.ticks) >= LEAST_STEPS}
            if not timed:
                return None
            usual = FrameCost(*np.mean([astuple(cost) for cost in timed.values()], axis=0).tolist())
            costs = {row: timed.get(row, usual) for row in self.rows.values()}
            measured = [self._measured_s(row, cost) for row, cost in costs.items()]
            solved = [self._single_s(rows, SOLVED, costs) for rows in self.groups]
            pictured = [self._single_s([row], PICTURED, costs) for row in costs]
        drawn = sum(cost.drawn_s(row.frames) for row, cost in costs.items())
        return sum(_makespan_s(stage, workers) for stage in (measured, solved, pictured)) + drawn

    def _measured_s(self, row: _Row, cost: FrameCost) -> float:
        """Of measuring a row: the frames that are ahead, and what follows them."""
        if MEASURED not in row.stages:
            return 0.0
        frames_s = max(row.frames - row.done, 0) * cost.frame_s
        if not row.is_walked:
            return frames_s + cost.plan_s(row.passes - row.begun) + self._stage_s(row, MEASURED, cost)
        if row.begun > row.ended:
            return frames_s + self._stage_s(row, MEASURED, cost) / 2
        return self._single_s([row], MEASURED, {row: cost})

    def _single_s(self, rows: Sequence[_Row], stage: str, costs: Mapping[_Row, FrameCost]) -> float:
        """Of a stage of rows that are worked on together, without what is done frame by frame: never nothing until it
        is done."""
        ahead = [row for row in rows if stage in row.stages]
        whole_s = sum(self._stage_s(row, stage, costs[row]) for row in ahead)
        spent_s = max((time.monotonic() - row.since_s for row in ahead if row.stage == stage), default=0.0)
        return max(whole_s - spent_s, whole_s / 10)

    def _stage_s(self, row: _Row, stage: str, cost: FrameCost) -> float:
        """Of a stage, without what is done frame by frame."""
        seen = self._seen[stage]
        return row.frames * sum(seen) / len(seen) if seen else cost.after_s(row.frames, [stage])

    def walk_begins(self, row: _Row) -> None:
        with self._lock:
            row.begun += 1
            if row.begun > row.passes:
                row.done = 0

    def step(self, row: _Row, processor_s: float) -> None:
        """A frame is done. Where it took much longer than those before it, these were kept from an earlier run, and
        tell nothing."""
        with self._lock:
            row.done += 1
            ticks = row.ticks
            if len(ticks) > 1:
                usual_s = (ticks[-1][1] - ticks[0][1]) / (len(ticks) - 1)
                if processor_s - ticks[-1][1] > KEPT * usual_s:
                    ticks.clear()
            ticks.append((time.monotonic(), processor_s))

    def walk_ends(self, row: _Row) -> None:
        """What follows is timed from here."""
        with self._lock:
            row.ended += 1
            row.since_s = time.monotonic()

    @contextmanager
    def reported(self, workers: int) -> Iterator[None]:
        """While this lasts, the monitor is told how long the rest will take."""
        closed = threading.Event()

        def tell() -> None:
            while not closed.wait(TICK_S):
                if (left_s := self.left_s(workers)) is not None:
                    self.monitor.left(left_s)

        thread = threading.Thread(target=tell, name="savmap-clock", daemon=True)
        thread.start()
        try:
            yield
        finally:
            closed.set()
            thread.join()


def _makespan_s(tasks_s: Iterable[float], workers: int) -> float:
    """Of tasks that are given to the worker that is free first, the longest ones first."""
    busy = [0.0] * workers
    for seconds in sorted(tasks_s, reverse=True):
        heapq.heapreplace(busy, busy[0] + seconds)
    return max(busy)


class _TaskMonitor:
    """The monitor of one task, whose frames are counted."""

    def __init__(self, clock: RunClock, row: _Row, processor_s: Callable[[], float]) -> None:
        self.clock, self.row, self.processor_s = clock, row, processor_s

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        self.clock.walk_begins(self.row)
        for item in self.clock.monitor.each(items, doing, total):
            yield item
            self.clock.step(self.row, self.processor_s())
        self.clock.walk_ends(self.row)

    def note(self, line: str) -> None:
        self.clock.monitor.note(line)

    def left(self, seconds: float) -> None:
        self.clock.monitor.left(seconds)
