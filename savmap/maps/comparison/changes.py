"""What of two rows, once one lies in the other's frame, is as it was, moved, changed, new, missing or not seen.

Each figure of a pair is tested against its own standard deviation with Student's t. Over all figures of all elements of
both maps, the share of false ones among those that are told is kept under the level (Benjamini and Hochberg 1995).
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import t as student

from savmap.maps.comparison.elements import Coverage, Elements, measured
from savmap.maps.comparison.motion import Fit, Pairs
from savmap.maps.comparison.records import Difference, ElementChange, State
from savmap.types import Floats, Structure

AXES = ("x", "y", "z")
LEAST_P = 1e-12
EQUAL_M = 1e-5


def pairs_compared(
    old: Elements, new: Elements, pairs: Pairs, found: Fit, sizes_only: bool = False
) -> Iterator[ElementChange]:
    """The elements that both maps have, with all that is tested of them; states are given by `judged`."""
    tests = _tests(found, sizes_only)
    carried = found.carried(old.middles)
    for number, (i, j) in enumerate(pairs):
        before, after = old.structures[i], new.structures[j]
        differences = [
            replace(
                _difference(found, k, carried[i], old.sizes[i], new.middles[j], new.sizes[j]),
                edges=_edges(int(found.equations.axis[k]), (old, i), (new, j)),
            )
            for k in tests.get(number, [])
        ]
        if not sizes_only:
            differences += [*_text(old, new, i, j), *_attributes(before, after, new.sizes[j])]
        p = min((one.p for one in differences), default=1.0)
        plugin, label = new.kinds[new.groups[j]]
        text = new.texts[j] or old.texts[i]
        yield ElementChange(plugin, label, "same", before.id, after.id, text, new.middles[j], tuple(differences), p)


def _tests(found: Fit, sizes_only: bool) -> Mapping[int, list[int]]:
    """The numbers of the equations of each pair; a figure that all of a kind share says nothing of one of them."""
    tests: dict[int, list[int]] = {}
    for k, pair in enumerate(found.equations.pair.tolist()):
        if found.equations.size[k] or (not sizes_only and not found.shared[k]):
            tests.setdefault(pair, []).append(k)
    return tests


def _difference(found: Fit, k: int, carried: Floats, old_size: Floats, middle: Floats, size: Floats) -> Difference:
    axis = int(found.equations.axis[k])
    residual, sigma = float(found.residual[k]), float(found.sigma[k])
    old, new = (old_size, size) if found.equations.size[k] else (carried, middle)
    p = 2 * float(student.sf(abs(residual) / sigma, found.freedom[k]))
    what = f"size {AXES[axis]}" if found.equations.size[k] else AXES[axis]
    return Difference(what, float(old[axis]), float(new[axis]), max(p, LEAST_P), residual, sigma)


def _edges(axis: int, *elements: tuple[Elements, int]) -> tuple[float, ...]:
    """Where an element's two edges across an axis lie in each map, m."""
    ends = [(float(of.middles[k, axis]), float(of.sizes[k, axis]) / 2) for of, k in elements]
    return tuple(end for middle, half in ends for end in (middle - half, middle + half))


def _text(old: Elements, new: Elements, i: int, j: int) -> Iterator[Difference]:
    """What is written on both. The chance that k letters are misread is taken for that of one to the power of k."""
    before, after = old.texts[i], new.texts[j]
    if before and after:
        letters = _edits(before, after)
        p = min(1.0, float(old.misread[i] + new.misread[j])) ** letters
        yield Difference("text", before, after, max(p, LEAST_P))


def _edits(a: str, b: str) -> int:
    """The least number of letters to put in, take out or replace (Levenshtein)."""
    line = list(range(len(b) + 1))
    for i, letter in enumerate(a, 1):
        above, line[0] = line[0], i
        for j, other in enumerate(b, 1):
            above, line[j] = line[j], min(line[j] + 1, line[j - 1] + 1, above + (letter != other))
    return line[-1]


def _attributes(before: Structure, after: Structure, size: Floats) -> Iterator[Difference]:
    """Figures in metres with a standard deviation that are no side of the element, whose sides are tested as such."""
    known = measured(before)
    for name, (value, sigma) in measured(after).items():
        if name in known and not (np.abs(size - value) < 1e-3).any():
            old, old_sigma = known[name]
            both = float(np.hypot(sigma, old_sigma))
            p = 2 * float(student.sf(abs(value - old) / both, np.inf))
            yield Difference(name, old, value, max(p, LEAST_P), value - old, both)


def unpaired(
    elements: Elements, paired: Iterable[int], placed: Floats, shown: Floats, cover: Coverage, state: State
) -> Iterator[ElementChange]:
    """The elements of one map that have no partner: `state` where the other map's plugin would have found them.
    `placed` (n, 3): their middles in the other map's frame; `shown` (n, 3): in the new map's."""
    known = set(paired)
    for k, structure in enumerate(elements.structures):
        if k in known:
            continue
        plugin, label = elements.kinds[elements.groups[k]]
        seen = cover.has(plugin, float(placed[k, 0]), float(elements.sizes[k, 0]))
        old_id, new_id = (None, structure.id) if state == "new" else (structure.id, None)
        told: State = state if seen else "not seen"
        yield ElementChange(plugin, label, told, old_id, new_id, elements.texts[k], shown[k])


def judged(rows: Sequence[Sequence[ElementChange]], level: float) -> list[tuple[ElementChange, ...]]:
    """The elements of each row with their states; the figures of all of them are one family of tests."""
    chances: dict[tuple[object, ...], float] = {}
    for number, row in enumerate(rows):
        for k, change in enumerate(row):
            for one in change.differences:
                test = _test(number, k, one)
                chances[test] = min(one.p, chances.get(test, 1.0))
    limit = accepted(list(chances.values()), level)
    return [tuple(_judged(change, limit) for change in row) for row in rows]


def _test(row: int, element: int, figure: Difference) -> tuple[object, ...]:
    """What tells a test from the others: figures of a row's elements that end at the same edges in both maps are
    one."""
    if not figure.edges:
        return row, element, figure.what
    return row, figure.what, *(round(one / EQUAL_M) for one in figure.edges)


def accepted(chances: Sequence[float], level: float) -> float:
    """The largest p that is significant at a false discovery rate (Benjamini and Hochberg); -1 if none is."""
    ordered = np.sort(np.array(chances, dtype=np.float64))
    below = ordered <= level * np.arange(1, len(ordered) + 1) / max(len(ordered), 1)
    return float(ordered[below][-1]) if below.any() else -1.0


def _judged(change: ElementChange, limit: float) -> ElementChange:
    marked = tuple(replace(one, significant=one.p <= limit) for one in change.differences)
    told = [one.what for one in marked if one.significant]
    moved = any(what in AXES for what in told)
    return replace(change, differences=marked, state="moved" if moved else "changed" if told else change.state)
