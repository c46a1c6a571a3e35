"""Two maps of one place compared: rows by name, each row's frame found anew in the other's, and every element of
both.

Repetitive rows fit nearly as well when they slip by one bay. Every shift that many like elements vote for is therefore
tried, with the scale and offsets that suit it, and scored by how many elements it pairs, how well these agree in place,
size and text, and how many it leaves without a partner where the other map's camera passed. A shift that scores as much
as the best is an alternative, which the result tells.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.optimize import linear_sum_assignment

from savmap.apps.dates.comparison.changes import (
    pairs_compared,
    scale_differences,
    stands_out,
    unpaired,
    with_significance,
    with_states,
)
from savmap.apps.dates.comparison.elements import Coverage, Elements, coverage_of, elements_of, kinds_of
from savmap.apps.dates.comparison.motion import HEADING, SCALE, Fit, Pairs, T, fit, half_turn
from savmap.apps.dates.comparison.records import Comparison, ElementChange, RowComparison, RowMotion, ScaleDifference
from savmap.types import Bools, Floats, Ints, RowMap, SiteMap, Structure

LEVEL = 0.1
"""Of what is called a change, at most this share is chance."""
MOST_RENAMED, RENAMED_SHARE = 9, 0.8
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
Openings = Mapping[str, Mapping[str, Sequence[Structure]]]
"""By row and plugin, what is between structures, such as the clear space of which somebody cares how wide and high it
is."""
Covers = tuple[Coverage, Coverage]


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


def compare_maps(
    old: SiteMap,
    new: SiteMap,
    openings: tuple[Openings, Openings] = ({}, {}),
    level: float = LEVEL,
) -> Comparison:
    """What changed from the old to the new map, and what of it both can tell. Rows are known by their names; a row that
    the other map's run failed to map is neither new nor missing."""
    rows = [
        _row_compared(row, new.rows[name], (openings[0].get(name, {}), openings[1].get(name, {})))
        for name, row in old.rows.items()
        if name in new.rows
    ]
    missing = tuple(name for name in old.rows if name not in new.rows and name not in new.failed)
    added = tuple(name for name in new.rows if name not in old.rows and name not in old.failed)
    failed = (*(name for name in old.rows if name in new.failed), *(name for name in new.rows if name in old.failed))
    renamed = tuple(_renamed(old, new, missing, added))
    # elements of all rows are one family of tests, openings another, and scales a third
    elements = with_states([row.elements for row in rows], level)
    between = with_states([row.openings for row in rows], level)
    scales = with_significance([row.scales for row in rows], level)
    compared = (
        replace(row, elements=of_elements, openings=of_openings, scales=of_scale)
        for row, of_elements, of_openings, of_scale in zip(rows, elements, between, scales, strict=True)
    )
    return Comparison(tuple(compared), missing, added, level, failed, renamed)


