"""What of two rows, once one lies in the other's frame, is as it was, moved, changed, new, missing or not seen; and by
how much more one map measures than the other.

Each figure of a pair is tested against its standard deviation with Student's t. Over all figures of all elements of
both maps, the share of false ones among those that are called changes is kept under the level (Benjamini and Hochberg
1995).

A scale that all elements of a row have in common says nothing of any one of them, so that the fit takes it out. It does
say that one of the maps rests on a wrong reference, such as a camera's height that is off by a hand's breadth. It is
estimated free of any prior; its variance is that of the fit, and what the errors that either map's elements share make
of it, by that map's joint covariance.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import ndtr, stdtr

from savmap.apps.dates.comparison.elements import LEAN, Coverage, Elements, measured, sides
from savmap.apps.dates.comparison.motion import LEAST_SCALE, SCALE, Equations, Fit, Pairs
from savmap.apps.dates.comparison.records import Difference, ElementChange, ScaleDifference, State
from savmap.types import Floats, Measured, RowMap, Structure

AXES = ("x", "y", "z")
LEAST_P = 1e-12
EQUAL_M = 1e-5
SCALE_P = 2 * float(ndtr(-3.0))
"""A scale stands out beyond three standard deviations."""
LEAST_LEVER_M = 1.0


def pairs_compared(
    old: Elements, new: Elements, pairs: Pairs, fit: Fit, sizes_only: bool = False
) -> Iterator[ElementChange]:
    """The elements that both maps have, with all that is tested of them; states are given by `with_states`. A figure
    that all of a kind share says nothing of one of them."""
    tests: dict[int, list[int]] = {}
    shared = fit.shared
    for k, pair in enumerate(fit.equations.pair.tolist()):
        if fit.equations.size[k] or (not sizes_only and not shared[k]):
            tests.setdefault(pair, []).append(k)
    carried = fit.carried(old.middles)
    for number, (i, j) in enumerate(pairs):
        before, after = old.structures[i], new.structures[j]
        differences = [_difference(fit, k, (old, i), (new, j), carried[i]) for k in tests.get(number, [])]
        if not sizes_only:
            differences += _of_text_and_attributes(old, new, i, j)
        p = min((difference.p for difference in differences), default=1.0)
        plugin, label = new.kinds[new.groups[j]]
        text = new.texts[j] or old.texts[i]
        texts, place, is_post = (before.id, after.id, text), new.middles[j], not sizes_only and new.is_post(j)
        yield ElementChange(plugin, label, "same", *texts, place, tuple(differences), p, is_post)


def _difference(fit: Fit, k: int, old: tuple[Elements, int], new: tuple[Elements, int], carried: Floats) -> Difference:
    """What the equation `k` says of a pair of elements; `carried` (3,): the old middle in the new frame."""
    axis, size = int(fit.equations.axis[k]), bool(fit.equations.size[k])
    residual, sigma = float(fit.residual[k]), float(fit.sigma[k])
    ends = [(float(of.middles[i, axis]), float(of.sizes[i, axis])) for of, i in (old, new)]
    edges = tuple(end for middle, extent in ends for end in (middle - extent / 2, middle + extent / 2))
    before, after = (ends[0][1], ends[1][1]) if size else (float(carried[axis]), ends[1][0])
    p = 2 * float(stdtr(fit.freedom[k], -abs(residual) / sigma))
    what = f"size {AXES[axis]}" if size else AXES[axis]
    return Difference(what, before, after, max(p, LEAST_P), residual, sigma, edges=edges)


def _of_text_and_attributes(old: Elements, new: Elements, i: int, j: int) -> Iterator[Difference]:
    """What is written on both, the chance that k letters are misread being taken for that of one to the power of k;
    figures in metres with a standard deviation that are no side of the element, whose sides are tested as such; and how
    far both lean, where both maps know it."""
    before, after = old.texts[i], new.texts[j]
    if before and after:
        p = min(1.0, float(old.misread[i] + new.misread[j])) ** _edits(before, after)
        yield Difference("text", before, after, max(p, LEAST_P))
    earlier = measured(old.structures[i])
    for name, (value, sigma) in measured(new.structures[j]).items():
        if name in earlier and not (np.abs(new.sizes[j] - value) < 1e-3).any():
            yield _tested(name, Measured(*earlier[name]), Measured(value, sigma))
    leant, leans = old.structures[i].attributes.get(LEAN), new.structures[j].attributes.get(LEAN)
    if isinstance(leant, Measured) and isinstance(leans, Measured) and leant.sigma + leans.sigma > 0:
        yield _tested(LEAN, leant, leans)


def _edits(a: str, b: str) -> int:
    """The least number of letters to put in, take out or replace (Levenshtein)."""
    line = list(range(len(b) + 1))
    for i, letter in enumerate(a, 1):
        above, line[0] = line[0], i
        for j, other in enumerate(b, 1):
            above, line[j] = line[j], min(line[j] + 1, line[j - 1] + 1, above + (letter != other))
    return line[-1]


def _tested(name: str, old: Measured, new: Measured) -> Difference:
    """A figure on both dates, whose errors are normal and independent."""
    by, sigma = new.value - old.value, float(np.hypot(old.sigma, new.sigma))
    return Difference(name, old.value, new.value, max(2 * float(ndtr(-abs(by) / sigma)), LEAST_P), by, sigma)


def unpaired(
    elements: Elements, paired: Iterable[int], placed: Floats, shown: Floats, cover: Coverage, state: State
) -> Iterator[ElementChange]:
    """The elements of one map that have no partner: `state` where the other map's plugin would have seen them.
    `placed` (n, 3): their middles in the other map's frame; `shown` (n, 3): in the new map's."""
    for k in sorted(set(range(len(elements))) - set(paired)):
        structure, (plugin, label) = elements.structures[k], elements.kinds[elements.groups[k]]
        seen = cover.has(plugin, float(placed[k, 0]), float(elements.sizes[k, 0]))
        old_id, new_id = (None, structure.id) if state == "new" else (structure.id, None)
        shown_state: State = state if seen else "not seen"
        yield ElementChange(plugin, label, shown_state, old_id, new_id, elements.texts[k], shown[k])


def with_states(rows: Sequence[Sequence[ElementChange]], level: float) -> list[tuple[ElementChange, ...]]:
    """The elements of each row with their states; the figures of all of them are one family of tests. Figures of a
    row's elements that end at the same edges in both maps are one."""
    chances: dict[tuple[object, ...], float] = {}
    for number, row in enumerate(rows):
        for k, change in enumerate(row):
            for figure in change.differences:
                test: tuple[object, ...] = number, k, figure.what
                if figure.edges:
                    test = number, figure.what, *(round(edge / EQUAL_M) for edge in figure.edges)
                chances[test] = min(figure.p, chances.get(test, 1.0))
    limit = accepted(list(chances.values()), level)
    shares = chance_shares(list(chances.values()))
    return [tuple(_with_state(change, limit, shares) for change in row) for row in rows]


