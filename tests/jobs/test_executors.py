"""Executors: a task that ends its process does not end the others."""

import operator
import os
import time
from collections.abc import Callable, Hashable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from savmap.jobs.executors import Task, WorkerCrashedError, in_processes, in_turn
from savmap.types.progress import Monitor, SilentMonitor

DIES_ONCE = """
__import__("os").path.exists(mark) and "second time" or (open(mark, "w").close(), __import__("os")._exit(1))
""".strip()
ENDS_LATER = """
__import__("threading").Timer(0.3, __import__("os")._exit, [1]).start() or "done"
""".strip()


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_one_that_dies_is_told_and_the_others_are_done(jobs: int) -> None:
    tasks: dict[Hashable, Task] = {number: (operator.mul, (2, number)) for number in range(3)}
    found = dict(in_processes({**tasks, "bad": (os._exit, (1,)), "wrong": (int, ("wrong",))}, jobs))
    assert {key: found[key] for key in range(3)} == {0: 0, 1: 2, 2: 4}
    assert isinstance(found["bad"], WorkerCrashedError)
    assert isinstance(found["wrong"], ValueError)


@pytest.mark.slow
def test_work_that_was_only_near_is_done_again(tmp_path: Path) -> None:
    near = (eval, (DIES_ONCE, {"mark": str(tmp_path / "mark")}))
    assert dict(in_processes({"near": near, "other": (operator.mul, (2, 4))}, 2)) == {"near": "second time", "other": 8}


@pytest.mark.slow
def test_process_that_ends_between_tasks_costs_no_task() -> None:
    found = {}
    for key, result in in_processes({"ends later": (eval, (ENDS_LATER, {})), "next": (operator.mul, (2, 4))}, 1):
        found[key] = result
        time.sleep(1.0)
    assert found == {"ends later": "done", "next": 8}


def walk(frames: int, monitor: Monitor) -> int:
    """A task that tells what it does, some of it within other work."""
    for _ in monitor.each(range(1), "all"):
        for number in monitor.each(range(frames), f"{frames} frames", frames):
            sum(range(200_000))
            monitor.note(f"{number} of {frames}")
    return frames


class Watcher(SilentMonitor):
    """Notes all that it is told."""

    def __init__(self) -> None:
        self.steps: dict[str, int] = {}
        self.lines: list[str] = []
        self.keys: dict[int, list[float]] = {}

    def task(self, key: int, processor_s: Callable[[], float]) -> Monitor:
        self.clock = processor_s
        self.keys[key] = []
        return self

    def each(self, items: Iterable[Any], doing: str, total: int | None = None) -> Iterator[Any]:
        for item in items:
            yield item
            self.steps[doing] = self.steps.get(doing, 0) + 1

    def note(self, line: str) -> None:
        self.lines.append(line)


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [0, 2])
def test_what_tasks_do_is_shown_meanwhile(jobs: int) -> None:
    watcher = Watcher()
    tasks: dict[Hashable, Task] = {frames: (walk, (frames,)) for frames in (3, 5)}
    results = in_processes(tasks, jobs, shown=watcher.task) if jobs else in_turn(tasks, watcher.task)
    assert dict(results) == {3: 3, 5: 5}
    assert watcher.steps == {"all": 2, "3 frames": 3, "5 frames": 5}
    assert sorted(watcher.lines) == sorted(f"{number} of {frames}" for frames in (3, 5) for number in range(frames))
    assert set(watcher.keys) == {3, 5}
    assert watcher.clock() > 0
