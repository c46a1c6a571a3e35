"""Where brightness falls along a line: in one step, or in two, as beside a lamp whose housing is seen."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from savmap.plugin import Floats
from savmap_lights.picture.profiles import DROP, STEP_PX, ends_of, is_stepped

PLACES = np.arange(0.0, 60.0, STEP_PX)


def profile(*steps: tuple[float, float], blur: float = 0.8) -> Floats:
    """Brightness that is 252 up to the first place and then, from each place on, another."""
    values = np.full(len(PLACES), 252.0)
    for place, value in steps:
        values[place <= PLACES] = value
    return gaussian_filter1d(values, blur / STEP_PX, mode="nearest")


def first_dark(values: Floats) -> int:
    return int(np.argmax(values < 252.0 - DROP))


@pytest.mark.parametrize("blur", [0.5, 1.0, 1.5])
def test_an_end_in_one_step_is_measured(blur: float) -> None:
    values = profile((30.0, 63.0), blur=blur)
    both = np.concatenate([values[::-1], values])
    lit = (np.array([len(values) - first_dark(values)]), np.array([len(values) + first_dark(values) - 1]))
    ends, sharp = ends_of(both, STEP_PX * (np.arange(len(both)) - len(values)), *lit)
    assert sharp.all()
    assert ends == pytest.approx(np.array([[-30.0], [30.0]]), abs=0.6)


def test_what_is_lit_to_the_pictures_border_does_not_end_there() -> None:
    values = profile((30.0, 63.0))
    ends, sharp = ends_of(values, PLACES, np.array([0]), np.array([first_dark(values) - 1]))
    assert ends[0, 0] == 0.0
    assert sharp.tolist() == [[False], [True]]


@pytest.mark.parametrize("width", [4.0, 6.0])
@pytest.mark.parametrize("grey", [140.0, 170.0])
def test_an_end_with_its_housing_beside_it_is_not(width: float, grey: float) -> None:
    values = profile((30.0, grey), (30.0 + width, 63.0))
    assert is_stepped(values, first_dark(values))


@pytest.mark.parametrize("grey", [66.0, 248.0])
def test_a_faint_second_step_is_none(grey: float) -> None:
    values = profile((30.0, grey), (34.0, 63.0))
    assert not is_stepped(values, first_dark(values))
