"""A unit is told where a value is right in it, and hardly any wrong value would be so by chance."""

import pytest

from savmap.graph.solver.judgement.contradictions import unit_of


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
    assert unit_of(value, given_sigma, otherwise, sigma) == unit
