"""Who runs a job's tasks: this process, or other processes, of which one may end without taking the others' tasks with
it."""

import ctypes
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from typing import Any, Protocol, TypeVar

from savmap.plugin import activity
from savmap.types.progress import Monitor, SilentMonitor

Item = TypeVar("Item")
Task = tuple[Callable[..., Any], tuple[Any, ...]]
Shown = Callable[[Any, Callable[[], float]], Monitor]
"""The monitor of a task that begins, by its key, and by what gives the processor's seconds that the task's process has
used."""
POLL_S = 0.25
PARENT_POLL_S = 1.0
ENDED = "its process ended without a word: out of memory, killed, or crashed"


class WorkerCrashedError(Exception):
    """The process that did a task ended without a result, or was ended because a hook took too long. `plugin`, `hook`:
    what was at work in it, if a hook was."""

    def __init__(self, what: str, plugin: str = "", hook: str = "") -> None:
        super().__init__(what)
        self.plugin, self.hook = plugin, hook


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

    If a process ends without a result, all tasks under way are tried again, each alone; one that ends its process then
    has `WorkerCrashedError` for a result. So has one in which a plugin's hook takes longer than `timeout_s`. What tasks
    tell their monitor goes to that which `shown` gives, from a thread for each process.
    """

    def __init__(self, processes: int, timeout_s: float = float("inf"), shown: Shown | None = None) -> None:
        self.processes, self.timeout_s, self.shown = processes, timeout_s, shown
        self.waiting: dict[Hashable, Task] = {}
        self.suspects: dict[Hashable, Task] = {}

    def submit(self, key: Hashable, function: Callable[..., Any], *arguments: Any) -> None:
        self.waiting[key] = (function, arguments)

    def results(self) -> Iterator[tuple[Any, Any]]:
        while self.waiting or self.suspects:
            yield from self._run(self.waiting, self.processes)
            while self.suspects:
                key = next(iter(self.suspects))
                alone = {key: self.suspects.pop(key)}
                while alone:
                    yield from self._run(alone, 1)

    def _run(self, waiting: dict[Hashable, Task], processes: int) -> Iterator[tuple[Any, Any]]:
        """Run what is waiting until it is done or a process ends (then some may still wait); at most `processes` tasks
        are under way."""
        with _pool(processes, self.timeout_s, self.shown) as (pool, board):
            under_way: dict[Future[Any], tuple[Hashable, Task]] = {}
            while waiting or under_way:
                while waiting and len(under_way) < processes:
                    key, (function, arguments) = next(iter(waiting.items()))
                    try:
                        future = pool.submit(_call, key, self.shown is not None, function, *arguments)
                    except BrokenProcessPool:  # a process ended after its last result was taken, or before it is
                        break
                    under_way[future] = (key, waiting.pop(key))
                if not under_way:
                    return
                for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                    key, task = under_way.pop(future)
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool):
                        yield from self._after_crash(board, {key: task, **dict(under_way.values())}, processes)
                        return
                    yield key, error or future.result()

    def _after_crash(
        self, board: "_Board", under_way: dict[Hashable, Task], processes: int
    ) -> Iterator[tuple[Any, Any]]:
        """Errors of the tasks that are known to have ended their process; the others are suspects."""
        for key, task in under_way.items():
            error = board.timeouts.get(str(key)) or (board.crash() if processes == 1 else None)
            if error is None:
                self.suspects[key] = task
            else:
                yield key, error


class ForwardedMonitor:
    """A Monitor for a task in another process: what it is told is shown by the monitor of the process that waits for
    it."""

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        _worker.send("each", doing, total)
        try:
            for item in items:
                yield item
                _worker.slot.processor_s = time.process_time()
                _worker.send("step")
        finally:
            _worker.send("end")

    def note(self, line: str) -> None:
        _worker.send("note", line)

    def left(self, seconds: float) -> None:
        """Nothing: the other process knows better."""


class _Slot(ctypes.Structure):
    """What one process is at: its task, the hook that is at work in it since a time of the monotonic clock, and the
    processor's seconds that it had used at the last step."""

    _fields_ = (
        ("pid", ctypes.c_long),
        ("task", ctypes.c_char * 256),
        ("plugin", ctypes.c_char * 128),
        ("hook", ctypes.c_char * 64),
        ("begin_s", ctypes.c_double),
        ("processor_s", ctypes.c_double),
    )


