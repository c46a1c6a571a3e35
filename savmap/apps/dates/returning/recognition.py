"""Where along which mapped row another pass is, by the sequence of what it shows.

The new pass is mapped up to scale. A hypothesis says which row it shows and lays it there: x and y of the row are one
scale times those of the pass, and a shift. Each interval between neighbours of one kind (posts, lamps) that may be an
interval of the mapped row gives one, which the elements of all kinds refine. Its log-likelihood sums, over elements,

    log N(residual; sigma) against a uniform density     of pairs, a few of which moved,
    log rate                                             of elements of either map that the other should have shown,
    log of the texts' agreement                          of what is written on pairs,
    log chance that the row goes on beyond its map       where the pass shows more; it may go on as it is elsewhere.

Hypotheses have equal prior probabilities, as has that the pass shows no row of the map.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from savmap.apps.dates.comparison.elements import Coverage, Elements, coverage_of, elements_of, kinds_of
from savmap.errors import StructureError
from savmap.types import Bools, Floats, Ints, RowMap, RowPlace, array_record

SURE = 0.99
"""Only a place that is as probable is taken."""
NAMED, LEAST_NAMED = 4, 0.005
"""Candidates that a refusal names: so many, and so probable at least."""
MISSING, MOVED = 0.03, 0.03
"""Shares of elements that one map lacks though its camera passed them, and that stand elsewhere now."""
FIRST_SIGMA_M, LEAST_SIGMA_M, MOST_SIGMA_M = 0.02, 0.003, 0.02
"""Of a residual: before anything is fitted; at least, as what is installed alike scatters; at most."""
MOVED_M, SPREAD_M = 0.15, np.array([1.0, 0.5])
"""How far moved elements are off, about, and the range along x and y in which an element of the kind may be."""
EQUAL_TEXT, OTHER_TEXT = 4.0, -3.0
"""Log-likelihood ratios of texts that agree and that differ: labels are replaced, and misread."""
TEMPER = 0.4
"""Weight of the residuals' log-likelihood: errors of neighbours go together, so that they are fewer than they seem."""
LOWEST_SCALE, HIGHEST_SCALE = 0.2, 5.0
EVEN_SCALE = 0.003
"""How much scales along x and y of two maps differ, about."""
GATE_M = np.array([0.3, 0.2])
MEASURED_M, SAME_M, BIN_M = 0.15, 0.003, 0.05
PROMISING, MOST_PLACES, ROUNDS, TUKEY = 0.34, 4000, 3, 5.0
NARROW_M, NARROW_REACH = 0.5, 2.0
"""An element that is no wider is seen whole from twice as far ahead or behind as a wide one."""
GOES_ON, CUT, PAST_M, ELSEWHERE_M = 0.003, 0.5, 0.3, 0.5
"""The chance that a row goes on beyond an end of its map that the camera went past, by so much; and beyond another one.
What is no further from one another is one place."""
HOPELESS = 100.0
"""A hypothesis whose log-likelihood is less by this with a coarse scatter is not looked at with the right one."""


@dataclass(frozen=True, eq=False)
class Shown:
    """The elements of a row, the part of it that its camera passed, and from where to where along x, m, that went."""

    elements: Elements
    cover: Coverage
    path: tuple[float, float]

    @cached_property
    def of_own_edges(self) -> Bools:
        """Whether each element's place (n,) along x is a measurement of its own: what ends at edges of smaller ones is
        not."""
        elements = self.elements
        counted = np.ones(len(elements), dtype=np.bool_)
        edges: set[int] = set()
        for k in np.argsort(elements.sizes[:, 0], kind="stable").tolist():
            x, half = elements.middles[k, 0], elements.sizes[k, 0] / 2
            both = {round((x - half) / SAME_M), round((x + half) / SAME_M)}
            counted[k] = not any(edge + step in edges for edge in both for step in (-1, 0, 1))
            edges |= both
        return counted

    @cached_property
    def of_most(self) -> Bools:
        """Which elements (n,) are of the plugin that mapped most of them."""
        plugins = self.elements.plugins
        names, counts = np.unique(plugins, return_counts=True)
        return np.asarray(plugins == names[counts.argmax()]) if len(names) else np.zeros(0, dtype=np.bool_)

    def within(self, low: float, high: float) -> "Shown":
        """Without what lies outside of a range along x, m."""
        x = self.elements.middles[:, 0]
        return replace(self, elements=_chosen(self.elements, np.flatnonzero((x >= low) & (x <= high))))


