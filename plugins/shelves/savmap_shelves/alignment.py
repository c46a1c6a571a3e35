"""Two ordered lists of intervals matched in order, either of which may have elements that the other lacks."""

from dataclasses import dataclass

import numpy as np

from savmap.types import Floats

Pairs = list[tuple[int, int]]


@dataclass(frozen=True)
class Costs:
    """What a match costs; an element left unmatched, on either side, costs 1.

    tolerance_m: the disagreement that costs 1. position: weight of a pair's own disagreement; the rest, 1 - position,
    weighs how its step from the pair before it disagrees, which a drift along the list leaves alone. first: weight of
    the first pair's own disagreement, for it has no step.
    """

    tolerance_m: float
    position: float
    first: float


def align(truth: Floats, estimate: Floats, costs: Costs) -> Pairs:
    """The cheapest matching, in order, of intervals `truth` (n, 2) and `estimate` (m, 2), both sorted by their centre.

    Returns pairs of indices, increasing in both. Dynamic programming over the pair that was matched last.
    """
    count, found = len(truth), len(estimate)
    if not count or not found:
        return []
    own = _disagreement(truth[:, None] - estimate[None]) / costs.tolerance_m
    best = np.empty((count, found))
    before: dict[tuple[int, int], tuple[int, int] | None] = {}
    for i in range(count):
        for j in range(found):
            best[i, j], before[i, j] = _best_start(i, j, truth, estimate, best, own, costs)
    rows, columns = np.indices(best.shape)
    total = best + (count - 1 - rows) + (found - 1 - columns)
    last = np.unravel_index(int(np.argmin(total)), total.shape)
    return _chain((int(last[0]), int(last[1])), before) if total[last] < count + found else []


def gaps(intervals: Floats) -> Floats:
    """Free lengths (n - 1,) between consecutive intervals (n, 2)."""
    free: Floats = intervals[1:, 0] - intervals[:-1, 1]
    return free


def _best_start(
    i: int, j: int, truth: Floats, estimate: Floats, best: Floats, own: Floats, costs: Costs
) -> tuple[float, tuple[int, int] | None]:
    alone = i + j + costs.first * own[i, j]
    if not i or not j:
        return alone, None
    steps = (truth[i] - truth[:i])[:, None] - (estimate[j] - estimate[:j])[None]
    skipped = (i - 1 - np.arange(i))[:, None] + (j - 1 - np.arange(j))[None]
    step = (1 - costs.position) * _disagreement(steps) / costs.tolerance_m
    through = best[:i, :j] + skipped + step + costs.position * own[i, j]
    where = np.unravel_index(int(np.argmin(through)), through.shape)
    return (alone, None) if alone < through[where] else (float(through[where]), (int(where[0]), int(where[1])))


def _chain(last: tuple[int, int], before: dict[tuple[int, int], tuple[int, int] | None]) -> Pairs:
    pairs: Pairs = []
    pair: tuple[int, int] | None = last
    while pair is not None:
        pairs.append(pair)
        pair = before[pair]
    return pairs[::-1]


def _disagreement(ends: Floats) -> Floats:
    """Mean absolute difference of two intervals' ends (..., 2)."""
    mean: Floats = np.abs(ends).mean(axis=-1)
    return mean