class _Board:
    """The slots of a pool's processes, in memory that they share with this one, and a thread that ends processes in
    which a hook takes too long."""

    def __init__(self, context: Any, processes: int, timeout_s: float) -> None:
        self.slots = context.Array(_Slot, processes, lock=False)
        self.claimed = context.Value("i", 0)
        self.timeout_s = timeout_s
        self.timeouts: dict[str, WorkerCrashedError] = {}
        self.closed = threading.Event()
        self.thread = threading.Thread(target=self._watch, name="savmap-timeouts", daemon=True)

    def crash(self) -> WorkerCrashedError:
        """The error of a pool's only process that has ended."""
        plugin, hook = self.slots[0].plugin.decode(), self.slots[0].hook.decode()
        return WorkerCrashedError(f"ended the process in `{hook}`" if plugin else ENDED, plugin, hook)

    def _watch(self) -> None:
        while not self.closed.wait(POLL_S):
            for slot in self.slots:
                plugin, hook, begin_s = slot.plugin.decode(), slot.hook.decode(), slot.begin_s
                if plugin and time.monotonic() - begin_s > self.timeout_s:
                    what = f"did not return from `{hook}` within {self.timeout_s:g} s (plugin_timeout_s)"
                    self.timeouts[slot.task.decode()] = WorkerCrashedError(what, plugin, hook)
                    with suppress(ProcessLookupError):
                        os.kill(slot.pid, signal.SIGKILL)


class _Worker:
    """This process, where it is one of a pool's: its slot, and the way to the monitor."""

    slot: Any
    events: Any
    sending = threading.Lock()

    def begin(self, board: Any, claimed: Any, events: Any) -> None:
        with claimed.get_lock():
            number = claimed.value % len(board)
            claimed.value += 1
        self.slot, self.events = board[number], events[number]
        self.slot.pid = os.getpid()
        activity.set_sink(self.tell)

    def send(self, *event: object) -> None:
        """Send an event to the monitor. A monitor that is gone is no reason to fail."""
        with self.sending, suppress(OSError):
            self.events.send(event)

    def tell(self, plugin: str, hook: str) -> None:
        """Note the hook that is at work. The plugin is written last, and taken away first: it says that the rest is
        valid."""
        self.slot.plugin = b""
        if plugin:
            self.slot.hook, self.slot.begin_s = hook.encode()[:63], time.monotonic()
            self.slot.plugin = plugin.encode()[:127]


_worker = _Worker()


def _call(key: Hashable, shown: bool, function: Callable[..., Any], *arguments: Any) -> Any:
    _worker.slot.task = str(key).encode()[:255]
    if not shown:
        return function(*arguments)
    _worker.send("task", key)
    return function(*arguments, ForwardedMonitor())


@contextmanager
def _pool(processes: int, timeout_s: float, shown: Shown | None) -> Iterator[tuple[Executor, _Board]]:
    """Processes that end with this one, however it ends, and leave ctrl-C to it."""
    context = multiprocessing.get_context("spawn")
    board, pipes = _Board(context, processes, timeout_s), [context.Pipe(duplex=False) for _ in range(processes)]
    initial = (os.getpid(), board.slots, board.claimed, [sent for _, sent in pipes])
    pool = ProcessPoolExecutor(processes, context, _begin, initial)
    before = set(multiprocessing.active_children())
    board.thread.start()
    showers = [
        threading.Thread(target=_show, args=(received, shown, slot), name="savmap-progress", daemon=True)
        for (received, _), slot in zip(pipes, board.slots, strict=True)
    ]
    for shower in showers:
        shower.start()
    try:
        yield pool, board
    except BaseException:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()
        raise
    finally:
        board.closed.set()
        pool.shutdown(wait=True, cancel_futures=True)
        for _, sent in pipes:
            sent.close()
        for shower, (received, _) in zip(showers, pipes, strict=True):
            shower.join()
            received.close()


def _show(events: Any, shown: Shown | None, slot: Any) -> None:
    """Show what the `ForwardedMonitor`s of a process send, until the last process that could send is gone."""
    monitor: Monitor = SilentMonitor()
    while (event := _next(events)) is not None:
        if event[0] == "task" and shown is not None:
            monitor = shown(event[1], lambda: float(slot.processor_s))
        else:
            _tell(monitor, event, events)


def _tell(monitor: Monitor, event: tuple[Any, ...], events: Any) -> None:
    if event[0] == "note":
        monitor.note(event[1])
    elif event[0] == "each":
        for _ in monitor.each(_steps(events, monitor), event[1], event[2]):
            pass


def _steps(events: Any, monitor: Monitor) -> Iterator[None]:
    """An item for each step of what is under way, until it ends; what else is told meanwhile is shown."""
    while (event := _next(events)) is not None and event[0] != "end":
        if event[0] == "step":
            yield
        else:
            _tell(monitor, event, events)


def _next(events: Any) -> tuple[Any, ...] | None:
    try:
        event: tuple[Any, ...] = events.recv()
    except (EOFError, OSError):
        return None
    return event


def _begin(parent: int, board: Any, claimed: Any, events: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _worker.begin(board, claimed, events)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_POLL_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
