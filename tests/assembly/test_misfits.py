"""Warnings that a person checked and found wrong, and rows that look at one face: both mapped it, under two names."""

import numpy as np
import pytest
from pydantic import ValidationError

from savmap.assembly import rows_with_same_face, same_face_warnings, with_confirmed, with_warnings
from savmap.site.model import Confirmed, Row
from savmap.types import MapWarning, Verdict

from .made_up_site import site

BEAM, POST = (
    MapWarning("uncertain-element", (name,), f"P {size}", size=size)
    for name, size in (("bay 1 / beam 2", 0.4), ("upright 2", 0.2))
)
CAMERA = MapWarning("stretched-pictures", figure="elevations 1.20 ± 0.10 % too large")


def verdict_with(subjects: tuple[str, ...], *warnings: MapWarning) -> tuple[Verdict, tuple[str, ...]]:
    site_map = with_warnings(site(1, np.random.default_rng(1)), {"1L": list(warnings)})
    confirmed = [Confirmed(code="uncertain-element", subjects=subjects, reason="seen on site")]
    settled = with_confirmed(site_map, {"1L": confirmed, "1R": ()})
    verdict = settled.site_map.rows["1L"].verdict
    assert verdict is not None
    return verdict, settled.unused


def test_what_is_confirmed_becomes_a_note() -> None:
    verdict, unused = verdict_with(("upright 2",), POST)
    assert verdict.grade == "trusted"
    assert verdict.notes == ("confirmed in the site file: uncertain-element, upright 2",)
    assert not unused


def test_one_of_a_code_is_settled_by_itself() -> None:
    assert verdict_with(("upright 2",), POST, BEAM, CAMERA) == (
        Verdict((BEAM, CAMERA), ("confirmed in the site file: uncertain-element, upright 2",)),
        (),
    )
    assert not verdict_with(("upright 2", "bay 1 / beam 2"), POST, BEAM)[0].warnings


def test_a_subject_that_nothing_warns_of_is_told() -> None:
    verdict, unused = verdict_with(("upright 7",), POST, BEAM)
    assert [warning.subjects for warning in verdict.warnings] == [("bay 1 / beam 2", "upright 2")]
    assert not verdict.notes
    assert unused == ("row 1L: `confirmed` has what nothing warns of now: uncertain-element, upright 7",)


@pytest.mark.parametrize(
    "entry",
    ["a beam is missing", {"code": "lens-seam", "subjects": ["a"]}, {"code": "uncertain-element", "subjects": []}],
)
def test_what_a_person_cannot_settle_is_refused(entry: object) -> None:
    with pytest.raises(ValidationError):
        Row.model_validate({"passes": [{"video": "/aisle.mp4"}], "confirmed": [entry]})


def row(**about: object) -> Row:
    return Row.model_validate({"passes": [{"video": "/aisle.mp4", "side": "left", **about}]})


@pytest.mark.parametrize("about", [{}, {"start_s": 0.2}, {"end_s": 20.0}, {"start_s": 5.0, "end_s": 9.0}, {"fps": 5.0}])
def test_a_copied_row_is_of_the_same_face(about: dict[str, object]) -> None:
    warnings = same_face_warnings({"A": row(), "B": row(**about)})
    assert {*warnings} == {"A", "B"}
    (warning,) = warnings["A"]
    assert (warning.code, warning.subjects) == ("site-misfit", ("row B",))
    assert warning.details[0].startswith("rows A and B look at the same frames (A, pass 1), both to the left")


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
    first = row(end_s=20.0)
    assert not [*rows_with_same_face({"A": first, "B": row(start_s=19.0)})]
    assert [*rows_with_same_face({"A": first, "B": row(start_s=9.0, end_s=20.0)})]


def test_a_second_pass_counts_too() -> None:
    both = Row.model_validate({"passes": [{"video": "/back.mp4"}, {"video": "/aisle.mp4", "side": "left"}]})
    ((first, second, what),) = rows_with_same_face({"A": both, "B": row()})
    assert (first, second) == ("A", "B")
    assert "(A, pass 2)" in what
