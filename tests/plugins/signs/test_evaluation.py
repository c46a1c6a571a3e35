"""Mapped signs scored against a survey, and the signs of a survey."""

from itertools import permutations

import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.types import Floats
from savmap_signs.evaluation import draw, evaluate, survey_entry

from .aisle_pass import PLATES, TRUTH, structure


def test_scores_count_missing_and_spurious_texts() -> None:
    survey = {
        "signs": [{"corners": sign.tolist(), "text": plate.text} for sign, plate in zip(TRUTH, PLATES, strict=True)]
    }
    mapped = [
        structure("sign 1", TRUTH[0] + [0.01, 0, 0], text="A21-01"),
        structure("sign 2", TRUTH[1], text="A21-07"),
        structure("sign 3", TRUTH[1] + [9, 0, 0], text=""),
    ]
    score = evaluate(mapped, survey)
    assert score.missing == {"sign text": 2}
    assert score.spurious == {"sign text": 1}
    assert score.distances["signs"].distances_m == pytest.approx([0.01, 0.0])
    assert (score.distances["signs"].missing, score.distances["signs"].spurious) == (1, 1)
    assert evaluate(mapped, {}).distances == {}


def test_drawings_mark_signs_off_the_survey() -> None:
    signs = [structure("sign 1", TRUTH[0], text="A21-01"), structure("sign 2", TRUTH[1])]
    survey = {"signs": [{"corners": TRUTH[0].tolist()}]}
    drawings = draw(signs, survey, {"sign 1": 0.01, "sign 2": 0.04})
    assert [(drawing.role, drawing.caption) for drawing in drawings] == [
        ("survey", ""),
        ("mapped", "A21-01"),
        ("off", ""),
    ]
    assert len(draw(signs, None, {})) == 2


FLAT = np.array([[1.0, 1.9, 0.01], [1.3, 1.88, 0.01], [1.295, 1.73, 0.01], [0.995, 1.75, 0.01]])
ACROSS = np.array([[5.0, 4.0, 1.5], [5.0, 4.0, 0.5], [5.0, 3.5, 0.5], [5.0, 3.5, 1.5]])


def corners_of(points: Floats) -> Floats:
    (own,) = survey_entry([structure("sign 1", points, text="A21-03")]).values["signs"]
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
    with pytest.raises(OutputError, match="sign 1: a sign has four corners, or eight as a plate: there are 5"):
        corners_of(np.concatenate([FLAT, FLAT[:1]]))
