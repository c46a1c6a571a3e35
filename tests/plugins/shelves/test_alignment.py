"""Alignment in order against every possible matching."""

from itertools import combinations

import numpy as np
import pytest

from savmap_shelves.report.evaluation import AlignmentCosts, Pair, align, gaps


def cost(truth: np.ndarray, estimate: np.ndarray, pairs: list[Pair], costs: AlignmentCosts) -> float:
    total = float(len(truth) + len(estimate) - 2 * len(pairs))
    for n, (i, j) in enumerate(pairs):
        own = np.abs(truth[i] - estimate[j]).mean() / costs.tolerance_m
        if n == 0:
            total += costs.first * own
            continue
        before, other = pairs[n - 1]
        step = np.abs((truth[i] - truth[before]) - (estimate[j] - estimate[other])).mean() / costs.tolerance_m
        total += costs.position * own + (1 - costs.position) * step
    return total


def cheapest(truth: np.ndarray, estimate: np.ndarray, costs: AlignmentCosts) -> float:
    every = [
        list(zip(rows, columns, strict=True))
        for size in range(min(len(truth), len(estimate)) + 1)
        for rows in combinations(range(len(truth)), size)
        for columns in combinations(range(len(estimate)), size)
    ]
    return min(cost(truth, estimate, pairs, costs) for pairs in every)


@pytest.mark.parametrize("seed", range(12))
def test_the_cheapest_of_all_matchings_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low = np.sort(rng.uniform(0, 6, rng.integers(1, 6)))
    truth = np.column_stack([low, low + 0.1])
    kept = truth[rng.random(len(truth)) < 0.8] + rng.normal(0, 0.05, (1, 2))
    extra = rng.uniform(0, 6, (rng.integers(0, 3), 1)) + np.array([0, 0.1])
    estimate = np.concatenate([kept, extra])
    estimate = estimate[np.argsort(estimate.mean(axis=1))]
    costs = AlignmentCosts(0.25, position=(0.0, 0.5, 1.0)[seed % 3], first=1.0)
    found = cost(truth, estimate, align(truth, estimate, costs), costs)
    assert found == pytest.approx(cheapest(truth, estimate, costs))


def test_nothing_to_match() -> None:
    none, one = np.zeros((0, 2)), np.array([[0.0, 0.1]])
    costs = AlignmentCosts(0.25, position=0.5, first=1.0)
    assert align(none, one, costs) == align(one, none, costs) == align(one, one + 5, costs) == []


def test_gaps_lie_between_consecutive_intervals() -> None:
    assert gaps(np.array([[0.0, 0.1], [1.0, 1.2], [2.0, 2.1]])) == pytest.approx([0.9, 0.8])
