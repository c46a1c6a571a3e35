"""Which elements of two rows are the same, whatever their frames: candidates for the shift along the row, and the one
that explains most.

Repetitive rows fit nearly as well when they slip by one bay. Every shift that many like elements vote for is therefore
tried, with the scale and offsets that suit it, and scored by how many elements it pairs, how well these agree in place,
size and text, and how many it leaves without a partner where the other map's camera passed. A shift that scores as much
as the best is an alternative, which the result tells.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from savmap.maps.comparison.elements import Coverage, Elements
from savmap.maps.comparison.motion import SCALE, Fit, Pairs, fit, half_turn
from savmap.types import Bools, Floats, Ints

BIN_M, MOST_CANDIDATES = 0.2, 15
NEAR_Y_M, NEAR_SIZE_M = 0.08, 0.1
SAME_TEXT, OTHER_TEXT = 3.0, 0.2
NEAR_M = np.array([0.10, 0.05, 0.20])
"""How exactly a pair's middles agree for half its score, about: what masks and scales leave after the fit."""
UNPAIRED = 0.5
FIRST_GATE_M, GATE_M = 0.8, 0.5
LEAST_PAIRS, LEAST_SHARE, TURN_SHARE = 3, 0.3, 0.5
MARGIN, MARGIN_SHARE = 1.5, 0.02
PROMISING, QUICK = 0.6, 5
SAME_SHIFT_M = 0.5
LONG_M, FACTOR_STEP, MOST_FACTOR, EVEN_SCALE = 0.5, 0.01, 1.5, 0.03


@dataclass(frozen=True, eq=False)
class Reading:
    """Pairs of elements (old, new), their fit, the score and the share of the smaller row's elements that agree."""

    pairs: Pairs
    fit: Fit
    score: float
    share: float

    @property
    def shift_m(self) -> float:
        """Along x, where the row's middle goes."""
        return float(self.fit.unknowns[0])


def best_readings(old: Elements, new: Elements, covers: tuple[Coverage, Coverage]) -> list[Reading]:
    """The best reading, then those that are as good; none where too little agrees. Half a turn is thought of only where
    nothing fits without, and another scale only where nothing fits then."""
    straight = sorted(_readings(old, new, covers, False), key=lambda one: -one.score)
    if straight and straight[0].share >= TURN_SHARE:
        return _as_good(straight)
    turned = sorted(_readings(old, new, covers, True), key=lambda one: -one.score)
    if turned and turned[0].share >= TURN_SHARE:
        return _as_good(turned)
    scaled = sorted(_scaled_readings(old, new, covers), key=lambda one: -one.score)
    if scaled and scaled[0].share >= TURN_SHARE:
        return _as_good(scaled)
    return _as_good(straight) if straight and straight[0].share >= LEAST_SHARE else []


def _scaled_readings(old: Elements, new: Elements, covers: tuple[Coverage, Coverage]) -> Iterator[Reading]:
    """Readings in which one map measures more than the other by as much as typical elements of both are larger, along
    the row as well as upwards: bays of other widths may have likes at other heights."""
    for factor in _factors(old, new):
        larger = replace(old, middles=factor * old.middles, sizes=factor * old.sizes)
        passed = replace(covers[0], places=factor * covers[0].places, reach_m=factor * covers[0].reach_m)
        for turned in (False, True):
            for one in _readings(larger, new, (passed, covers[1]), turned):
                found = fit(old, new, one.pairs, turned, free_scale=True)
                if np.abs(found.unknowns[SCALE] - (factor - 1)).max() < EVEN_SCALE:
                    yield replace(one, fit=found)