@dataclass(frozen=True, eq=False)
@array_record
class Laid:
    """A hypothesis while it is refined: scales and shifts (2,) along x and y, and the pairs (k, 2)."""

    scales: Floats
    shifts: Floats
    pairs: Ints
    information: Floats

    def placed(self, middles: Floats) -> Floats:
        """Middles (n, 3) of the pass, in the row (n, 2)."""
        placed: Floats = middles[:, :2] * self.scales + self.shifts
        return placed


@dataclass(frozen=True, eq=False)
@array_record
class Scored:
    """A hypothesis: its place, and for the n elements of the pass what each pair gains (n,), its partner's x (n,) m
    (both NaN without a partner), which (n,) are beyond the mapped part of the row, and the log-probability that the row
    goes on there."""

    place: RowPlace
    gains: Floats
    partners: Floats
    beyond: Bools
    goes_on: float


def recognised(seen: RowMap, rows: Mapping[str, RowMap]) -> RowPlace:
    """The one place of a pass, mapped in any scale, among mapped rows by name. Raises StructureError where it could be
    at several, which it names, or where it is of no row."""
    places = likely_places(seen, rows)
    best = places[0][0] if places else None
    if best is not None and places[0][1] > SURE:
        mapped = rows[best.row]
        sigmas = elements_of(mapped.structures, kinds_of(mapped.structures)).middle_sigmas[:, 1]
        measured = sigmas[sigmas < MEASURED_M]
        return replace(best, height_sigma_m=float(np.median(measured)) if len(measured) else np.nan)
    rows_text = f"row {next(iter(rows))}" if len(rows) == 1 else "any row of the earlier map"
    if best is None:
        raise StructureError(
            f"row {seen.name}: what the pass shows does not look like {rows_text}; check that it is of the same place "
            "and the same face, or map it without --against"
        )
    named = [f"{place.ends} (P {probability:.2f})" for place, probability in places if probability > LEAST_NAMED]
    more = f" and {len(named) - NAMED} more" if len(named) > NAMED else ""
    raise StructureError(
        f"row {seen.name}: the pass looks alike at several places of the earlier map: row "
        f"{'; row '.join(named[:NAMED])}{more}; name the row with --row, or film more of it: past an end, or something "
        "that is unlike the rest, such as a text"
    )


def likely_places(seen: RowMap, rows: Mapping[str, RowMap]) -> list[tuple[RowPlace, float]]:
    """Places of a pass among mapped rows with their probabilities, the most probable first; what is missing to a sum of
    1 is the probability that it is of no row."""
    kinds = kinds_of(seen.structures, *(row.structures for row in rows.values()))
    here = _shown(seen, kinds)
    mapped = {name: _shown(row, kinds) for name, row in rows.items()}
    laid = [(name, other, item) for name, other in mapped.items() for item in _laid(here, other)]
    if not laid:
        return []
    first = [_scored(here, *hypothesis, FIRST_SIGMA_M) for hypothesis in laid]
    likeliest = max(first, key=lambda scored: scored.place.score).place
    sigma = float(np.clip(likeliest.scatter_m, LEAST_SIGMA_M, MOST_SIGMA_M))
    near = [item for item, scored in zip(laid, first, strict=True) if scored.place.score > likeliest.score - HOPELESS]
    every = [_scored(here, *hypothesis, sigma) for hypothesis in near]
    best: dict[tuple[str, tuple[str, str, str]], RowPlace] = {}
    for place in (place for name in mapped for place in _extended([s for s in every if s.place.row == name])):
        key = place.row, place.pairs[0]
        if key not in best or place.score > best[key].score:
            best[key] = place
    distinct = _distinct(sorted(best.values(), key=lambda place: -place.score))
    scores = np.array([0.0, *(place.score for place in distinct)])
    weights = np.exp(scores - scores.max())
    return [
        (place, float(weight))
        for place, weight in zip(distinct, (weights / weights.sum())[1:], strict=True)
        if place.score > 0
    ]


