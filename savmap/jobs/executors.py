"""Who runs a job's tasks: this process, other processes, or the workers of a Dask cluster. Where a process ends, its
task is tried again.

`concurrent.futures` and loky give up all that a pool does where one of its processes ends; here the others go on.
"""

import multiprocessing
import os
import re
import signal
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from savmap.errors import SavmapError
from savmap.jobs.cache_keys import code
from savmap.plugin.calls import limit_hooks
from savmap.site.job import Job, plugins_for
from savmap.types.progress import Monitor, SilentMonitor

Item = TypeVar("Item")
Task = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function and its arguments."""
Shown = Callable[[Any, Callable[[], float]], Monitor]
"""The monitor of a task that begins, by its key, and by what gives the processor's seconds that the task's process has
used. It is the task's last argument."""
ADDRESS = re.compile(r"\w+://\S+:\d+")
CONNECT_S = 15
SAFE_PATH = "PYTHONSAFEPATH"


class WorkerCrashedError(Exception):
    """The process that did a task ended without a result."""


def in_turn(tasks: Mapping[Hashable, Task], shown: Shown | None = None) -> Iterator[tuple[Any, Any]]:
    """Key and result of each task, done in this process."""
    for key, (function, arguments) in tasks.items():
        yield key, function(*arguments, *([] if shown is None else [shown(key, time.process_time)]))


def in_processes(
    tasks: Mapping[Hashable, Task], processes: int, timeout_s: float = float("inf"), shown: Shown | None = None
) -> Iterator[tuple[Any, Any]]:
    """Key and result of each task as soon as it is done, in so many other processes; a result is an exception where the
    task ended with one.

    If a process ends without a result, its task is tried again when no other is under way. One that ends its process
    again has `WorkerCrashedError` for a result; so has one that ends the only process at once. A process in which a
    hook of a plugin takes longer than `timeout_s` ends.
    """
    waiting, again = dict(tasks), dict[Hashable, Task]()
    busy: dict[Future[Any], tuple[Hashable, Task, _Worker]] = {}
    workers = [_Worker(timeout_s, shown) for _ in range(processes)]
    idle = [*workers]
    with ThreadPoolExecutor(processes, "savmap-worker") as threads:
        try:
            while waiting or again or busy:
                retried = not waiting and not busy
                ready = again if retried else waiting
                while ready and idle and not (retried and busy):
                    key, worker = next(iter(ready)), idle.pop()
                    task = ready.pop(key)
                    worker.begin()
                    busy[threads.submit(worker.result, key, task)] = key, task, worker
                for future in wait(busy, return_when=FIRST_COMPLETED).done:
                    key, task, worker = busy.pop(future)
                    idle.append(worker)
                    error = future.exception()
                    if isinstance(error, WorkerCrashedError) and not (retried or processes == 1):
                        again[key] = task
                    else:
                        yield key, error or future.result()
        finally:
            for worker in workers:
                worker.end()


class _Worker:
    """A process that does one task at a time; another one where it ended."""

    def __init__(self, timeout_s: float, shown: Shown | None) -> None:
        self.timeout_s, self.shown = timeout_s, shown
        self.process: multiprocessing.process.BaseProcess | None = None

    def begin(self) -> None:
        """Begin the process, if there is none."""
        if self.process is None or not self.process.is_alive():
            context = multiprocessing.get_context("spawn")
            self.line, line = context.Pipe()
            self.process = context.Process(target=_work, args=(line, self.timeout_s, self.shown is not None))
            with working_folder_off_path():
                self.process.start()
            line.close()

    def result(self, key: Hashable, task: Task) -> Any:
        """What a task gives; meanwhile what it tells its monitor is shown. Raises the task's error, and
        WorkerCrashedError where the process ends."""
        processor_s = 0.0
        monitor = SilentMonitor() if self.shown is None else self.shown(key, lambda: processor_s)
        results: list[Any] = []

        def steps() -> Iterator[None]:
            """An item for each step of what is under way, until it ends."""
            nonlocal processor_s
            while not results:
                match self.line.recv():
                    case ("step", processor_s):
                        yield
                    case ("note", line):
                        monitor.note(line)
                    case ("each", doing, total):
                        for _ in monitor.each(steps(), doing, total):
                            pass
                    case ("end",):
                        return
                    case ("result", result):
                        results.append(result)

        try:
            self.line.send(task)
            while not results:
                for _ in steps():
                    pass
        except (EOFError, OSError):
            self.end()  # so that another one is begun
            raise WorkerCrashedError from None
        if isinstance(results[0], Exception):
            raise results[0]
        return results[0]

    def end(self) -> None:
        """End the process, whatever it does."""
        if self.process is not None:
            self.process.terminate()
            self.process.join()


