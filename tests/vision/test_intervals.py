"""The best set of intervals and the probability of each: exactly what trying all sets gives."""

from itertools import combinations, pairwise
from typing import TypeAlias

import numpy as np
import pytest

from savmap.types import Floats
from savmap.vision.evidence.intervals import Occlusion, best_intervals, interval_scores, log_partitions

WIDTHS = np.array([2, 3, 5])
OPEN = Occlusion((0.0,), (1.0,), 1.0, 1.0)
Interval: TypeAlias = tuple[int, int]


def all_sets(count: int, gap: int) -> list[tuple[Interval, ...]]:
    """All sets of intervals (first cell, column of the width) on a line of so many cells."""
    single = [(i, k) for i in range(count) for k, width in enumerate(WIDTHS.tolist()) if i + width <= count]
    return [
        chosen
        for size in range(count // 2 + 1)
        for chosen in combinations(single, size)
        if all(b[0] >= a[0] + WIDTHS[a[1]] + gap for a, b in pairwise(chosen))
    ]


@pytest.mark.parametrize("gap", [0, 1, 3])
def test_the_best_set_and_all_probabilities_are_exact(gap: int) -> None:
    rng = np.random.default_rng(gap)
    lines = [rng.normal(0, 3, (9, len(WIDTHS))) for _ in range(4)]
    sets = all_sets(9, gap)
    for scores, found in zip(lines, best_intervals(lines, WIDTHS, gap), strict=True):
        totals = np.array([sum(scores[place] for place in chosen) for chosen in sets])
        likely = np.exp(totals - totals.max()) / np.exp(totals - totals.max()).sum()
        expected = np.zeros_like(scores)
        for chosen, probability in zip(sets, likely, strict=True):
            for place in chosen:
                expected[place] += probability
        best = sets[int(totals.argmax())]
        assert found.cells.tolist() == [[i, i + WIDTHS[k]] for i, k in best]
        assert found.score == pytest.approx([scores[place] for place in best])
        assert found.posterior == pytest.approx(expected, abs=1e-9)
        assert log_partitions([scores], WIDTHS, gap) == pytest.approx(np.logaddexp.reduce(totals))


def test_lines_without_evidence_are_empty() -> None:
    (found,) = best_intervals([np.full((9, 3), -50.0)], WIDTHS, 1)
    assert found.cells.shape == (0, 2)
    assert len(found.existing) == 0
    assert found.others(0.01) == []


def test_an_interval_exists_at_this_place_give_or_take_half_of_its_width() -> None:
    """Three placings of one interval share its probability; what may be elsewhere is told with its own."""
    scores = np.full((30, 3), -50.0)
    scores[10:13, 1] = 6.0, 6.1, 6.0
    scores[22, 0] = np.log(0.25)
    (found,) = best_intervals([scores], WIDTHS, 2)
    total = np.exp(scores[10:13, 1]).sum()
    assert found.cells.tolist() == [[11, 14]]
    assert found.posterior.max() < 0.4
    assert found.existing == pytest.approx([total / (1 + total)], abs=1e-6)
    assert found.others(0.01) == [(22, 24, pytest.approx(0.2))]
    assert found.others(0.3) == []


def test_an_interval_scores_the_sum_of_its_cells() -> None:
    ratios = np.random.default_rng(1).normal(0, 1, (8, 6))
    scores = interval_scores(ratios, WIDTHS, OPEN)
    assert scores[2, 1] == pytest.approx(ratios[2:5].sum())
    assert scores[3, 2] == pytest.approx(ratios[3:8].sum())
    assert np.isneginf(scores[4, 2])
    alike = interval_scores(ratios, WIDTHS, Occlusion((0.0,), (1.0,), 3.0, 2.0))
    assert alike[2, 1] == pytest.approx(scores[2, 1] / 6)


def hidden_by_half(occlusion: Occlusion) -> float:
    """The score of an interval of which goods hide one half of the length."""
    ratios: Floats = np.full((3, 20), 3.0)
    ratios[:, 10:] = -4.0
    return float(interval_scores(ratios, np.array([3]), occlusion)[0, 0])


def test_what_hides_a_share_of_an_interval_does_not_speak_against_it() -> None:
    shares, chances = (0.05, 0.5), (0.7, 0.3)
    lines = [10 * sum(3 * np.log(h + (1 - h) * np.exp(value)) for value in (3.0, -4.0)) for h in shares]
    expected = np.log(sum(chance * np.exp(line) for chance, line in zip(chances, lines, strict=True)))
    assert hidden_by_half(Occlusion(shares, chances, 1.0, 1.0)) == pytest.approx(expected)
    assert hidden_by_half(OPEN) < 0 < hidden_by_half(Occlusion(shares, chances, 1.0, 1.0))
