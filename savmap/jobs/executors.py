"""Who runs a job's tasks: this process, other processes, or the workers of a Dask cluster. Where a process ends, its
task is tried again.

Processes are those of `concurrent.futures`, a pool of one for each worker: where one ends, the others go on.
"""

import multiprocessing
import os
import re
import signal
import threading
import time
import warnings
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any, Protocol, TypeVar

from savmap.errors import SavmapError
from savmap.jobs.cache_keys import code
from savmap.plugin.calls import limit_hooks
from savmap.site.job import Job, plugins_for
from savmap.types.progress import Monitor, SilentMonitor

Item = TypeVar("Item")
Task = tuple[Callable[..., Any], tuple[Any, ...]]
Shown = Callable[[Any, Callable[[], float]], Monitor]
"""The monitor of a task that begins, by its key, and by what gives the processor's seconds that the task's process has
used."""
ADDRESS = re.compile(r"\w+://\S+:\d+")
CONNECT_S = 15
SAFE_PATH = "PYTHONSAFEPATH"


class WorkerCrashedError(Exception):
    """The process that did a task ended without a result."""


class TaskExecutor(Protocol):
    """Takes tasks, and gives their results in the order in which they are done. `shown`: gives each task a last
    argument, the monitor that shows what it does to the user while it does it; None where that is not possible, and the
    argument is left out."""

    shown: Shown | None

    def submit(self, key: Hashable, function: Callable[..., Any], *arguments: Any) -> None:
        """Take a task."""
        ...

    def results(self) -> Iterator[tuple[Any, Any]]:
        """Key and result of each task, also of those submitted meanwhile; a result is an exception where the task ended
        with one."""
        ...


class SerialExecutor:
    """Runs tasks in this process, one after another, when their results are asked for. A task that is submitted
    meanwhile comes next: it goes on from the last one's result, which then need not be kept for long."""

    def __init__(self, shown: Shown | None = None) -> None:
        self.shown = shown
        self.waiting: list[tuple[Hashable, Task]] = []
        self.next: list[tuple[Hashable, Task]] = []

    def submit(self, key: Hashable, function: Callable[..., Any], *arguments: Any) -> None:
        self.next.append((key, (function, arguments)))

    def results(self) -> Iterator[tuple[Any, Any]]:
        while self.next or self.waiting:
            self.waiting[:0], self.next = self.next, []
            key, (function, arguments) = self.waiting.pop(0)
            monitors = () if self.shown is None else (self.shown(key, time.process_time),)
            yield key, function(*arguments, *monitors)


class ProcessExecutor:
    """Runs tasks in other processes, so many at a time.

    If a process ends without a result, its task is tried again when no other is under way. One that ends its process
    again has `WorkerCrashedError` for a result; so has one that ends the only process at once. A process in which a
    hook of a plugin takes longer than `timeout_s` ends. What tasks tell their monitor goes to that which `shown` gives,
    from a thread for each process.
    """

    def __init__(self, processes: int, timeout_s: float = float("inf"), shown: Shown | None = None) -> None:
        self.processes, self.timeout_s, self.shown = processes, timeout_s, shown
        self.waiting: dict[Hashable, Task] = {}

    def submit(self, key: Hashable, function: Callable[..., Any], *arguments: Any) -> None:
        self.waiting[key] = (function, arguments)

    def results(self) -> Iterator[tuple[Any, Any]]:
        before = set(multiprocessing.active_children())
        idle = [_Worker(self.timeout_s, self.shown) for _ in range(self.processes)]
        busy: dict[Future[Any], tuple[Hashable, Task, _Worker]] = {}
        again: dict[Hashable, Task] = {}
        try:
            while self.waiting or again or busy:
                retried = not self.waiting and not busy
                ready = again if retried else self.waiting
                while ready and idle and not (retried and busy):
                    key, task = next(iter(ready.items()))
                    worker = idle.pop()
                    busy[worker.submit(key, ready.pop(key))] = key, task, worker
                for future in wait(busy, return_when=FIRST_COMPLETED).done:
                    key, task, worker = busy.pop(future)
                    idle.append(worker)
                    error = future.exception()
                    if not isinstance(error, BrokenProcessPool):
                        yield key, error or future.result()
                    elif retried or self.processes == 1:
                        yield key, WorkerCrashedError()
                    else:
                        again[key] = task
        except BaseException:
            for child in set(multiprocessing.active_children()) - before:
                child.terminate()
            raise
        finally:
            for worker in (*idle, *(worker for _, _, worker in busy.values())):
                worker.close()


