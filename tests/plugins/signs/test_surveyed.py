"""Signs of a survey: corners in the order in which one reads them."""

from itertools import permutations

import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.types import Floats, Structure
from savmap_signs.evaluation import survey_entry

FLAT = np.array([[1.0, 1.9, 0.01], [1.3, 1.88, 0.01], [1.295, 1.73, 0.01], [0.995, 1.75, 0.01]])
ACROSS = np.array([[5.0, 4.0, 1.5], [5.0, 4.0, 0.5], [5.0, 3.5, 0.5], [5.0, 3.5, 1.5]])


def sign(points: Floats) -> Structure:
    count = len(points)
    attributes = {"text": "A21-03"}
    return Structure(
        "s", "sign", points, np.zeros((count, 3, 3)), ("",) * count, np.zeros((0, 2), np.int64), attributes
    )


def corners_of(points: Floats) -> Floats:
    (own,) = survey_entry([sign(points)]).values["signs"]
    assert own["text"] == "A21-03"
    return np.array(own["corners"])


def test_a_sign_of_the_face_is_put_in_order() -> None:
    for order in permutations(range(4)):
        assert corners_of(FLAT[list(order)]) == pytest.approx(FLAT)


def test_a_plate_is_read_where_its_front_is() -> None:
    back = np.concatenate([FLAT - [0, 0, 0.002], FLAT])
    assert corners_of(back) == pytest.approx(FLAT)
    thin = np.array([0.002, 0.0, 0.0])
    for ring in (ACROSS, ACROSS[::-1]):
        assert corners_of(np.concatenate([ring, ring - thin])) == pytest.approx(ACROSS)
        assert corners_of(np.concatenate([ring, ring + thin])) == pytest.approx(ACROSS[[1, 0, 3, 2]])


def test_a_sign_across_the_aisle_stays_as_it_was_given() -> None:
    assert corners_of(ACROSS[[2, 3, 0, 1]]) == pytest.approx(ACROSS[[2, 3, 0, 1]])


def test_another_number_of_corners_is_refused() -> None:
    with pytest.raises(OutputError, match="s: a sign has four corners, or eight as a plate: there are 5"):
        corners_of(np.concatenate([FLAT, FLAT[:1]]))
