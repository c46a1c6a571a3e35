"""Who does the work: this process, or processes beside it, of which one may die without taking the others' work with it."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, Protocol

from savmap.types.progress import Monitor

Piece = tuple[Callable[..., Any], tuple[Any, ...]]
WATCH_S = 1.0


class WorkerCrashedError(Exception):
    """The process that did a piece of work ended without a word."""


class Workers(Protocol):
    """Takes pieces of work, and gives their results in the order in which they are done. `monitor`: what the work may talk to, where
    it is done in this very process."""

    monitor: Monitor | None

    def submit(self, key: Hashable, work: Callable[..., Any], *arguments: Any) -> None:
        """Take a piece of work."""
        ...

    def results(self) -> Iterator[tuple[Any, Any]]:
        """Key and result of each piece, also of those submitted meanwhile; a result is an exception where the work ended
        with one."""
        ...


class Here:
    """This process does it, one piece after another, when its result is asked for."""

    def __init__(self, monitor: Monitor) -> None:
        self.monitor: Monitor | None = monitor
        self.waiting: list[tuple[Hashable, Piece]] = []

    def submit(self, key: Hashable, work: Callable[..., Any], *arguments: Any) -> None:
        self.waiting.append((key, (work, arguments)))

    def results(self) -> Iterator[tuple[Any, Any]]:
        while self.waiting:
            key, (work, arguments) = self.waiting.pop(0)
            yield key, work(*arguments)


class Beside:
    """Processes beside this one, so many at a time. Where one dies, all that were at work are suspected and tried again, each alone;
    the one that dies alone has `DiedError` for a result."""

    monitor: Monitor | None = None

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        self.waiting: dict[Hashable, Piece] = {}
        self.suspects: dict[Hashable, Piece] = {}

    def submit(self, key: Hashable, work: Callable[..., Any], *arguments: Any) -> None:
        self.waiting[key] = (work, arguments)

    def results(self) -> Iterator[tuple[Any, Any]]:
        while self.waiting or self.suspects:
            yield from self._shift(self.waiting, self.jobs)
            while self.suspects:
                key = next(iter(self.suspects))
                alone = {key: self.suspects.pop(key)}
                yield from self._shift(alone, 1)

    def _shift(self, waiting: dict[Hashable, Piece], jobs: int) -> Iterator[tuple[Any, Any]]:
        """Work through what is waiting until it is done or a process dies; at most `jobs` pieces are under way."""
        with _pool(jobs) as pool:
            under_way: dict[Future[Any], tuple[Hashable, Piece]] = {}
            while waiting or under_way:
                while waiting and len(under_way) < jobs:
                    key = next(iter(waiting))
                    work, arguments = waiting.pop(key)
                    under_way[pool.submit(work, *arguments)] = (key, (work, arguments))
                for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                    key, piece = under_way.pop(future)
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool) and jobs == 1:
                        yield (
                            key,
                            WorkerCrashedError("its process ended without a word: out of memory, killed, or crashed"),
                        )
                        return
                    if isinstance(error, BrokenProcessPool):
                        self.suspects |= {key: piece, **dict(under_way.values())}
                        return
                    yield key, error or future.result()


@contextmanager
def _pool(jobs: int) -> Iterator[Executor]:
    """Processes that end with this one, however it ends, and leave ctrl-C to it."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, context, _begin, (os.getpid(),))
    before = set(multiprocessing.active_children())
    try:
        yield pool
    except BaseException:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _begin(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
