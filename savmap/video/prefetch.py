"""Items made ahead by a thread: in order, a limited number at a time, with their errors."""

from collections import deque
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from typing import TypeVar

Item = TypeVar("Item")


@contextmanager
def prefetch(items: Iterable[Item], depth: int) -> Generator[Iterator[Item], None, None]:
    """The same items, made by a thread while others are in use; at most `depth` of them wait to be taken.

    An error in making an item is raised in its place. When the block is left, the thread has ended and `items`, if it
    is a generator, is closed.
    """
    iterator = iter(items)
    with ThreadPoolExecutor(1, "savmap-prefetch") as pool:
        waiting = deque[Future[list[Item]]]()

        def make() -> None:
            waiting.append(pool.submit(list, islice(iterator, 1)))

        def taken() -> Iterator[Item]:
            """The items; each is released before the next is waited for."""
            while made := waiting.popleft().result():
                make()
                yield made.pop()

        try:
            for _ in range(depth):
                make()
            yield taken()
        finally:
            pool.shutdown(cancel_futures=True)
            if isinstance(iterator, Generator):
                iterator.close()
