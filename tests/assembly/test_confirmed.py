"""Doubts that a person looked at and found wrong."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_site import site
from pydantic import ValidationError

from savmap.assembly import with_confirmed, with_doubts
from savmap.site.model import Row
from savmap.types import Doubt, SiteMap, Verdict
from savmap.types.verdicts import by_cause

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