def _work(line: Connection, timeout_s: float, shown: bool) -> None:
    """Do tasks in a worker's process, which ends with the one that it works for, and leaves ctrl-C to that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    limit_hooks(timeout_s)
    end_with_parent()
    with suppress(EOFError):
        while True:
            function, arguments = line.recv()
            try:
                result = function(*arguments, *([ForwardedMonitor(line)] if shown else []))
            except Exception as error:
                error.add_note(traceback.format_exc())
                result = error
            line.send(("result", result))


class ForwardedMonitor:
    """A Monitor for a task in another process: what it is told is shown by the monitor of the process that waits for
    it."""

    def __init__(self, line: Connection) -> None:
        self.line, self.lock = line, threading.Lock()

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        self._send("each", doing, total)
        try:
            for item in items:
                yield item
                self._send("step", time.process_time())
        finally:
            self._send("end")

    def note(self, line: str) -> None:
        self._send("note", line)

    def left(self, seconds: float) -> None:
        """Nothing: the other process knows better."""

    def _send(self, *event: object) -> None:
        """Send an event; a process that has ended is no reason to fail."""
        with self.lock, suppress(OSError):
            self.line.send(event)


@contextmanager
def working_folder_off_path() -> Iterator[None]:
    """Python processes that are started meanwhile run no module of the working folder, as the `copy.py` of a user."""
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = before


def end_with_parent() -> None:
    """Have this process end with the one that it works for, as soon as Python's lock is free."""
    threading.Thread(target=end_if_left, args=(None,), daemon=True).start()


def end_if_left(wait_s: float | None = 0.0) -> None:
    """End this process if the one that it works for ends within a time (None: whenever it does)."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join(wait_s)
        if not parent.is_alive():
            os._exit(1)


class Cluster:
    """A Dask scheduler's workers (extra `cluster`), which do what processes of this machine would do, and give the same
    bytes where processors and BLAS kernels are equal. Work whose worker dies is given to another one, up to the
    scheduler's `allowed-failures`.

    Only this process writes files. Workers read the footage, so it must be where they can read it: a shared folder, or
    a URL.
    """

    def __init__(self, address: str, job: Job) -> None:
        """Raises SavmapError where the extra is missing, the scheduler does not answer, or a worker runs other code."""
        try:
            import distributed
        except ImportError:
            raise SavmapError("--cluster needs Dask: pip install 'savmap[cluster]'") from None
        if not ADDRESS.fullmatch(address):
            raise SavmapError(f"--cluster {address}: give the scheduler's address as tcp://host:8786")
        self.distributed = distributed
        try:
            with warnings.catch_warnings(action="ignore"):
                self.client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise SavmapError(
                f"--cluster {address}: no Dask scheduler answers there ({error or 'time ran out'})"
            ) from None
        self.workers = len(self.client.scheduler_info(n_workers=-1)["workers"])
        for worker, fingerprint in self.client.run(code_of, job, on_error="return").items():
            if fingerprint != code_of(job):  # the same bytes come only from the same code
                differs = "its savmap, plugins or libraries differ"
                why = fingerprint if isinstance(fingerprint, BaseException) else differs
                self.client.close()
                raise SavmapError(f"--cluster {address}: worker {worker} would give another map: {why}")

    def results(self, tasks: Mapping[Hashable, Task]) -> Iterator[tuple[Any, Any]]:
        """Key and result of each task as soon as it is done; a result is an exception where the task ended with one."""
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Sending large graph")
            futures = {
                self.client.submit(function, *arguments, pure=False): key
                for key, (function, arguments) in tasks.items()
            }
        try:
            for future in self.distributed.as_completed(futures, loop=self.client.loop):
                error = future.exception()
                if isinstance(error, self.distributed.scheduler.KilledWorker):
                    error = WorkerCrashedError("time and again")
                yield futures[future], error or future.result()
        finally:
            with suppress(Exception):
                self.client.close()


def code_of(job: Job) -> str:
    """Fingerprint of the code that would map a job here."""
    return code(plugins_for(job, next(iter(job.site.rows))))