def _factors(old: Elements, new: Elements) -> list[float]:
    """By how much elements of one kind are longer in the new map, where they are so at all."""
    factors: list[float] = []
    for group in np.intersect1d(old.groups, new.groups).tolist():
        for sizes in ([one.sizes[one.groups == group, axis] for one in (old, new)] for axis in (0, 1)):
            before, after = (float(np.median(one)) for one in sizes)
            factor = after / before if min(before, after) > LONG_M else 1.0
            apart = all(abs(factor / other - 1) > FACTOR_STEP for other in (1.0, *factors))
            if apart and max(factor, 1 / factor) < MOST_FACTOR:
                factors.append(factor)
    return factors


def _as_good(found: list[Reading]) -> list[Reading]:
    """The best reading and its equals at other shifts; among equals the least shift is first."""
    best = found[0]
    margin = max(MARGIN, MARGIN_SHARE * best.score)
    equals: list[Reading] = []
    for one in found:
        if one.score >= best.score - margin and all(abs(one.shift_m - kept.shift_m) > SAME_SHIFT_M for kept in equals):
            equals.append(one)
    return sorted(equals, key=lambda one: abs(one.shift_m)) if len(equals) > 1 else equals


def _readings(old: Elements, new: Elements, covers: tuple[Coverage, Coverage], turned: bool) -> Iterator[Reading]:
    for pairs in _promising(old, new, turned):
        for _ in range(2):
            if len(pairs) < LEAST_PAIRS:
                break
            found = fit(old, new, pairs, turned, QUICK)
            pairs = paired(old, new, found.carried(old.middles), GATE_M)
        if len(pairs) >= LEAST_PAIRS:
            found = fit(old, new, pairs, turned)
            score, share = _score(old, new, pairs, found, covers)
            yield Reading(pairs, found, score, share)


def _promising(old: Elements, new: Elements, turned: bool) -> list[Pairs]:
    """The first pairs of each shift that is worth a fit: of those that agree, but for one offset, nearly as well as the
    best."""
    first: list[tuple[float, Pairs]] = []
    for shift in _candidates(old, new, turned):
        placed = half_turn(old.middles, turned) + np.array([shift, 0.0, 0.0])
        pairs = paired(old, new, placed, FIRST_GATE_M)
        if pairs:
            rows, columns = np.array(pairs, dtype=np.int64).T
            off = new.middles[columns] - placed[rows]
            first.append((float(_agreement(old, new, rows, columns, off - np.median(off, axis=0)).sum()), pairs))
    best = max((score for score, _ in first), default=0.0)
    return [pairs for score, pairs in first if score >= PROMISING * best]


def _candidates(old: Elements, new: Elements, turned: bool) -> list[float]:
    """The shifts along x that most like elements vote for."""
    placed = half_turn(old.middles, turned)
    votes = _likeness(old, new)
    votes *= np.exp(-0.5 * ((new.middles[None, :, 1] - placed[:, None, 1]) / NEAR_Y_M) ** 2)
    apart = new.middles[None, :, 0] - placed[:, None, 0]
    chosen = votes > 0.01
    if not chosen.any():
        return []
    bins = np.round(apart[chosen] / BIN_M).astype(np.int64)
    low = int(bins.min()) - 1
    counts = np.bincount(bins - low, weights=votes[chosen], minlength=int(bins.max()) - low + 2)
    smooth = np.convolve(counts, [1.0, 1.0, 1.0], "same")
    padded = np.pad(smooth, 1)
    peaks: Bools = (smooth >= padded[:-2]) & (smooth > padded[2:])
    order = sorted(np.flatnonzero(peaks).tolist(), key=lambda one: -smooth[one])[:MOST_CANDIDATES]
    return [_middle(apart, votes, (one + low) * BIN_M) for one in order]


def _middle(apart: Floats, votes: Floats, shift: float) -> float:
    near = np.abs(apart - shift) <= 1.5 * BIN_M
    return float(np.average(apart[near], weights=votes[near]))


