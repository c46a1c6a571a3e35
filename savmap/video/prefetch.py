"""Items made ahead by a thread: in order, a limited number at a time, with their errors."""

from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from threading import Semaphore, Thread
from typing import Generic, TypeVar

Item = TypeVar("Item")


@contextmanager
def prefetch(items: Iterable[Item], depth: int) -> Generator[Iterator[Item], None, None]:
    """The same items, made by a thread while others are in use; at most `depth` of them wait to be taken.

    An error in making an item is raised in its place. When the block is left, the thread has ended and `items`, if it
    is a generator, is closed.
    """
    queue = _Queue(items, depth)
    queue.thread.start()
    try:
        yield queue.taken()
    finally:
        queue.stop()


class _Queue(Generic[Item]):
    """The items of one thread. A place is free for each item that may be made."""

    def __init__(self, items: Iterable[Item], depth: int) -> None:
        self.items = items
        self.made: SimpleQueue[tuple[Item] | BaseException | None] = SimpleQueue()
        self.places = Semaphore(depth)
        self.stopped = False
        self.thread = Thread(target=self._make, name="savmap-prefetch", daemon=True)

    def taken(self) -> Iterator[Item]:
        """The items; each is released before the next is waited for."""
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
