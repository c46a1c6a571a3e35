"""Intervals along one axis of a plane: which parts of it a class occupies, and how likely each of them is.

Posts along a face, beams up a section and lamps along a ceiling are one problem: a line of cells, each with the
log-likelihood ratio of a class, of which any share may be hidden. The best set of intervals with a least gap between
them is found exactly by dynamic programming over a semi-Markov chain, and forward-backward gives the probability of
every interval (Sarawagi and Cohen, 2004; for façades, Teboul et al., 2011).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.types import Floats, Ints, array_record


@dataclass(frozen=True)
class Occlusion:
    """How cells speak for an interval. What stands in front hides a share of its length: one of `shares`, with
    probabilities `chances`. `same_along`, `same_across`: over how many cells, along its length and over its width,
    pictures say the same thing."""

    shares: tuple[float, ...]
    chances: tuple[float, ...]
    same_along: float
    same_across: float


def interval_scores(ratios: Floats, widths: Ints, occlusion: Occlusion) -> Floats:
    """Log-likelihood ratios (n, w) of intervals that begin at cell i and are `widths` (w,) cells wide; -inf where they
    do not fit.

    ratios (n, m): of cells, n along the axis and m along the intervals' length; 0 where nothing was seen. Where a share
    h is hidden, an interval scores sum log(h + (1 - h) e^L) over its cells, for what is hidden says nothing; the
    shares' likelihoods are added up by their chances.
    """
    count, together = len(ratios), occlusion.same_along * occlusion.same_across
    likely = np.exp(ratios)
    lines = [np.log(share + (1 - share) * likely).sum(axis=1) / together for share in occlusion.shares]
    summed = np.cumsum(np.pad(np.stack(lines), ((0, 0), (1, 0))), axis=1)
    chances = np.log(occlusion.chances)[:, None]
    scores = np.full((count, len(widths)), -np.inf)
    for column, width in enumerate(widths.tolist()):
        if width <= count:
            scores[: count - width + 1, column] = _log_sum(summed[:, width:] - summed[:, :-width] + chances)
    return scores


@dataclass(frozen=True, eq=False)
@array_record
class Intervals:
    """The best set of intervals of one line: `first` and `last` + 1 cell (k, 2), the `score` of each (k,), and
    `posterior` (n, w), the probability of each possible interval by its first cell and its width."""

    cells: Ints
    score: Floats
    posterior: Floats
    widths: Ints

    def probability(self, low: float, high: float) -> float:
        """How likely some interval has its middle between two places, in cells."""
        middles = np.arange(len(self.posterior))[:, None] + self.widths / 2
        return float(min(self.posterior[(middles >= low) & (middles <= high)].sum(), 1.0))

    @property
    def existing(self) -> Floats:
        """How likely each interval of the best set exists (k,), at this place give or take half of its width."""
        return np.array([self.probability(low, high) for low, high in self.cells.tolist()])

    def others(self, least: float) -> list[tuple[int, int, float]]:
        """Intervals that are in no conflict with the best set's places but may exist: first, last + 1, probability of
        at least `least`."""
        free = self.posterior.copy()
        middles = np.arange(len(free))[:, None] + self.widths / 2
        for low, high in self.cells.tolist():
            free[(middles >= low) & (middles <= high)] = 0.0
        chosen: list[tuple[int, int, float]] = []
        while True:
            first, column = np.unravel_index(int(free.argmax()), free.shape)
            low, high = int(first), int(first) + int(self.widths[column])
            near = (middles >= low) & (middles <= high)
            likely = float(free[near].sum())
            if likely < least:
                return chosen
            chosen.append((low, high, likely))
            free[near] = 0.0


def best_intervals(scores: Sequence[Floats], widths: Ints, gap: int) -> list[Intervals]:
    """The best set of intervals of each line, at least `gap` cells apart, and all intervals' probabilities; exact.

    scores: of each line (n, w), log-likelihood ratios and prior together; all lines have n cells.
    """
    table, forward = _forward(scores, widths, gap)
    lines, count, _ = table.shape
    best, backward = np.zeros((2, count + 1, lines))
    choice = np.full((count + 1, lines), -1)
    each = np.arange(len(widths))
    for end in range(1, count + 1):
        fits = widths <= end
        start = end - widths[fits]
        value = table[:, start, each[fits]].T
        options = np.concatenate([best[end - 1][None], best[np.maximum(start - gap, 0)] + value])
        best[end], choice[end] = options.max(axis=0), options.argmax(axis=0) - 1
    for begin in range(count - 1, -1, -1):
        after = np.minimum(begin + widths + gap, count)
        backward[begin] = _log_sum(np.concatenate([backward[begin + 1][None], backward[after] + table[:, begin].T]))
    begins = np.arange(count)[:, None]
    before, after = np.maximum(begins[:, 0] - gap, 0), np.minimum(begins + widths + gap, count)
    likely = np.exp(
        np.minimum(
            forward[before].T[:, :, None] + table + np.moveaxis(backward[after], 2, 0) - forward[-1][:, None, None], 0
        )
    )
    fitting = [np.flatnonzero(widths <= end) for end in range(count + 1)]
    result = []
    for line in range(lines):
        cells, end = list[tuple[int, int]](), count
        while end > 0:
            taken = int(choice[end, line])
            if taken < 0:
                end -= 1
                continue
            begin = end - int(widths[fitting[end][taken]])
            cells.append((begin, end))
            end = max(begin - gap, 0)
        ordered = np.array(cells[::-1], np.int64).reshape(-1, 2)
        scored = table[line, ordered[:, 0], np.searchsorted(widths, ordered[:, 1] - ordered[:, 0])]
        result.append(Intervals(ordered, scored, likely[line], widths))
    return result


def log_partitions(scores: Sequence[Floats], widths: Ints, gap: int) -> Floats:
    """Of each line (lines,), the log of the sum of e^score over all sets of intervals that are at least `gap` cells
    apart; the empty set counts 1. Arguments are those of `best_intervals`."""
    return np.asarray(_forward(scores, widths, gap)[1][-1])


def _forward(scores: Sequence[Floats], widths: Ints, gap: int) -> tuple[Floats, Floats]:
    """The lines' scores (lines, n, w), -inf where intervals do not fit, and the log sums (n + 1, lines) over all sets
    up to each cell."""
    table = np.stack(scores)
    lines, count, _ = table.shape
    table = np.where(np.arange(count)[:, None] + widths > count, -np.inf, table)
    forward, each = np.zeros((count + 1, lines)), np.arange(len(widths))
    for end in range(1, count + 1):
        fits = widths <= end
        start = end - widths[fits]
        value = table[:, start, each[fits]].T
        forward[end] = _log_sum(np.concatenate([forward[end - 1][None], forward[np.maximum(start - gap, 0)] + value]))
    return table, forward


def _log_sum(values: Floats) -> Floats:
    """log sum exp over the first axis."""
    most = values.max(axis=0)
    safe = np.where(np.isfinite(most), most, 0.0)
    return np.asarray(safe + np.log(np.exp(values - safe).sum(axis=0)))