def _distinct(places: Sequence[RowPlace]) -> list[RowPlace]:
    """The places, the best first, without those that pair the same elements as a better one."""
    kept: list[RowPlace] = []
    taken: set[tuple[str, tuple[str, str, str]]] = set()
    for place in places:
        pairs = {(place.row, pair) for pair in place.pairs}
        if len(pairs & taken) <= len(pairs) / 2:
            kept.append(place)
        taken |= pairs
    return kept


def _shown(row: RowMap, kinds: Sequence[tuple[str, str]]) -> Shown:
    elements = elements_of(row.structures, kinds)
    x = row.trajectory.world_from_rig[:, 0, 3]
    return Shown(elements, coverage_of(row, elements), (float(x.min(initial=np.inf)), float(x.max(initial=-np.inf))))


def _chosen(elements: Elements, numbers: Ints) -> Elements:
    return Elements(
        tuple(elements.structures[k] for k in numbers),
        elements.kinds,
        elements.groups[numbers],
        elements.middles[numbers],
        elements.middle_sigmas[numbers],
        elements.sizes[numbers],
        elements.size_sigmas[numbers],
        tuple(elements.texts[k] for k in numbers),
        elements.misread[numbers],
    )


def _laid(here: Shown, other: Shown) -> Iterator[Laid]:
    """The hypotheses that an interval between neighbours of one kind suggests, refined by all elements."""
    for scale, shift in _first_places(here.elements, other.elements):
        x = scale * here.elements.middles[:, 0] + shift
        near = other.within(float(x.min()) - GATE_M[0], float(x.max()) + GATE_M[0])
        laid = _refined(here.elements, near.elements, scale, shift)
        if laid is not None:
            numbers = {structure.id: k for k, structure in enumerate(other.elements.structures)}
            pairs = [(i, numbers[near.elements.structures[j].id]) for i, j in laid.pairs.tolist()]
            yield replace(laid, pairs=np.array(pairs, np.int64))


def _first_places(here: Elements, other: Elements) -> list[tuple[float, float]]:
    """Scales and shifts along x by which intervals between neighbours of one kind fall on one another, and many
    elements of that kind with them; each place once."""
    chosen: dict[tuple[int, int], tuple[float, float, float]] = {}
    for group in np.intersect1d(here.groups, other.groups).tolist():
        seen, mapped = (_distinct_x(of.middles[of.groups == group, 0]) for of in (here, other))
        if len(seen) < 2 or len(mapped) < 2:
            continue
        scales, shifts = _by_intervals(seen, mapped)
        agreement = _agreement(seen, mapped, scales, shifts) / len(seen)
        middle = float(here.middles[:, 0].mean())
        bins = np.round(np.log(scales) / 0.02), np.round((scales * middle + shifts) / GATE_M[0])
        for key, score, scale, shift in zip(zip(*bins, strict=True), agreement, scales, shifts, strict=True):
            place = int(key[0]), int(key[1])
            if score >= chosen.get(place, (0.0,))[0]:
                chosen[place] = float(score), float(scale), float(shift)
    best = max((score for score, *_ in chosen.values()), default=0.0)
    ordered = sorted(chosen.values(), reverse=True)[:MOST_PLACES]
    return [(scale, shift) for score, scale, shift in ordered if score >= PROMISING * best]


def _distinct_x(x: Floats) -> Floats:
    """Places along x, those that nearly are one as one."""
    ordered = np.sort(x)
    far = np.append(True, np.diff(ordered) > NARROW_M / 10)
    return np.asarray(ordered[far])