def _likeness(old: Elements, new: Elements) -> Floats:
    """How much alike (n, m) elements are but for their places: 0 for those of other kinds."""
    off = (new.sizes[None] - old.sizes[:, None]) / NEAR_SIZE_M
    off[..., 1] = np.where(_tall(old)[:, None] & _tall(new)[None], 0.0, off[..., 1])
    alike: Floats = (old.groups[:, None] == new.groups[None]) * np.exp(-0.5 * (off**2).sum(axis=2))
    texts_old, texts_new = np.array(old.texts, dtype=object), np.array(new.texts, dtype=object)
    both = (texts_old != "")[:, None] & (texts_new != "")[None]
    same = texts_old[:, None] == texts_new[None]
    return np.asarray(alike * np.where(both, np.where(same, SAME_TEXT, OTHER_TEXT), 1.0), dtype=np.float64)


def _tall(elements: Elements) -> Bools:
    """Those whose height is not known to the size that likeness asks for."""
    loose: Bools = elements.size_sigmas[:, 1] > NEAR_SIZE_M
    return loose


def paired(old: Elements, new: Elements, placed: Floats, gate_m: float) -> Pairs:
    """Pairs of elements of one kind no further apart than `gate_m`, along no axis; together they are as near as can be.
    `placed` (n, 3): the old middles in the new frame. Heights that nobody measured count for nothing."""
    if not len(old) or not len(new):
        return ()
    apart = np.abs(new.middles[None] - placed[:, None])
    loose = np.hypot(old.middle_sigmas[:, None], new.middle_sigmas[None]) > NEAR_SIZE_M
    cost = np.linalg.norm(np.where(loose, np.minimum(apart, 0.1 * gate_m), apart), axis=2)
    cost[old.groups[:, None] != new.groups[None]] = np.inf
    cost = np.where(cost < gate_m, cost, np.inf)
    # an element without a partner costs half the gate
    full = np.full((len(old) + len(new), len(old) + len(new)), np.inf)
    full[: len(old), : len(new)] = cost
    full[np.arange(len(old)), len(new) + np.arange(len(old))] = gate_m / 2
    full[len(old) + np.arange(len(new)), np.arange(len(new))] = gate_m / 2
    full[len(old) :, len(new) :] = 0.0
    rows, columns = linear_sum_assignment(np.where(np.isfinite(full), full, 1e6))
    inside = (rows < len(old)) & (columns < len(new))
    return tuple((int(i), int(j)) for i, j in zip(rows[inside], columns[inside], strict=True))


def _score(
    old: Elements, new: Elements, pairs: Pairs, found: Fit, covers: tuple[Coverage, Coverage]
) -> tuple[float, float]:
    """The score of a reading, and the share of the smaller row that agrees."""
    rows, columns = np.array(pairs, dtype=np.int64).T
    placed = found.carried(old.middles)
    off = new.middles[columns] - placed[rows]
    agreement = _agreement(old, new, rows, columns, off)
    left_old = _unpaired(old, set(rows.tolist()), placed, covers[1])
    back = found.carried_back(new.middles)
    left_new = _unpaired(new, set(columns.tolist()), back, covers[0])
    share = float((agreement > 0.5).sum()) / max(min(len(old), len(new)), 1)
    return float(agreement.sum()) - UNPAIRED * (left_old + left_new), share


def _agreement(old: Elements, new: Elements, rows: Ints, columns: Ints, off: Floats) -> Floats:
    """How well pairs (n,) whose middles are `off` (n, 3) m agree, 0 to 1, more where texts do."""
    loose = np.hypot(old.middle_sigmas[rows], new.middle_sigmas[columns]) > NEAR_SIZE_M
    near: Floats = np.exp(-0.5 * (np.where(loose, 0.0, off / NEAR_M) ** 2).sum(axis=1))
    return near * _likeness(old, new)[rows, columns]


def _unpaired(elements: Elements, paired_ones: set[int], placed: Floats, cover: Coverage) -> int:
    return sum(
        cover.has(elements.kinds[elements.groups[k]][0], float(placed[k, 0]), float(elements.sizes[k, 0]))
        for k in range(len(elements))
        if k not in paired_ones
    )
