"""Executors: a task that ends its process does not end the others."""

import operator
import os
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from savmap.jobs.executors import ProcessExecutor, SerialExecutor, WorkerCrashedError
from savmap.types.progress import Monitor, SilentMonitor

DIES_ONCE = """
__import__("os").path.exists(mark) and "second time" or (open(mark, "w").close(), __import__("os")._exit(1))
""".strip()
ENDS_LATER = """
__import__("threading").Timer(0.3, __import__("os")._exit, [1]).start() or "done"
""".strip()


def test_serial_executor_goes_on_from_results_first() -> None:
    executor = SerialExecutor()
    executor.submit("a", operator.mul, 2, 1)
    found = []
    for key, result in executor.results():
        found.append((key, result))
        if key == "a":
            executor.submit("b", operator.mul, 2, 21)
    assert found == [("a", 2), ("b", 42)]


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_one_that_dies_is_told_and_the_others_are_done(jobs: int) -> None:
    executor = ProcessExecutor(jobs)
    for number in range(3):
        executor.submit(number, operator.mul, 2, number)
    executor.submit("bad", os._exit, 1)
    executor.submit("wrong", int, "wrong")
    found = {}
    for key, result in executor.results():
        found[key] = result
        if key == 0:
            executor.submit("late", operator.mul, 2, 50)
    assert {key: found[key] for key in (0, 1, 2, "late")} == {0: 0, 1: 2, 2: 4, "late": 100}
    assert isinstance(found["bad"], WorkerCrashedError)
    assert isinstance(found["wrong"], ValueError)


@pytest.mark.slow
def test_work_that_was_only_near_is_done_again(tmp_path: Path) -> None:
    executor = ProcessExecutor(2)
    executor.submit("near", eval, DIES_ONCE, {"mark": str(tmp_path / "mark")})
    executor.submit("other", operator.mul, 2, 4)
    assert dict(executor.results()) == {"near": "second time", "other": 8}


@pytest.mark.slow
def test_process_that_ends_between_tasks_costs_no_task() -> None:
    executor = ProcessExecutor(1)
    executor.submit("ends later", eval, ENDS_LATER, {})
    executor.submit("next", operator.mul, 2, 4)
    found = {}
    for key, result in executor.results():
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
    executor = ProcessExecutor(jobs, shown=watcher.task) if jobs else SerialExecutor(watcher.task)
    for frames in (3, 5):
        executor.submit(frames, walk, frames)
    assert dict(executor.results()) == {3: 3, 5: 5}
    assert watcher.steps == {"all": 2, "3 frames": 3, "5 frames": 5}
    assert sorted(watcher.lines) == sorted(f"{number} of {frames}" for frames in (3, 5) for number in range(frames))
    assert set(watcher.keys) == {3, 5}
    assert watcher.clock() > 0
