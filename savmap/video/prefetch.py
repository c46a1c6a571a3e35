"""Items made ahead of their turn by a thread: in order, only so many at a time, with their errors."""

from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from threading import Semaphore, Thread
from typing import Generic, TypeVar

Item = TypeVar("Item")


@contextmanager
def prefetch(items: Iterable[Item], depth: int) -> Generator[Iterator[Item], None, None]:
    """The same items, made by a thread while others are in use: `depth` at most that nobody has taken yet.

    What making them raises is raised where the item would have come. When the block is left the thread has ended and,
    where `items` is a generator, that is closed.
    """
    line = _Line(items, depth)
    line.thread.start()
    try:
        yield line.taken()
    finally:
        line.stop()


class _Line(Generic[Item]):
    """One thread's items on their way. A place is free for each item that may be made."""

    def __init__(self, items: Iterable[Item], depth: int) -> None:
        self.items = items
        self.made: SimpleQueue[tuple[Item] | BaseException | None] = SimpleQueue()
        self.places = Semaphore(depth)
        self.stopped = False
        self.thread = Thread(target=self._make, name="savmap-ahead", daemon=True)

    def taken(self) -> Iterator[Item]:
        """The items; each is let go before the next is waited for."""
        while (made := self.made.get()) is not None:
            if isinstance(made, BaseException):
                raise made
            self.places.release()
            yield made[0]
            del made

    def stop(self) -> None:
        self.stopped = True
        self.places.release()
        self.thread.join()

    def _make(self) -> None:
        end: BaseException | None = None
        try:
            self._make_all()
        except BaseException as error:
            end = error
        finally:
            self.made.put(end)

    def _make_all(self) -> None:
        iterator = iter(self.items)
        try:
            while self._may_go_on():
                try:
                    item = next(iterator)
                except StopIteration:
                    return
                self.made.put((item,))
                del item
        finally:
            if isinstance(iterator, Generator):
                iterator.close()

    def _may_go_on(self) -> bool:
        self.places.acquire()
        return not self.stopped
