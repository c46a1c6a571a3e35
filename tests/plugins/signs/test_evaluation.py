"""Mapped signs scored against a survey."""

import pytest

from savmap_signs.evaluation import draw, evaluate

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
    assert score.apart["signs"].distances_m == pytest.approx([0.01, 0.0])
    assert (score.apart["signs"].missing, score.apart["signs"].spurious) == (1, 1)
    assert evaluate(mapped, {}).apart == {}


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