def _by_intervals(seen: Floats, mapped: Floats) -> tuple[Floats, Floats]:
    """Scales and shifts (k,) by which an interval of the places (n,) that are seen is one of those (m,) mapped. Of
    either, the next but one is a neighbour too, for one may be missing."""
    intervals = [
        np.array([(a[k], a[k + step]) for step in (1, 2) for k in range(len(a) - step)]) for a in (seen, mapped)
    ]
    ours, theirs = (np.repeat(intervals[0], len(intervals[1]), 0), np.tile(intervals[1], (len(intervals[0]), 1)))
    scales = np.diff(theirs, axis=1)[:, 0] / np.diff(ours, axis=1)[:, 0]
    within = (scales > LOWEST_SCALE) & (scales < HIGHEST_SCALE)
    shifts = theirs[:, 0] - scales * ours[:, 0]
    return scales[within], shifts[within]


def _agreement(seen: Floats, mapped: Floats, scales: Floats, shifts: Floats) -> Floats:
    """How many (k,) of the places that are seen fall on mapped ones, about."""
    x = scales[:, None] * seen + shifts[:, None]
    after = np.clip(np.searchsorted(mapped, x), 1, len(mapped) - 1)
    off = np.minimum(np.abs(x - mapped[after]), np.abs(x - mapped[after - 1]))
    near: Floats = np.exp(-0.5 * (off / (GATE_M[0] / 3)) ** 2).sum(axis=1)
    return near


def _refined(here: Elements, other: Elements, scale: float, shift: float) -> Laid | None:
    """A hypothesis with the scale and shifts that its pairs agree upon; None where there are too few."""
    height = _height_shift(here, other, scale, shift)
    if height is None:
        return None
    laid = Laid(np.array([scale, scale]), np.array([shift, height]), np.zeros((0, 2), np.int64), np.eye(4))
    for number in range(ROUNDS):
        pairs = _pairs(here, other, laid.placed(here.middles), GATE_M * (2.0 if number == 0 else 1.0))
        if len(pairs) < 3:
            return None
        laid = _fitted(here, other, pairs, scale)
        scale = float(laid.scales.mean())
    return laid


def _height_shift(here: Elements, other: Elements, scale: float, shift: float) -> float | None:
    """The shift along y that most pairs of elements of one kind vote for that fall on one another along x."""
    near = here.groups[:, None] == other.groups[None]
    near &= np.abs(scale * here.middles[:, None, 0] + shift - other.middles[None, :, 0]) < 2 * GATE_M[0]
    ours, theirs = _measured(here)[:, 1], _measured(other)[:, 1]
    near &= ours[:, None] & theirs[None]
    if not near.any():
        return None if ours.any() and theirs.any() else 0.0
    offsets = (other.middles[None, :, 1] - scale * here.middles[:, None, 1])[near]
    bins = np.round(offsets / BIN_M).astype(np.int64)
    counts = np.convolve(np.bincount(bins - bins.min()), [1, 2, 1], "same")
    peak = (int(counts.argmax()) + int(bins.min())) * BIN_M
    return float(np.median(offsets[np.abs(offsets - peak) < 2 * BIN_M]))


def _measured(elements: Elements) -> Bools:
    """Which coordinates x and y (n, 2) of elements' middles were measured: beyond what all are unsure by, they are
    known."""
    variances = elements.middle_sigmas[:, :2] ** 2
    return np.asarray(variances - variances.min(axis=0, initial=np.inf) < MEASURED_M**2)


def _pairs(here: Elements, other: Elements, placed: Floats, gate_m: Floats) -> Ints:
    """Pairs (k, 2) of elements of one kind, each the other's nearest within the gate."""
    off = np.abs(placed[:, None] - other.middles[None, :, :2]) / gate_m
    off[..., 1] = np.where(_measured(here)[:, None, 1] & _measured(other)[None, :, 1], off[..., 1], 0.0)
    distance = off.max(axis=2)
    distance[here.groups[:, None] != other.groups[None]] = np.inf
    if not distance.size:
        return np.zeros((0, 2), np.int64)
    best, back = distance.argmin(axis=1), distance.argmin(axis=0)
    rows = np.arange(len(distance))
    mutual = (back[best] == rows) & (distance[rows, best] < 1.0)
    return np.stack([rows[mutual], best[mutual]], axis=1)


