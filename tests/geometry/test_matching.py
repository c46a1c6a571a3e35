"""One to one matching: as many pairs as there can be within the limit, then the least sum of costs."""

import numpy as np

from savmap.geometry.matching import matched


def test_more_pairs_count_more_than_a_smaller_sum() -> None:
    assert matched(np.array([[0.1, 0.9], [5.0, 0.2]]), 1.0) == {0: 0, 1: 1}
    assert matched(np.array([[0.1, 0.9], [0.2, 5.0]]), 1.0) == {0: 1, 1: 0}


def test_pairs_at_the_limit_are_none() -> None:
    assert matched(np.array([[1.0, 0.5], [0.6, 2.0], [0.7, 0.8]]), 1.0) == {0: 1, 1: 0}
    assert matched(np.array([[1.0]]), 1.0) == {}


def test_gains_are_negative_costs() -> None:
    overlap = np.array([[2.0, 1.5], [1.8, -0.5]])
    assert matched(-overlap, 0.0) == {0: 1, 1: 0}


def test_nothing_matches_nothing() -> None:
    assert matched(np.zeros((0, 3)), 1.0) == matched(np.zeros((2, 0)), 1.0) == {}
