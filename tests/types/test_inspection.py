"""Grades by probability, and the order of findings."""

import numpy as np
import pytest

from savmap.plugin.inspection import Limit
from savmap.types import CloseUp, Finding, FindingTable, Inspection, Measured, RowInspection, graded


@pytest.mark.parametrize(
    ("value", "sigma", "grade"),
    [
        (3.0, 1.0, "green"),
        (4.0, 1.0, "unknown"),
        (5.1, 1.0, "amber"),
        (7.0, 1.0, "amber"),
        (9.5, 1.0, "amber"),
        (12.0, 1.0, "red"),
        (7.0, 4.0, "amber"),
        (0.0, 4.0, "unknown"),
        (5.0, 0.0, "green"),
        (10.1, 0.0, "red"),
    ],
)
def test_grades_follow_from_probabilities(value: float, sigma: float, grade: str) -> None:
    assert graded(Measured(value, sigma), 5.0, 10.0)[0] == grade
    assert graded(Measured(-value, sigma), -5.0, -10.0)[0] == grade, "where small values are bad"


def test_the_limit_is_the_one_that_the_grade_is_about() -> None:
    assert graded(Measured(12.0, 1.0), 5.0, 10.0)[1:] == (10.0, pytest.approx(0.97725, abs=1e-5))
    assert graded(Measured(5.0, 1.0), 5.0, 10.0)[1:] == (5.0, pytest.approx(0.5))
    with pytest.raises(ValueError, match="must differ"):
        graded(Measured(1.0, 1.0), 5.0, 5.0)


def test_a_limit_grades_a_finding_and_keeps_its_action_for_what_is_wrong() -> None:
    limit = Limit(amber=5.0, red=10.0, source="EN")
    empty = Finding("lean", "post leans", unit="mm/m", action="measure it")
    assert limit.finding(empty, Measured(-12.0, 0.5)).grade == "red"
    assert limit.finding(empty, Measured(-12.0, 0.5)).value == -12.0
    assert limit.finding(empty, Measured(1.0, 0.5)).action == ""
    with pytest.raises(ValueError, match="amber and red must differ"):
        Limit(amber=1.0, red=1.0)


def test_findings_are_told_from_the_worst_on() -> None:
    red, amber, unknown = (Finding("a", "b", grade, probability=0.5) for grade in ("red", "amber", "unknown"))  # type: ignore[arg-type]
    worse = Finding("a", "b", "amber", probability=0.9)
    inspection = Inspection(
        {"A": {"posts": RowInspection((unknown, amber))}, "B": {"posts": RowInspection((red, worse))}}
    )
    assert [finding for _, _, finding in inspection.findings()] == [red, worse, amber, unknown]
    assert inspection.counts() == {"red": 1, "amber": 2, "unknown": 1, "green": 0}


def test_records_refuse_what_they_cannot_be() -> None:
    for fields, fault in (
        ({"grade": "blue"}, "grade"),
        ({"value": float("nan")}, "finite"),
        ({"probability": 1.2}, "probability"),
        ({"action": "a\nb"}, "one line"),
    ):
        with pytest.raises(ValueError, match=fault):
            Finding(**{"code": "a", "title": "b", **fields})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="a cell a column"):
        FindingTable("t", "T", ("a", "b"), ((1,),))
    with pytest.raises(ValueError, match="corners"):
        CloseUp("post 1", "post 1", np.zeros((3, 3)))
