"""Light that no mapped lamp explains: seen as often as lamps, and where their spacing asks for one."""

import numpy as np
import pytest

from savmap_lights.space.places import Lamp, Place
from savmap_lights.space.unmapped import Light, lights_beside, missing_lamps, spacing_of


def compact(*x: float) -> list[Lamp]:
    return [{"centre": Place(at, (0, 0), np.zeros(0, np.int64))} for at in x]


@pytest.mark.parametrize(
    ("light", "beside"),
    [
        (Light(6.1, 10), {1: 6.1}),  # where the gap asks for a lamp
        (Light(6.1, 4), {}),  # seen less often than those on either side
        (Light(4.5, 10), {}),  # between two places of the spacing
        (Light(15.0, 10), {3: 15.0}),
        (Light(-3.1, 10), {0: -3.1}),
    ],
)
def test_light_counts_where_the_spacing_asks_for_a_lamp(light: Light, beside: dict[int, float]) -> None:
    assert lights_beside(compact(0.0, 3.0, 9.0, 12.0), [10, 12, 12, 10], [light]) == beside


def test_any_light_beside_lamps_without_a_spacing_counts() -> None:
    assert lights_beside(compact(1.0), [6], [Light(4.4, 5)]) == {0: 4.4}
    assert lights_beside(compact(0.0, 2.0, 7.1, 8.5), [6, 6, 6, 6], [Light(4.4, 5), Light(5.5, 3)]) == {1: 4.4}


@pytest.mark.parametrize(
    ("x", "spacing"),
    [
        ((0.0, 3.0, 9.0, 12.0, 18.01), 3.0),
        ((0.0, 3.0, 3.0, 4.1, 9.0, 12.0), 3.0),
        ((0.0, 3.0, 4.1, 9.0, 10.7), None),
        ((0.0, 3.0, 6.0), None),
        ((), None),
    ],
)
def test_spacing_is_what_three_in_four_lamps_have(x: tuple[float, ...], spacing: float | None) -> None:
    found = spacing_of(np.array(x))
    assert (found and found[1]) == (spacing and pytest.approx(spacing, abs=0.02))


def reaches(*middles: float, length: float = 1.0) -> np.ndarray:
    return np.array([[x - length / 2, x + length / 2] for x in middles]).reshape(-1, 2)


@pytest.mark.parametrize(
    ("middles", "missing"),
    [
        ((0.0, 3.0, 6.0, 9.0), []),
        ((0.0, 3.0, 9.0, 12.0, 15.0), [6.0]),
        ((0.0, 3.02, 8.97, 12.0, 14.99, 18.0), [6.0]),
        ((0.0, 3.0, 6.0, 15.0, 18.0, 21.0), [9.0, 12.0]),
    ],
)
def test_a_gap_in_a_regular_line_is_a_lamp_that_is_missing(middles: tuple[float, ...], missing: list[float]) -> None:
    first, *between, last = missing_lamps(reaches(*middles))
    assert between == pytest.approx(missing, abs=0.1)
    assert (first, last) == pytest.approx((middles[0] - 3.5, middles[-1] + 3.5), abs=0.1)


@pytest.mark.parametrize("middles", [(), (0.0,), (0.0, 3.0), (0.0, 2.0, 7.0, 8.5, 13.0)])
def test_lamps_without_a_common_spacing_say_nothing(middles: tuple[float, ...]) -> None:
    assert missing_lamps(reaches(*middles)) == []