def _with_state(change: ElementChange, limit: float, shares: tuple[Floats, Floats]) -> ElementChange:
    numbers = np.searchsorted(shares[0], [figure.p for figure in change.differences]).tolist()
    marked = tuple(
        replace(figure, significant=figure.p <= limit, q=float(shares[1][number]))
        for figure, number in zip(change.differences, numbers, strict=True)
    )
    significant = [difference.what for difference in marked if difference.significant]
    state: State = "changed" if significant else change.state
    return replace(change, differences=marked, state="moved" if set(significant) & set(AXES) else state)


def accepted(chances: Sequence[float], level: float) -> float:
    """The largest p that is significant at a false discovery rate (Benjamini and Hochberg); -1 if none is."""
    ordered = np.sort(np.array(chances, dtype=np.float64))
    below = ordered <= level * np.arange(1, len(ordered) + 1) / max(len(ordered), 1)
    return float(ordered[below][-1]) if below.any() else -1.0


def chance_shares(chances: Sequence[float]) -> tuple[Floats, Floats]:
    """The p (n + 1,), rising to 1, and for each the false discovery rate (n + 1,) at which it is just significant
    (Benjamini and Hochberg's adjusted p)."""
    ordered = np.sort(np.array([*chances, 1.0], dtype=np.float64))
    adjusted = ordered * max(len(chances), 1) / np.arange(1, len(ordered) + 1)
    least = np.minimum.accumulate(adjusted[::-1])[::-1]
    return ordered, np.minimum(least, 1.0)


