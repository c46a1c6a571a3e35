"""Two maps of one place compared: rows by name, each row's frame found anew in the other's, and every element of
both."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from savmap.maps.comparison.changes import judged, pairs_compared, unpaired
from savmap.maps.comparison.elements import Elements, coverage_of, elements_of, kinds_of
from savmap.maps.comparison.motion import HEADING, SCALE, T, fit, half_turn
from savmap.maps.comparison.readings import GATE_M, Reading, best_readings, paired
from savmap.maps.comparison.records import Comparison, ElementChange, RowComparison, RowMotion, ScaleDifference
from savmap.maps.comparison.scales import judged_scales, scale_differences, stands_out
from savmap.types import RowMap, SiteMap, Structure

MOST_RENAMED, RENAMED_SHARE = 9, 0.8
LEVEL = 0.1
"""Of what is told as a change, at most this share is chance."""
Openings = Mapping[str, Mapping[str, Sequence[Structure]]]
"""By row and plugin, what is between structures, such as the clear space of which somebody cares how wide and high it
is."""


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
    return Comparison(tuple(_all_judged(rows, level)), missing, added, level, failed, renamed)


def _renamed(old: SiteMap, new: SiteMap, missing: Sequence[str], added: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Rows that only one map has, in which nearly all is alike: by both names. Where there are many, nobody can tell
    which is which."""
    if len(missing) * len(added) > MOST_RENAMED:
        return
    for name, other in product(missing, added):
        kinds = kinds_of(old.rows[name].structures, new.rows[other].structures)
        before, after = (elements_of(row.structures, kinds) for row in (old.rows[name], new.rows[other]))
        covers = coverage_of(old.rows[name], before), coverage_of(new.rows[other], after)
        best = best_readings(before, after, covers)
        if best and best[0].share > RENAMED_SHARE:
            yield name, other


def _all_judged(rows: Sequence[RowComparison], level: float) -> list[RowComparison]:
    """Elements of all rows are one family of tests, openings another, and scales a third."""
    elements = judged([row.elements for row in rows], level)
    openings = judged([row.openings for row in rows], level)
    scales = judged_scales([row.scales for row in rows], level)
    return [
        replace(row, elements=of_elements, openings=of_openings, scales=of_scale)
        for row, of_elements, of_openings, of_scale in zip(rows, elements, openings, scales, strict=True)
    ]


def _row_compared(
    before: RowMap,
    after: RowMap,
    openings: tuple[Mapping[str, Sequence[Structure]], Mapping[str, Sequence[Structure]]],
) -> RowComparison:
    kinds = kinds_of(before.structures, after.structures)
    old, new = elements_of(before.structures, kinds), elements_of(after.structures, kinds)
    covers = coverage_of(before, old), coverage_of(after, new)
    readings = best_readings(old, new, covers)
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
    """Openings on both dates, paired where the rows' elements place them. Their sizes have errors in common of their
    own; `scaled`: the maps' scales differ by more than they know."""
    kinds = kinds_of(before, after)
    old, new = elements_of(before, kinds), elements_of(after, kinds)
    pairs = paired(old, new, reading.fit.carried(old.middles), GATE_M)
    if not pairs:
        return []
    found = fit(old, new, pairs, reading.fit.turned, free_scale=scaled)
    return list(pairs_compared(old, new, pairs, found, sizes_only=True))


def _motion(best: Reading, others: Sequence[Reading]) -> RowMotion:
    """The motion of the row's frame, from that about the row's middle."""
    found = best.fit
    turn, half = float(found.unknowns[HEADING]), np.pi if found.turned else 0.0
    lever = half_turn(np.zeros((1, 3)), found.turned)[0] - found.about
    middle = found.about + found.unknowns[T]
    shift = middle + np.array([lever[0] + turn * lever[2], lever[1], lever[2] - turn * lever[0]])
    chosen = [0, 1, 2, HEADING]
    units = np.diag([1.0, 1.0, 1.0, float(np.degrees(1.0))])
    covariance = units @ found.covariance[np.ix_(chosen, chosen)] @ units
    scale = np.array([*found.unknowns[SCALE], 0.0])
    others_m = tuple(float(one.shift_m - best.shift_m) for one in others)
    return RowMotion(shift, float(np.degrees(turn + half)), covariance, scale, middle, len(best.pairs), others_m)