class _Worker:
    """A process that does one task at a time, and a thread that shows what it tells its monitor; another process where
    one ended."""

    def __init__(self, timeout_s: float, shown: Shown | None) -> None:
        self.timeout_s, self.shown = timeout_s, shown
        self._open()

    def _open(self) -> None:
        context = multiprocessing.get_context("spawn")
        received, self._sent = context.Pipe(duplex=False)
        with working_folder_off_path():
            self._pool = ProcessPoolExecutor(1, context, _begin, (self._sent, self.timeout_s))
        self._shower = threading.Thread(target=_show, args=(received, self.shown), name="savmap-progress", daemon=True)
        self._shower.start()

    def submit(self, key: Hashable, task: Task) -> "Future[Any]":
        """Have a task done."""
        function, arguments = task
        with working_folder_off_path():
            try:
                return self._pool.submit(_call, key, self.shown is not None, function, *arguments)
            except BrokenProcessPool:
                self.close()
                self._open()
                return self._pool.submit(_call, key, self.shown is not None, function, *arguments)

    def close(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._sent.close()
        self._shower.join()


class ForwardedMonitor:
    """A Monitor for a task in another process: what it is told is shown by the monitor of the process that waits for
    it."""

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        _send("each", doing, total)
        try:
            for item in items:
                yield item
                _send("step", time.process_time())
        finally:
            _send("end")

    def note(self, line: str) -> None:
        _send("note", line)

    def left(self, seconds: float) -> None:
        """Nothing: the other process knows better."""


_events: "Connection | None" = None
"""In a worker's process: the way to the monitor."""
_sending = threading.Lock()


def _begin(events: Connection, timeout_s: float) -> None:
    """Begin a worker's process: it ends with the one that it works for, and leaves ctrl-C to that."""
    global _events
    _events = events
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    limit_hooks(timeout_s)
    end_with_parent()


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


def _send(*event: object) -> None:
    """Send an event to the monitor. A monitor that has ended is no reason to fail."""
    with _sending, suppress(OSError):
        if _events is not None:
            _events.send(event)


def _call(key: Hashable, shown: bool, function: Callable[..., Any], *arguments: Any) -> Any:
    if not shown:
        return function(*arguments)
    _send("task", key)
    return function(*arguments, ForwardedMonitor())


def _show(received: Connection, shown: Shown | None) -> None:
    """Show what the `ForwardedMonitor`s of a process send, until it ends."""
    monitor: Monitor = SilentMonitor()
    processor_s = 0.0

    def events() -> Iterator[tuple[Any, ...]]:
        with received, suppress(EOFError, OSError):
            while True:
                yield received.recv()

    def steps() -> Iterator[None]:
        """An item for each step of what is under way, until it ends; what else is told meanwhile is shown."""
        nonlocal processor_s
        for event, *what in stream:
            if event == "end":
                return
            if event == "step":
                (processor_s,) = what
                yield
            else:
                show(event, what)

    def show(event: str, what: list[Any]) -> None:
        nonlocal monitor
        if event == "task" and shown is not None:
            monitor = shown(what[0], lambda: processor_s)
        elif event == "note":
            monitor.note(what[0])
        elif event == "each":
            for _ in monitor.each(steps(), *what):
                pass

    stream = events()
    for event, *what in stream:
        show(event, what)


class DaskExecutor:
    """A Dask scheduler's workers (extra `cluster`), which do what processes of this machine would do, and give the same
    bytes where processors and BLAS kernels are equal. Work whose worker dies is given to another one, up to the
    scheduler's `allowed-failures`.

    Only this process writes files. Workers read the footage, so it must be where they can read it: a shared folder, or
    a URL.
    """

    shown: Shown | None = None

    def __init__(self, address: str, job: Job) -> None:
        """Raises SavmapError where the extra is missing, the scheduler does not answer, or a worker runs other code."""
        distributed = _library()
        if not ADDRESS.fullmatch(address):
            raise SavmapError(f"--cluster {address}: give the scheduler's address as tcp://host:8786")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self.client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise SavmapError(
                f"--cluster {address}: no Dask scheduler answers there ({error or 'time ran out'})"
            ) from None
        self.address = address
        self.done = distributed.as_completed(loop=self.client.loop)
        self.keys: dict[str, Hashable] = {}
        self._require_same_code(job)

    @property
    def count(self) -> int:
        """Workers at the moment."""
        return len(self.client.scheduler_info(n_workers=-1)["workers"])

    def submit(self, key: Hashable, function: Callable[..., Any], *arguments: Any) -> None:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Sending large graph")
            future = self.client.submit(function, *arguments, pure=False)
        self.keys[future.key] = key
        self.done.add(future)

    def results(self) -> Iterator[tuple[Any, Any]]:
        killed = _library().scheduler.KilledWorker
        try:
            for future in self.done:
                error = future.exception()
                if isinstance(error, killed):
                    error = WorkerCrashedError("time and again")
                yield self.keys.pop(future.key), error or future.result()
        finally:
            with suppress(Exception):
                self.client.close()

    def _require_same_code(self, job: Job) -> None:
        """The same bytes come only from the same code. Raises SavmapError naming a worker that has another one."""
        expected = code_of(job)
        for worker, fingerprint in self.client.run(code_of, job, on_error="return").items():
            if fingerprint != expected:
                differs = "its savmap, plugins or libraries differ"
                why = fingerprint if isinstance(fingerprint, BaseException) else differs
                self.client.close()
                raise SavmapError(f"--cluster {self.address}: worker {worker} would give another map: {why}")


def code_of(job: Job) -> str:
    """Fingerprint of the code that would map a job here."""
    return code(plugins_for(job, next(iter(job.site.rows))))


def _library() -> Any:
    try:
        import distributed
    except ImportError:
        raise SavmapError("--cluster needs Dask: pip install 'savmap[cluster]'") from None
    return distributed
