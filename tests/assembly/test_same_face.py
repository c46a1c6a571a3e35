"""Rows that look at one face: both mapped it, under two names, and nothing spoke against either."""

from pathlib import Path

import pytest

from savmap.assembly import rows_with_same_face, same_face_doubts
from savmap.site.model import Row


def row(**about: object) -> Row:
    return Row.model_validate({"passes": [{"video": "/aisle.mp4", "side": "left", **about}]})


@pytest.mark.parametrize("about", [{}, {"start_s": 0.2}, {"end_s": 20.0}, {"start_s": 5.0, "end_s": 9.0}, {"fps": 5.0}])
def test_a_copied_row_is_of_the_same_face(about: dict[str, object]) -> None:
    doubts = same_face_doubts({"A": row(), "B": row(**about)})
    assert {*doubts} == {"A", "B"}
    (doubt,) = doubts["A"]
    assert doubt.line == "two rows look at the same face; correct the `side` of one: row A or B"
    assert doubt.details[0].startswith("rows A and B look at the same frames (A, pass 1), both to the left")


@pytest.mark.parametrize(
    "about",
    [
        {"side": "right"},
        {"video": "/other.mp4"},
        {"views": {"top": {"yaw_deg": 90.0, "pitch_deg": 40.0}}},
    ],
)
def test_another_face_is_not(about: dict[str, object]) -> None:
    assert not [*rows_with_same_face({"A": row(), "B": row(**about)})]


def test_passes_one_after_the_other_are_not() -> None:
    assert not [*rows_with_same_face({"A": row(end_s=20.0), "B": row(start_s=19.0)})]
    assert [*rows_with_same_face({"A": row(end_s=20.0), "B": row(start_s=9.0, end_s=20.0)})]


def test_a_second_pass_counts_too() -> None:
    both = Row.model_validate({"passes": [{"video": str(Path("/back.mp4"))}, {"video": "/aisle.mp4", "side": "left"}]})
    ((first, second, what),) = rows_with_same_face({"A": both, "B": row()})
    assert (first, second) == ("A", "B")
    assert "(A, pass 2)" in what
