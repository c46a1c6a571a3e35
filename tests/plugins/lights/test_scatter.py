"""Rays that lie off aside of the line of lamps."""

import numpy as np

from savmap_lights.space.scatter import scatter


def test_a_ray_far_aside_is_left_out_and_a_spread_counts() -> None:
    aside = np.array([0.0, 0.01, -0.01, 0.5, 0.0, 0.08, -0.08, 0.09, -0.07])
    place = np.array([0, 0, 0, 0, 1, 1, 1, 1, 1])
    agree, wider = scatter(aside, np.full(9, 0.01), place, np.ones(9, np.bool_))
    assert agree.tolist() == [True] * 3 + [False] + [True] * 5
    assert wider[0] < 2 < 8 < wider[4]


def test_what_was_not_kept_counts_for_nothing() -> None:
    kept = np.array([True, True, False])
    agree, wider = scatter(np.array([0.0, 0.0, 9.0]), np.full(3, 0.01), np.zeros(3, np.int64), kept)
    assert agree.tolist() == kept.tolist()
    assert wider.tolist() == [1.0] * 3
