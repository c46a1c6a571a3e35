"""Doubts that a person checked and found wrong, and rows that look at one face: both mapped it, under two names."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from savmap.assembly import rows_with_same_face, same_face_doubts, with_confirmed, with_doubts
from savmap.site.model import Row
from savmap.types import Doubt, SiteMap, Verdict
from savmap.types.verdicts import by_cause

from .made_up_site import site

WIDE = Doubt(
    "shape",
    "an upright may be missing",
    ("upright 2", "upright 3"),
    figure="3.69 m apart, others 1.36 m",
    action="look for one between: upright 2 and upright 3",
)
WIDER = replace(
    WIDE,
    structures=("upright 7", "upright 8"),
    figure="4.10 m apart, others 1.36 m",
    action="look for one between: upright 7 and upright 8",
)
CAMERA = Doubt("camera", "the pictures were cropped or stretched", figure="elevations 1.20 ± 0.10 % too large")


def doubted(*doubts: Doubt) -> SiteMap:
    return with_doubts(site(1, np.random.default_rng(1)), {"1L": list(doubts)})


def verdict_with(line: str, *doubts: Doubt) -> tuple[Verdict, tuple[str, ...]]:
    confirmed = with_confirmed(doubted(*doubts), {"1L": (line,), "1R": ()})
    verdict = confirmed.site_map.rows["1L"].verdict
    assert verdict is not None
    return verdict, confirmed.unused


@pytest.mark.parametrize(
    "line",
    [
        WIDE.line,
        f"shape: {WIDE.line}",
        "an upright may be missing: 3.70 m  apart, others 1.35 m; look for one between: upright 2 and upright 3",
    ],
)
def test_a_doubt_in_its_own_words_becomes_a_note(line: str) -> None:
    verdict, unused = verdict_with(line, WIDE)
    assert verdict.grade == "trusted"
    assert verdict.notes == (f"confirmed in the site file: {WIDE.line}",)
    assert not unused


@pytest.mark.parametrize(
    "line",
    [
        "an upright may be missing: 3.69 m apart, others 1.36 m; look for one between: upright 3 and upright 4",
        "an upright may be missing: 5.40 m apart, others 1.36 m; look for one between: upright 2 and upright 3",
        "an upright may be missing",
    ],
)
def test_other_words_or_figures_settle_nothing_and_are_told(line: str) -> None:
    verdict, unused = verdict_with(line, WIDE)
    assert verdict.doubts == (WIDE,)
    assert not verdict.notes
    assert unused == (f"row 1L: `confirmed` has a line that no doubt says now: {line}",)


def test_what_no_look_at_the_pictures_tells_stays() -> None:
    verdict, unused = verdict_with(CAMERA.line, CAMERA, WIDE)
    assert verdict.doubts == (CAMERA, WIDE)
    assert unused == (f"row 1L: `confirmed` cannot settle this, which no look at the pictures tells: {CAMERA.line}",)


def test_one_of_a_cause_is_settled_by_itself() -> None:
    verdict, unused = verdict_with(WIDE.line, WIDE, WIDER)
    assert verdict.doubts == (WIDER,)
    assert not unused


def test_all_of_a_cause_are_settled_by_their_line() -> None:
    (both,) = by_cause((WIDE, WIDER))
    assert both.figure == "2 places, up to 4.10 m apart, others 1.36 m"
    verdict, unused = verdict_with(both.line, WIDE, WIDER)
    assert verdict.grade == "trusted"
    assert not unused


def test_a_line_that_yaml_takes_for_a_key_is_told_to_be_quoted() -> None:
    with pytest.raises(ValidationError, match="quotation marks"):
        Row.model_validate(
            {"passes": [{"video": "/aisle.mp4"}], "confirmed": [{"3.69 m apart, others 1.36 m": "is one"}]}
        )


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
    first = row(end_s=20.0)
    assert not [*rows_with_same_face({"A": first, "B": row(start_s=19.0)})]
    assert [*rows_with_same_face({"A": first, "B": row(start_s=9.0, end_s=20.0)})]


def test_a_second_pass_counts_too() -> None:
    both = Row.model_validate({"passes": [{"video": "/back.mp4"}, {"video": "/aisle.mp4", "side": "left"}]})
    ((first, second, what),) = rows_with_same_face({"A": both, "B": row()})
    assert (first, second) == ("A", "B")
    assert "(A, pass 2)" in what