def _fitted(here: Elements, other: Elements, pairs: Ints, scale: float) -> Laid:
    """Scales and shifts by robust least squares (Tukey's weights), nearly the same scale along both axes."""
    rows, columns = pairs.T
    measured = _measured(here)[rows] & _measured(other)[columns]
    slopes = np.zeros((2 * len(pairs) + 1, 4))
    slopes[: len(pairs), 0], slopes[: len(pairs), 2] = here.middles[rows, 0], 1.0
    slopes[len(pairs) : -1, 1], slopes[len(pairs) : -1, 3] = here.middles[rows, 1], 1.0
    slopes[-1, :2] = 1.0, -1.0
    values = np.append(other.middles[columns, :2].T.ravel(), 0.0)
    use = np.concatenate([measured[:, 0], measured[:, 1], [(FIRST_SIGMA_M / (EVEN_SCALE * scale)) ** 2]])
    weight, prior = use.copy(), np.diag([1e-12, 1e-12, 1e-9, 1e-9])
    unknowns: Floats = np.zeros(4)
    for _ in range(6):
        information = slopes.T @ (weight[:, None] * slopes) + prior
        unknowns = np.linalg.solve(information, slopes.T @ (weight * values))
        off = values - slopes @ unknowns
        spread = max(_scatter(off[:-1][measured.T.ravel()]), LEAST_SIGMA_M)
        weight = use * np.maximum(1 - (off / (TUKEY * spread)) ** 2, 0.02) ** 2
    return Laid(unknowns[:2], unknowns[2:], pairs, information / spread**2)


