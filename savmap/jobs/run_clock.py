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

from savmap.pipeline.drive import frames_of
from savmap.site.model import Site
from savmap.types.progress import Monitor

MEASURED, SOLVED, PICTURED = "measured", "solved", "pictured"
PLAN_FRAMES = 28
"""Choosing a pass's views takes as long as measuring so many frames: it looks at a fixed number of key frames."""
SHARES = {MEASURED: 0.2, SOLVED: 0.12, PICTURED: 0.045}
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


@dataclass(frozen=True)
class Walk:
    """What a group's rows are measured in: frames, and views to be chosen, one lot for each pass of each row."""

    frames: int
    plans: int

    @classmethod
    def of(cls, site: Site, group: Sequence[str]) -> "Walk":
        """Of rows of a site that are seen in the same frames."""
        passes = [row_pass for name in group for row_pass in site.rows[name].passes]
        return cls(frames_of(passes), len(passes))


@dataclass(eq=False)
class _Group:
    """How far rows are that are mapped together: whether they are done, how many frames were walked, and since when the
    walk is over."""

    walk: Walk
    done: bool = False
    walked: int = 0
    over_s: float | None = None
    ticks: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=STEPS))


class RunClock:
    """How far the groups of rows of a run are. Tells the monitor every second how long the rest will take, once a
    group's frames tell how long they take."""

    def __init__(self, walks: Mapping[tuple[str, ...], Walk], monitor: Monitor, pictures: bool) -> None:
        self.groups = {group: _Group(walk) for group, walk in walks.items()}
        self.monitor, self._lock = monitor, threading.Lock()
        self.stages = [MEASURED, SOLVED, *([PICTURED] if pictures else [])]
        self._after_s: list[float] = []
        """Seconds a frame that what follows the walk took, of groups that are done."""

    def task(self, group: tuple[str, ...], processor_s: Callable[[], float]) -> Monitor:
        """A task begins with a group: its monitor. `processor_s`: gives the seconds that its process has used of the
        processor."""
        with self._lock:
            begun = _Group(self.groups[group].walk)
            self.groups[group] = begun
        return _TaskMonitor(self, begun, processor_s)

    def end(self, group: tuple[str, ...]) -> None:
        """A group is done."""
        with self._lock:
            ended = self.groups[group]
            if ended.over_s is not None and not ended.done:
                self._after_s.append((time.monotonic() - ended.over_s) / ended.walk.frames)
            ended.done = True

    def left_s(self, workers: int) -> float | None:
        """Seconds that the run will still take; None while nothing tells."""
        with self._lock:
            timed = {
                id(group): FrameCost.of([*group.ticks])
                for group in self.groups.values()
                if len(group.ticks) >= LEAST_STEPS
            }
            if not timed:
                return None
            usual = FrameCost(*np.mean([astuple(cost) for cost in timed.values()], axis=0).tolist())
            costs = [(group, timed.get(id(group), usual)) for group in self.groups.values()]
            left = [self._left_s(group, cost) for group, cost in costs if not group.done]
        busy = [0.0] * workers
        for seconds in sorted(left, reverse=True):  # to the worker that is free first
            heapq.heapreplace(busy, busy[0] + seconds)
        return max(busy) + sum(cost.drawn_s(group.walk.frames) for group, cost in costs)

    def _left_s(self, group: _Group, cost: FrameCost) -> float:
        """Of a group that is not done: never nothing."""
        frames = group.walk.frames
        seen = self._after_s
        after_s = frames * float(np.mean(seen)) if seen else cost.after_s(frames, self.stages)
        if group.over_s is not None:
            return max(after_s - (time.monotonic() - group.over_s), after_s / 10)
        plan_s = 0.0 if group.walked else cost.plan_s(group.walk.plans)
        return plan_s + max(frames - group.walked, 0) * cost.frame_s + after_s

    def step(self, group: _Group, processor_s: float) -> None:
        """A frame is done. Where it took much longer than those before it, these were kept from an earlier run, and
        tell nothing."""
        with self._lock:
            group.walked += 1
            ticks = group.ticks
            if len(ticks) > 1:
                usual_s = (ticks[-1][1] - ticks[0][1]) / (len(ticks) - 1)
                if processor_s - ticks[-1][1] > KEPT * usual_s:
                    ticks.clear()
            ticks.append((time.monotonic(), processor_s))
            group.over_s = None

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


class _TaskMonitor:
    """The monitor of one task, whose frames are counted."""

    def __init__(self, clock: RunClock, group: _Group, processor_s: Callable[[], float]) -> None:
        self.clock, self.group, self.processor_s = clock, group, processor_s

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        for item in self.clock.monitor.each(items, doing, total):
            yield item
            self.clock.step(self.group, self.processor_s())
        self.group.over_s = time.monotonic()  # what follows is timed from here

    def note(self, line: str) -> None:
        self.clock.monitor.note(line)

    def left(self, seconds: float) -> None:
        self.clock.monitor.left(seconds)
