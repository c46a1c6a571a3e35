"""Which references contradict the rest: the algebra alone."""

import numpy as np
import pytest

from savmap.graph.solver.judgement.agreement import Agreement, Solved

SOFT = 0.1
NAMES = ("a", "b", "c", "d")


def agreement(
    values: list[float], sigma: float = 0.002, pictures: float = 0.003, assumed_m: float = np.inf
) -> Agreement:
    """References whose true values are 1, 2, 3, 4 up to a common shift, which the pictures leave open, but for an assumption that the
    first is 1 +- `assumed_m`."""
    true, count = np.arange(1.0, len(values) + 1), len(values)
    apart = np.diff(np.eye(count), axis=0)
    information = apart.T @ apart / (2 * pictures**2)
    information[0, 0] += assumed_m**-2.0
    covariance = np.linalg.inv(information + np.eye(count) / SOFT**2)
    given = np.array(values)
    found = covariance @ (information @ true + given / SOFT**2)
    solved = Solved(found, np.full(count, SOFT), covariance, np.full((count, 1), count**-0.5))
    return Agreement.of(NAMES[:count], given, np.full(count, sigma), solved)


def test_what_agrees_is_explained_by_nothing() -> None:
    assert agreement([1.0, 2.0, 3.0, 4.0]).explanations() == [frozenset()]
    assert agreement([1.7, 2.7, 3.7, 4.7]).explanations() == [frozenset()]


def test_what_is_assumed_of_the_place_refutes_nothing() -> None:
    assert agreement([1.7], assumed_m=0.01).explanations() == [frozenset()]
    moved = agreement([1.7, 2.7, 3.7, 4.7], assumed_m=0.01)
    assert moved.explanations() == [frozenset()]
    assert moved.rest("a")[0] == pytest.approx(1.7, abs=0.02)
    assert agreement([1.7]).rest("a")[1] > 10.0


def test_a_reference_given_twice_with_two_values() -> None:
    """Both are of one thing, which no more than one of them fits."""
    solved = Solved(np.full(3, 1.0), np.full(3, SOFT), np.full((3, 3), 1e-6) + np.diag([0, 0, 1e-6]), np.zeros((3, 0)))
    same = Agreement.of(("a", "b", "c"), np.array([1.0, 1.0, 1.0]), np.full(3, 0.002), solved)
    other = Agreement.of(("a", "b", "c"), np.array([1.0, 1.05, 1.0]), np.full(3, 0.002), solved)
    assert same.explanations() == [frozenset()]
    assert other.explanations() == [frozenset("b")]


def test_the_more_are_tested_the_more_must_one_deviate() -> None:
    assert agreement([1.0]).critical == pytest.approx(2.576, abs=0.001)
    assert agreement([1.0, 2.0, 3.0, 4.0]).critical == pytest.approx(3.023, abs=0.001)


@pytest.mark.parametrize("wrong", [0, 1, 2, 3])
def test_one_wrong_reference_is_found(wrong: int) -> None:
    values = [1.0, 2.0, 3.0, 4.0]
    values[wrong] += 0.05
    found = agreement(values)
    assert found.explanations() == [frozenset({NAMES[wrong]})]
    otherwise, sigma = found.rest(NAMES[wrong], frozenset({NAMES[wrong]}))
    assert otherwise == pytest.approx(wrong + 1, abs=3 * sigma)
    assert 0.002 < sigma < 0.02


def test_of_two_either_may_be_wrong() -> None:
    assert set(agreement([1.0, 2.05]).explanations()) == set()
    assert len(agreement([1.0, 2.0, 3.05, 4.05]).explanations()) != 1


def test_landmarks_that_look_odd_count_last() -> None:
    values = [1.1, 2.1, 3.0, 4.0]
    assert agreement(values).explanations(frozenset({"a", "b"})) == [frozenset({"a", "b"})]
    assert agreement(values).explanations(frozenset({"c", "d"})) == [frozenset({"c", "d"})]


def test_a_small_error_is_within_the_noise() -> None:
    assert agreement([1.0, 2.0, 3.0, 4.004]).explanations() == [frozenset()]


def test_an_error_that_all_have_in_common_shows_only_against_others() -> None:
    found = agreement([1.0, 2.0, 3.0, 4.0])
    assert found.common_error(frozenset("a")) == pytest.approx(np.hypot(found.rest("a")[1], 0.002))
    assert found.common_error(frozenset("abc")) < 0.01
    assert found.common_error(frozenset("abcd")) > 10.0