def _scored(here: Shown, name: str, other: Shown, laid: Laid, sigma: float) -> Scored:
    """A hypothesis with its score, where residuals scatter by `sigma`."""
    rows, columns = laid.pairs.T
    placed = laid.placed(here.elements.middles)
    off = other.elements.middles[columns, :2] - placed[rows]
    counted = _measured(here.elements)[rows] & _measured(other.elements)[columns]
    counted[:, 0] &= here.of_own_edges[rows]
    gains, partners = np.full((2, len(here.elements)), np.nan)
    gains[rows] = _gains(here.elements, other.elements, laid, off, counted, sigma)
    partners[rows] = other.elements.middles[columns, 0]
    missed, beyond = _unexplained(here, other, laid, placed)
    order = np.argsort(placed[rows, 0], kind="stable")
    ours, theirs = (of.elements.structures for of in (here, other))
    plugins = here.elements.plugins
    pairs = tuple((str(plugins[i]), ours[i].id, theirs[j].id) for i, j in laid.pairs[order].tolist())
    to_common = np.array([[0.5, 0.5, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    covariance = to_common @ np.linalg.inv(laid.information) @ to_common.T
    score = float(np.nansum(gains)) + missed * float(np.log(MISSING))
    place = RowPlace(name, float(laid.scales.mean()), laid.shifts, covariance, pairs, _scatter(off[counted]), score)
    return Scored(place, gains, partners, beyond, _goes_on(other, placed[beyond, 0]))


def _goes_on(mapped: Shown, x: Floats) -> float:
    """The log-probability that a row has elements at x (k,) m, where it was not mapped: small on a side where its
    camera went past the end."""
    middles, halves = mapped.elements.middles[:, 0], mapped.elements.sizes[:, 0] / 2
    of_most = mapped.of_most
    ends = float((middles - halves)[of_most].min()), float((middles + halves)[of_most].max())
    past = mapped.path[0] < ends[0] - PAST_M, mapped.path[1] > ends[1] + PAST_M
    middle = float(np.median(middles))
    sides = (x < middle).any(), (x > middle).any()
    return sum(
        float(np.log(GOES_ON if went_past else CUT)) for side, went_past in zip(sides, past, strict=True) if side
    )


def _extended(every: Sequence[Scored]) -> Iterator[RowPlace]:
    """The places of one row with what the pass shows beyond the mapped part of it: the row may go on there as it is
    elsewhere. How alike its parts are, the best of the other places tells than the best one."""
    ordered = sorted(every, key=lambda scored: -scored.place.score)
    others = (of for of in ordered[1:] if not (np.abs(ordered[0].partners - of.partners) < ELSEWHERE_M).any())
    alike = next((np.nan_to_num(other.gains, nan=0.0) for other in others), np.zeros(1))
    alike = np.broadcast_to(alike, ordered[0].gains.shape) if ordered else alike
    for scored in ordered:
        more = float(alike[scored.beyond].sum()) + scored.goes_on
        yield replace(scored.place, score=scored.place.score + more)


def _scatter(off: Floats) -> float:
    """The standard deviation of differences of which most are chance."""
    return 1.48 * float(np.median(np.abs(off))) if len(off) else MOST_SIGMA_M


def _gains(here: Elements, other: Elements, laid: Laid, off: Floats, counted: Bools, sigma: float) -> Floats:
    """The log-likelihood ratios (k,) of pairs that are `off` (k, 2) m from one another."""
    rows, columns = laid.pairs.T
    extra = np.hypot(laid.scales * _excess(here)[rows], _excess(other)[columns])
    spread = np.hypot(sigma, extra)
    stayed = (1 - MOVED) * _normal(off, spread) + MOVED * _normal(off, np.full_like(off, MOVED_M))
    ratio = np.where(counted, np.log(np.where(counted, stayed * SPREAD_M, 1.0)), 0.0).sum(axis=1)
    texts = [(here.texts[i], other.texts[j]) for i, j in laid.pairs.tolist()]
    written = np.array([(EQUAL_TEXT if a == b else OTHER_TEXT) if a and b else 0.0 for a, b in texts])
    return np.asarray(TEMPER * ratio + written + np.log(1 - MISSING))


def _normal(off: Floats, sigma: Floats) -> Floats:
    return np.asarray(np.exp(-0.5 * (off / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi)))


def _excess(elements: Elements) -> Floats:
    """What sigmas (n, 2) of middles are over twice the usual of their kind: these were seen worse."""
    excess = np.zeros((len(elements), 2))
    for group in np.unique(elements.groups):
        chosen = elements.groups == group
        variance = elements.middle_sigmas[chosen, :2] ** 2
        excess[chosen] = np.sqrt(np.maximum(variance - 4 * np.median(variance, axis=0), 0.0))
    return excess


def _unexplained(here: Shown, other: Shown, laid: Laid, placed: Floats) -> tuple[int, Bools]:
    """How many elements of either have no partner though the other's camera passed them; and which (n,) of the pass
    have none for the row was not mapped there, of the plugin that mapped most of the pass."""
    rows, columns = laid.pairs.T
    scale = float(laid.scales[0])
    sizes = scale * here.elements.sizes[:, 0]
    missed = _passed(here.elements, rows, placed[:, 0], sizes, other.cover)
    x, widths = other.elements.middles[:, 0], other.elements.sizes[:, 0]
    missing = _passed(other.elements, columns, x, widths, here.cover.moved(scale, float(laid.shifts[0])))
    beyond = ~missed & here.of_most
    beyond[rows] = False
    return int(missed.sum()) + int(missing.sum()), beyond


def _passed(elements: Elements, paired: Ints, x: Floats, sizes: Floats, cover: Coverage) -> Bools:
    """Which elements (n,) are not paired, though a camera passed them whole."""
    passed = np.zeros(len(elements), dtype=np.bool_)
    plugins = elements.plugins
    for plugin in sorted(set(plugins.tolist())):
        chosen = plugins == plugin
        reach = np.where(sizes[chosen] < NARROW_M, NARROW_REACH, 1.0)
        passed[chosen] = cover.shows(plugin, x[chosen], sizes[chosen], reach)
    passed[paired] = False
    return passed
