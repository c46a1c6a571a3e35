"""Strips that something crosses at their own height are one, and neighbours are not."""

import numpy as np
import pytest

from savmap_lights.space.crossed import joined
from savmap_lights.space.places import Lamp, Place

LENGTH, PITCH = 1.56, 2.41
NONE = np.zeros(0, np.int64)


def strip(start: float, stop: float, unseen: str | None = None) -> Lamp:
    """A strip along the line; the end that is `unseen` was only seen to."""
    lamp = {"end 0": Place(start, (-1, 0), NONE), "end 1": Place(stop, (1, 0), NONE)}
    if unseen == "end 0":
        return {"end 1": Place(stop, (1, 0), NONE, seen_to=start)}
    return {"end 0": Place(start, (-1, 0), NONE, seen_to=stop)} if unseen == "end 1" else lamp


def whole(count: int = 4, start: float = 0.0) -> list[Lamp]:
    return [strip(start + k * PITCH, start + k * PITCH + LENGTH) for k in range(count)]


def extents(lamps: list[Lamp]) -> list[tuple[float, ...]]:
    return [tuple(round(place.x, 3) for place in lamp.values()) for lamp in lamps]


@pytest.mark.parametrize("unseen", [None, "end 0"])
def test_parts_that_are_together_as_long_as_the_others_are_one_strip(unseen: str | None) -> None:
    start = 4 * PITCH
    parts = [strip(start, start + 0.74), strip(start + 0.98, start + LENGTH, unseen)]
    lamps = joined([*whole(), *parts])
    assert extents(lamps) == extents(whole(5))
    assert all(place.seen_to is None for lamp in lamps for place in lamp.values())


def test_parts_are_one_strip_though_lengths_scatter() -> None:
    lengths = [0.728, 0.723, 0.694, 0.692, 0.736]
    lamps = [strip(2.0 * k, 2.0 * k + length) for k, length in enumerate(lengths)]
    parts = [strip(10.0, 10.328), strip(10.398, 10.694)]
    assert extents(joined([*lamps, *parts])) == extents([*lamps, strip(10.0, 10.694)])


def test_three_parts_are_one_strip() -> None:
    start = 4 * PITCH
    parts = [strip(start, start + 0.4), strip(start + 0.5, start + 1.0), strip(start + 1.1, start + LENGTH)]
    assert extents(joined([*whole(), *parts])) == extents(whole(5))


@pytest.mark.parametrize(
    "parts",
    [
        pytest.param([(0.0, 0.5), (0.6, 1.2)], id="together shorter"),
        pytest.param([(0.0, 0.4), (0.4 + 0.45, LENGTH)], id="as far apart as lamps may be"),
    ],
)
def test_what_does_not_make_up_a_strip_stays_as_it_is(parts: list[tuple[float, float]]) -> None:
    start = 4 * PITCH
    lamps = [*whole(), *(strip(start + low, start + high) for low, high in parts)]
    assert joined(lamps) == lamps


def test_lines_of_two_lengths_with_joints_stay_as_they_are() -> None:
    joint, long, short = 0.04, 1.5, 0.73
    starts = np.cumsum([0.0, *[long + joint] * 3, short + joint]).tolist()
    lamps = [strip(x, x + size) for x, size in zip(starts, [long, long, long, short, short], strict=True)]
    assert joined(lamps) == lamps


def test_two_whole_strips_are_too_few_to_tell() -> None:
    lamps = [*whole(2), strip(2 * PITCH, 2 * PITCH + 0.7), strip(2 * PITCH + 0.8, 2 * PITCH + LENGTH)]
    assert joined(lamps) == lamps
