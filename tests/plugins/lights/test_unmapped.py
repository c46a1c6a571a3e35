"""Light that no mapped lamp explains: seen as often as lamps, and where their spacing asks for one."""

import numpy as np
import pytest

from savmap_lights.space.places import Lamp, Place
from savmap_lights.space.unmapped import Light, lights_beside, spacing_of


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
