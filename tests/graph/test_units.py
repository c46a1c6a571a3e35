"""A unit is told where a value is right in it, and hardly any wrong value would be so by chance."""

from types import SimpleNamespace
from typing import Any

import pytest

from savmap.errors import SolveError
from savmap.graph.solver.judgement import reference_tests
from savmap.graph.solver.judgement.contradictions import in_unit
from savmap.graph.solver.judgement.reference_tests import ReferenceTest, refuse_contradiction
from savmap.types import ReferenceUse


@pytest.mark.parametrize(
    ("value", "given_sigma", "otherwise", "sigma", "unit"),
    [
        (46.463, 0.003, 14.16, 0.02, "feet"),
        (557.6, 0.1, 14.16, 0.02, "inches"),
        (1416.2, 0.3, 14.16, 0.02, "centimetres"),
        (30.0, 0.2, 0.302, 0.005, "centimetres"),
        (299.0, 2.0, 0.302, 0.005, "millimetres"),
        (0.147, 0.002, 0.048, 0.006, ""),  # of five other heights in metres; anything between 0 and 6 cm would do
        (0.984, 0.002, 0.30, 0.02, ""),
        (46.463, 0.003, 13.9, 0.02, ""),
        (15.452, 0.003, 14.916, 0.115, ""),
        (0.0, 0.002, 0.0, 0.006, ""),
    ],
)
def test_a_unit_is_told_where_it_is_the_likeliest_cause(
    value: float, given_sigma: float, otherwise: float, sigma: float, unit: str
) -> None:
    use = ReferenceUse("length", value, given_sigma, otherwise)
    agreed: Any = SimpleNamespace(given=lambda name: use, rest=lambda name, out: (otherwise, sigma))
    told = in_unit(agreed, "length", frozenset())
    assert f" {unit} are " in told if unit else told == ""


def test_a_reference_that_is_alone_is_asked_for_its_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is presumed of the floor was called the rest, which said 4.784 m of a camera at 3.05 m."""
    monkeypatch.setattr(reference_tests, "contradiction", lambda problem, what: SolveError(what))
    problem: Any = SimpleNamespace(presumed={"floor": "feet may be hidden"}, relations=())
    height = ReferenceTest(ReferenceUse("camera height", 10.0, 0.02, 9.99), 4.784, 9.0, True)
    floor = ReferenceTest(ReferenceUse("floor", 0.0, 0.06, 0.0), 0.0, 0.0, False)
    with pytest.raises(SolveError, match=r"is given as 10\.000 m \+- 0.020 m, .*: is it in metres\?$"):
        refuse_contradiction(problem, [height, floor])
    with pytest.raises(SolveError, match=r"but the rest says 4\.784 m$"):
        refuse_contradiction(problem, [height, floor, height])