def _renamed(old: SiteMap, new: SiteMap, missing: Sequence[str], added: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Rows that only one map has, in which nearly all is alike: by both names. Where there are many, nobody can tell
    which is which."""
    if len(missing) * len(added) <= MOST_RENAMED:
        for name, other in product(missing, added):
            *_, best = _row_readings(old.rows[name], new.rows[other])
            if best and best[0].share > RENAMED_SHARE:
                yield name, other


def _row_readings(before: RowMap, after: RowMap) -> tuple[Elements, Elements, Covers, list[Reading]]:
    kinds = kinds_of(before.structures, after.structures)
    old, new = elements_of(before.structures, kinds), elements_of(after.structures, kinds)
    covers = coverage_of(before, old), coverage_of(after, new)
    return old, new, covers, best_readings(old, new, covers)


def _row_compared(
    before: RowMap,
    after: RowMap,
    openings: tuple[Mapping[str, Sequence[Structure]], Mapping[str, Sequence[Structure]]],
) -> RowComparison:
    old, new, covers, readings = _row_readings(before, after)
    if not readings:
        return RowComparison(before.name, after.name, None)
    best, scales = _with_scale(readings[0], (old, before), (new, after))
    carried = best.fit.carried(old.middles)
    back = best.fit.carried_back(new.middles)
    changes: list[ElementChange] = [
        *pairs_compared(old, new, best.pairs, best.fit),
        *unpaired(old, [i for i, _ in best.pairs], carried, carried, covers[1], "missing"),
        *unpaired(new, [j for _, j in best.pairs], back, new.middles, covers[0], "new"),
    ]
    return RowComparison(
        before.name,
        after.name,
        _motion(best, readings[1:]),
        tuple(sorted(changes, key=_from_left)),
        tuple(sorted(_openings_compared(*openings, best, stands_out(scales)), key=_from_left)),
        scales,
    )


def _with_scale(
    best: Reading, old: tuple[Elements, RowMap], new: tuple[Elements, RowMap]
) -> tuple[Reading, tuple[ScaleDifference, ...]]:
    """How the maps' scales differ, and the reading, in whose fit they do where they do by more than the maps know."""
    elements = old[0], new[0]
    free = fit(*elements, best.pairs, best.fit.turned, free_scale=True)
    scales = scale_differences(free, best.pairs, old, new)
    if not stands_out(scales):
        return best, scales
    pairs = paired(*elements, free.carried(old[0].middles), GATE_M)
    if len(pairs) < len(best.pairs):
        return best, scales
    free = fit(*elements, pairs, best.fit.turned, free_scale=True)
    return replace(best, pairs=pairs, fit=free), scale_differences(free, pairs, old, new)


def _from_left(change: ElementChange) -> tuple[float, str]:
    return float(change.position_m[0]), change.name


def _openings_compared(
    before: Mapping[str, Sequence[Structure]], after: Mapping[str, Sequence[Structure]], reading: Reading, scaled: bool
) -> list[ElementChange]:
    """Openings on both dates, paired where the rows' elements place them. What errors their sizes have in common
    is that of openings; `scaled`: the maps' scales differ by more than they know."""
    kinds = kinds_of(before, after)
    old, new = elements_of(before, kinds), elements_of(after, kinds)
    pairs = paired(old, new, reading.fit.carried(old.middles), GATE_M)
    if not pairs:
        return []
    sized = fit(old, new, pairs, reading.fit.turned, free_scale=scaled)
    return list(pairs_compared(old, new, pairs, sized, sizes_only=True))


def _motion(best: Reading, others: Sequence[Reading]) -> RowMotion:
    """The motion of the row's frame, from that about the row's middle."""
    about, unknowns = best.fit.about, best.fit.unknowns
    turn, half = float(unknowns[HEADING]), np.pi if best.fit.turned else 0.0
    lever = half_turn(np.zeros((1, 3)), best.fit.turned)[0] - about
    middle = about + unknowns[T]
    shift = middle + np.array([lever[0] + turn * lever[2], lever[1], lever[2] - turn * lever[0]])
    chosen = [0, 1, 2, HEADING]
    units = np.diag([1.0, 1.0, 1.0, float(np.degrees(1.0))])
    covariance = units @ best.fit.covariance[np.ix_(chosen, chosen)] @ units
    scale = np.array([*unknowns[SCALE], 0.0])
    others_m = tuple(float(other.shift_m - best.shift_m) for other in others)
    return RowMotion(shift, float(np.degrees(turn + half)), covariance, scale, middle, len(best.pairs), others_m)


def best_readings(old: Elements, new: Elements, covers: Covers) -> list[Reading]:
    """The best reading, then those that are as good; none where too little agrees. Half a turn is thought of only where
    nothing fits without, and another scale only where nothing fits then."""
    attempts: list[list[Reading]] = []
    for tried in (_readings(old, new, covers, False), _readings(old, new, covers, True), _scaled(old, new, covers)):
        attempts.append(sorted(tried, key=lambda reading: -reading.score))
        if attempts[-1] and attempts[-1][0].share >= TURN_SHARE:
            return _as_good(attempts[-1])
    straight = attempts[0]
    return _as_good(straight) if straight and straight[0].share >= LEAST_SHARE else []


def _scaled(old: Elements, new: Elements, covers: Covers) -> Iterator[Reading]:
    """Readings in which one map measures more than the other by as much as typical elements of both are larger, along
    the row as well as upwards: bays of other widths may have equals at other heights."""
    for factor in _factors(old, new):
        larger = replace(old, middles=factor * old.middles, sizes=factor * old.sizes)
        for turned in (False, True):
            for reading in _readings(larger, new, (covers[0].moved(factor), covers[1]), turned):
                free = fit(old, new, reading.pairs, turned, free_scale=True)
                if np.abs(free.unknowns[SCALE] - (factor - 1)).max() < EVEN_SCALE:
                    yield replace(reading, fit=free)


def _factors(old: Elements, new: Elements) -> list[float]:
    """By how much elements of one kind are longer in the new map, where they are so at all."""
    factors: list[float] = []
    for group, axis in product(np.intersect1d(old.groups, new.groups).tolist(), (0, 1)):
        before, after = (float(np.median(of.sizes[of.groups == group, axis])) for of in (old, new))
        factor = after / before if min(before, after) > LONG_M else 1.0
        differs = all(abs(factor / other - 1) > FACTOR_STEP for other in (1.0, *factors))
        if differs and max(factor, 1 / factor) < MOST_FACTOR:
            factors.append(factor)
    return factors


def _as_good(readings: list[Reading]) -> list[Reading]:
    """The best reading and its equals at other shifts; among equals the least shift is first."""
    least = readings[0].score - max(MARGIN, MARGIN_SHARE * readings[0].score)
    equals: list[Reading] = []
    for reading in readings:
        if reading.score >= least and all(abs(reading.shift_m - kept.shift_m) > SAME_SHIFT_M for kept in equals):
            equals.append(reading)
    return sorted(equals, key=lambda reading: abs(reading.shift_m)) if len(equals) > 1 else equals


def _readings(old: Elements, new: Elements, covers: Covers, turned: bool) -> Iterator[Reading]:
    for pairs in _promising(old, new, turned):
        for _ in range(2):
            if len(pairs) < LEAST_PAIRS:
                break
            quick = fit(old, new, pairs, turned, QUICK)
            pairs = paired(old, new, quick.carried(old.middles), GATE_M)
        if len(pairs) >= LEAST_PAIRS:
            fitted = fit(old, new, pairs, turned)
            score, share = _score(old, new, pairs, fitted, covers)
            yield Reading(pairs, fitted, score, share)


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
    """The shifts along x that most similar elements vote for."""
    placed = half_turn(old.middles, turned)
    votes = _likeness(old, new)
    votes *= np.exp(-0.5 * ((new.middles[None, :, 1] - placed[:, None, 1]) / NEAR_Y_M) ** 2)
    distance = new.middles[None, :, 0] - placed[:, None, 0]
    chosen = votes > 0.01
    if not chosen.any():
        return []
    bins = np.round(distance[chosen] / BIN_M).astype(np.int64)
    low = int(bins.min()) - 1
    counts = np.bincount(bins - low, weights=votes[chosen], minlength=int(bins.max()) - low + 2)
    smooth = np.convolve(counts, [1.0, 1.0, 1.0], "same")
    padded = np.pad(smooth, 1)
    peaks: Bools = (smooth >= padded[:-2]) & (smooth > padded[2:])
    order = sorted(np.flatnonzero(peaks).tolist(), key=lambda peak: -smooth[peak])[:MOST_CANDIDATES]
    near = [np.abs(distance - (peak + low) * BIN_M) <= 1.5 * BIN_M for peak in order]
    return [float(np.average(distance[close], weights=votes[close])) for close in near]


def _likeness(old: Elements, new: Elements) -> Floats:
    """How much alike (n, m) elements are but for their places: 0 for those of other kinds."""
    off = (new.sizes[None] - old.sizes[:, None]) / NEAR_SIZE_M
    tall_old, tall_new = (of.size_sigmas[:, 1] > NEAR_SIZE_M for of in (old, new))  # of no exact height
    off[..., 1] = np.where(tall_old[:, None] & tall_new[None], 0.0, off[..., 1])
    alike: Floats = (old.groups[:, None] == new.groups[None]) * np.exp(-0.5 * (off**2).sum(axis=2))
    texts_old, texts_new = np.array(old.texts, dtype=object), np.array(new.texts, dtype=object)
    both = (texts_old != "")[:, None] & (texts_new != "")[None]
    same = texts_old[:, None] == texts_new[None]
    return np.asarray(alike * np.where(both, np.where(same, SAME_TEXT, OTHER_TEXT), 1.0), dtype=np.float64)


def paired(old: Elements, new: Elements, placed: Floats, gate_m: float) -> Pairs:
    """Pairs of elements of one kind no further apart than `gate_m`, along no axis; together they are as near as can be.
    `placed` (n, 3): the old middles in the new frame. A coordinate that nobody measured counts for nothing as far as an
    element is long."""
    if not len(old) or not len(new):
        return ()
    distance = np.abs(new.middles[None] - placed[:, None])
    loose = np.hypot(old.middle_sigmas[:, None], new.middle_sigmas[None]) > NEAR_SIZE_M
    loose &= distance < np.maximum(old.sizes[:, None], new.sizes[None])
    cost = np.linalg.norm(np.where(loose, np.minimum(distance, 0.1 * gate_m), distance), axis=2)
    cost[old.groups[:, None] != new.groups[None]] = np.inf
    # to leave a pair of elements without partners costs the gate
    rows, columns = linear_sum_assignment(np.minimum(cost - gate_m, 0.0))
    return tuple((int(i), int(j)) for i, j in zip(rows, columns, strict=True) if cost[i, j] < gate_m)


def _score(old: Elements, new: Elements, pairs: Pairs, fitted: Fit, covers: Covers) -> tuple[float, float]:
    """The score of a reading, and the share of the smaller row that agrees."""
    rows, columns = np.array(pairs, dtype=np.int64).T
    placed = fitted.carried(old.middles)
    off = new.middles[columns] - placed[rows]
    agreement = _agreement(old, new, rows, columns, off)
    left = sum(
        cover.has(of.kinds[of.groups[k]][0], float(places[k, 0]), float(of.sizes[k, 0]))
        for of, numbers, places, cover in (
            (old, rows, placed, covers[1]),
            (new, columns, fitted.carried_back(new.middles), covers[0]),
        )
        for k in set(range(len(of))) - set(numbers.tolist())
    )
    share = float((agreement > 0.5).sum()) / max(min(len(old), len(new)), 1)
    return float(agreement.sum()) - UNPAIRED * left, share


def _agreement(old: Elements, new: Elements, rows: Ints, columns: Ints, off: Floats) -> Floats:
    """How well pairs (n,) whose middles are `off` (n, 3) m agree, 0 to 1, more where texts do."""
    loose = np.hypot(old.middle_sigmas[rows], new.middle_sigmas[columns]) > NEAR_SIZE_M
    near: Floats = np.exp(-0.5 * (np.where(loose, 0.0, off / NEAR_M) ** 2).sum(axis=1))
    return near * _likeness(old, new)[rows, columns]
