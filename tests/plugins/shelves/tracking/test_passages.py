"""What is seen through a passage keeps no height on the face."""

import numpy as np
import pytest
from savmap_shelves.tracking.levels import seen_through

SECTION = np.array([0, 0, 0, 1, 1, 2, 2])


@pytest.mark.parametrize(
    ("scatter", "through"),
    [
        ([0.7, 0.5], True),
        ([0.7, 0.1], False),  # one level of the bay is where it should be
        ([0.3, 0.35], False),  # little, however much more than the others'
    ],
)
def test_a_section_of_which_no_level_keeps_its_height_is_a_passage(scatter: list[float], through: bool) -> None:
    least = np.array([0.05, 0.06, 0.05, *scatter, 0.05, 0.07])
    edges = np.column_stack([least, least + 1.0])  # a single edge of a beam may be read badly
    assert seen_through(SECTION, edges).tolist() == [False] * 3 + [through] * 2 + [False] * 2


def test_a_single_beam_over_a_passage_stays() -> None:
    scatter = np.array([0.05, 0.06, 0.8, 0.05])
    assert not seen_through(np.array([0, 0, 1, 2]), np.column_stack([scatter, scatter])).any()


def test_a_row_that_is_read_badly_has_no_passages() -> None:
    scatter = np.full((7, 2), 0.8)
    assert not seen_through(SECTION, scatter).any()