def scale_differences(
    fit: Fit, pairs: Pairs, old: tuple[Elements, RowMap], new: tuple[Elements, RowMap]
) -> tuple[ScaleDifference, ...]:
    """The scales along x and y of a fit without a prior of them; none along an axis on which nothing is far enough away
    to tell. Whether they are significant is said by `with_significance`."""
    rows, columns = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    freedom = float(fit.freedom.min())
    scales = []
    for axis, name in ((0, "x"), (1, "y")):
        before = _map_sigma(fit, axis, *old, rows.tolist(), fit.turned)
        after = _map_sigma(fit, axis, *new, columns.tolist(), False)
        if before is None or after is None:
            continue
        variance = float(fit.covariance[SCALE, SCALE][axis, axis]) + LEAST_SCALE**2
        share, sigma = float(fit.unknowns[SCALE][axis]), float(np.sqrt(variance + before**2 + after**2))
        p = 2 * float(stdtr(freedom, -abs(share) / sigma))
        scales.append(ScaleDifference(name, share, sigma, before, after, max(p, LEAST_P)))
    return tuple(scales)


def _map_sigma(
    fit: Fit, axis: int, elements: Elements, row: RowMap, chosen: Sequence[int], turned: bool
) -> float | None:
    """The standard deviation of a map's scale along an axis, by the fit's equations; None where nothing tells."""
    equations = fit.equations
    lever = np.abs(equations.slopes[:, SCALE][:, axis])
    far = (equations.axis == axis) & ~equations.size & (lever > LEAST_LEVER_M)
    if not far.any():
        return None
    if row.joint is not None:
        solved, independent = np.zeros(len(row.joint.covariance)), 0.0
        for pair, k in enumerate(chosen):
            structure = elements.structures[k]
            weights = _vertex_weights(equations, fit.gain[SCALE][axis], pair, structure, turned)
            numbers = row.joint.coordinates.get(elements.kinds[elements.groups[k]][0], {}).get(structure.id)
            of_joint = np.zeros(weights.shape, dtype=np.bool_) if numbers is None else numbers >= 0
            if numbers is not None:
                np.add.at(solved, numbers[of_joint], weights[of_joint])
            spread = np.diagonal(structure.covariances, axis1=1, axis2=2)
            independent += float(np.sum((weights**2 * spread)[~of_joint]))
        return float(np.sqrt(max(float(solved @ row.joint.covariance @ solved), 0.0) + independent))
    rates = elements.middle_sigmas[np.asarray(chosen)[equations.pair[far]], axis] / lever[far]
    return float(np.median(rates))


def _vertex_weights(equations: Equations, gain: Floats, pair: int, structure: Structure, turned: bool) -> Floats:
    """How much (n, 3) each coordinate of a structure's vertices counts in the figure."""
    weights = np.zeros(structure.vertices.shape)
    low, high = sides(structure.vertices)
    for k in np.flatnonzero(equations.pair == pair):
        axis, share = int(equations.axis[k]), float(gain[k]) / len(low)
        if equations.size[k]:
            ends = -share, share
        else:
            ends = (-share / 2, -share / 2) if turned and axis != 1 else (share / 2, share / 2)
        np.add.at(weights[:, axis], low[:, axis], ends[0])
        np.add.at(weights[:, axis], high[:, axis], ends[1])
    return weights


def stands_out(scales: Sequence[ScaleDifference]) -> bool:
    """Whether any of these scales, by itself, is beyond what both maps know."""
    return any(scale.p <= SCALE_P for scale in scales)


def with_significance(rows: Sequence[Sequence[ScaleDifference]], level: float) -> list[tuple[ScaleDifference, ...]]:
    """The scales of each row with what is significant of them: beyond three standard deviations, and, of all rows'
    scales together, with no more than a share of `level` that is chance."""
    limit = min(accepted([scale.p for row in rows for scale in row], level), SCALE_P)
    return [tuple(replace(scale, significant=scale.p <= limit) for scale in row) for row in rows]
