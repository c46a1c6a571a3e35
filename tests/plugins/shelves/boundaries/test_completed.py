"""Strips of which the picture's border cuts off an edge."""

from dataclasses import replace

import numpy as np

from savmap.geometry.lines import Lines
from savmap_shelves.boundaries.strips import Strips


def lines(offsets: list[float], inliers: list[float]) -> Lines:
    """Level lines at these heights, px."""
    count = len(offsets)
    zero = np.zeros(count)
    return Lines(zero, zero, np.array(offsets), zero + 0.1, zero + 0.1, zero, zero + 99, np.array(inliers))


def strips(upper: Lines, lower: Lines) -> Strips:
    count = len(upper)
    return Strips(
        upper, lower, np.arange(count), np.zeros(count), np.full(count, 99.0), np.full(count, 100.0), np.ones(count)
    )


def test_an_edge_that_is_cut_off_lies_as_far_as_is_usual_and_has_no_weight() -> None:
    cut = strips(lines([10, 60, 110], [90, 90, 90]), lines([26, 76, np.nan], [90, 90, 0]))
    whole = cut.completed()
    assert len(whole) == 3
    assert whole.lower.offset.tolist() == [26, 76, 126]
    assert whole.lower.inliers.tolist() == [90, 90, 0]
    assert whole.upper.inliers.tolist() == [90, 90, 90]


def test_what_has_no_edge_is_left_out() -> None:
    few = strips(lines([10, 60], [90, 3]), lines([26, 76], [90, 3]))
    assert len(few.completed()) == 1


def test_where_no_strip_is_whole_nothing_is_completed() -> None:
    cut = strips(lines([10, 60], [90, 90]), lines([np.nan, np.nan], [0, 0]))
    assert len(cut.completed()) == 0
    assert len(replace(cut, lower=cut.upper).completed()) == 0
