"""Lamps that share heights or lines, as far as their standard deviations tell."""

import numpy as np

from savmap_lights.space.ties import agreeing, unnoticed


def test_values_are_alike_that_agree_with_most() -> None:
    values, sigmas = np.array([6.0, 6.002, 5.999, 5.9, 6.05]), np.array([0.002, 0.002, 0.002, 0.002, 0.03])
    assert agreeing(values, sigmas).tolist() == [True, True, True, False, True]
    assert not agreeing(np.array([6.0, 6.1, 6.2, 6.3]), np.full(4, 0.002)).any()


def test_ties_are_as_loose_as_the_test_is_blind() -> None:
    vague, sharp = np.full(5, 0.03), np.full(5, 0.002)
    values = np.array([6.0, 6.0, 6.0, 6.0, 5.92])
    assert agreeing(values, vague).all()
    assert 0.02 < unnoticed(values, vague) < 0.03
    assert unnoticed(np.full(5, 6.0), vague) == 0.0
    assert unnoticed(6.0 + sharp * [1, -1, 0, 1, -1], sharp) < 0.003
