"""Items made ahead of their turn by a thread."""

import threading
import time
from collections.abc import Iterator

import pytest

from savmap.video.prefetch import prefetch


def makers() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "savmap-prefetch_0"]


def test_items_come_in_order_from_one_other_thread() -> None:
    threads = set()

    def numbers() -> Iterator[int]:
        for number in range(50):
            threads.add(threading.get_ident())
            yield number

    with prefetch(numbers(), 2) as items:
        assert list(items) == list(range(50))
    assert len(threads) == 1
    assert threading.get_ident() not in threads
    assert not makers()


@pytest.mark.parametrize("depth", [1, 3])
def test_no_more_are_made_than_places_are_free(depth: int) -> None:
    made = []

    def numbers() -> Iterator[int]:
        for number in range(20):
            made.append(number)
            yield number

    def come_to_rest(count: int) -> None:
        while len(made) < count:
            time.sleep(0.01)
        time.sleep(0.05)
        assert len(made) == count

    with prefetch(numbers(), depth) as items:
        come_to_rest(depth)
        assert next(items) == 0
        come_to_rest(depth + 1)


def test_an_error_comes_where_the_item_would_have_come() -> None:
    def numbers() -> Iterator[int]:
        yield 1
        yield 2
        raise OSError("the disk is gone")

    seen = []
    with pytest.raises(OSError, match="the disk is gone"), prefetch(numbers(), 5) as items:
        seen.extend(iter(lambda: next(items), None))
    assert seen == [1, 2]
    assert not makers()


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_whoever_stops_early_leaves_no_thread_and_no_open_file(error: type[BaseException]) -> None:
    closed = []

    def numbers() -> Iterator[int]:
        try:
            yield from range(1000)
        finally:
            closed.append(True)

    with pytest.raises(error), prefetch(numbers(), 2) as items:
        raise error(next(items))
    assert closed == [True]
    assert not makers()
