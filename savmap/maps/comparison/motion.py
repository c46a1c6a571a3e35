"""How one row's frame lies in another's: robust weighted least squares over the elements that both have.

Errors of a row's elements are not independent. What they have in common is estimated with the rigid motion, each with
the standard deviation that the maps' own covariances allow it: the scale along x and y, and for each kind of element an
offset of its middles and of its sizes (masks that are too wide, a setback that is only assumed). What is left is each
element's own error. Its scatter among all elements of a kind, most of which have not changed, is measured, since a map
holds covariances of single vertices, which do not tell how much of an error is common.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from savmap.maps.comparison.elements import Elements
from savmap.types import Bools, Floats, Ints, array_record

Pairs = tuple[tuple[int, int], ...]
Part = tuple[Ints, int, bool, Floats, Floats, Floats, Ints, Floats, Ints]
ROUNDS = 12
TUKEY = 6.0
LEAST_SIGMA_M = 0.001
"""Of a middle; of a size twice that. Labels, lips and shadows move an edge in the pictures by a millimetre, each date
anew."""
LEAST_SIZE_M = 0.02
FREE_M, FREE_RAD = 1e3, 1.0
LEAST_SCALE, FREE_SCALE = 0.0003, 0.3
FEW = 4
MEASURED_M, MEASURED_SHARE = 0.1, 0.02
"""A figure that is known no better than this, and this share of its distance from the row's middle, was not
measured."""
MAD = 1.4826
PEERS, EXCESS = 7, 2.0
SAME_M, SHARED_PART = 3e-5, 1 / 3
"""Differences that are the same, and the part of a kind that has the same one where it is no element's own."""
PRIOR_SHARE, PRIOR_COUNT, MOST_PRIOR = 0.5, 10.0, 2.0
INSIDE, FITTED = 3.0, 2.0
T, HEADING, SCALE = slice(0, 3), 3, slice(4, 6)


@dataclass(frozen=True, eq=False)
@array_record
class Equations:
    """m differences (m,) m, new less old, each of pair `pair` along `axis`, of a middle or of a size (`size`): their
    derivatives (m, k) by the unknowns, the standard deviations (m,) that the maps give, the kinds (m,) of like ones,
    the places (m,) m along their axis, and the families (m,) of one plugin's kinds along one axis."""

    pair: Ints
    axis: Ints
    size: Bools
    difference: Floats
    slopes: Floats
    sigma: Floats
    kind: Ints
    place: Floats
    family: Ints


@dataclass(frozen=True, eq=False)
@array_record
class Fit:
    """The solved equations: unknowns (k,) with covariance (k, k), the point (3,) m about which the row is turned and
    scaled, `turned` by half a turn or not, and for each equation the residual (m,) m, its standard deviation (m,) and
    the number (m,) of scattered ones that tell it. `gain` (k, m): how much each difference counts in each unknown."""

    equations: Equations
    unknowns: Floats
    covariance: Floats
    about: Floats
    turned: bool
    residual: Floats
    sigma: Floats
    freedom: Floats
    gain: Floats

    @property
    def shared(self) -> Bools:
        """Which equations (m,) say no more than that of many other elements of their kind, such as an assumed
        setback."""
        common = np.zeros(len(self.freedom), dtype=np.bool_)
        for kind in np.unique(self.equations.kind):
            chosen = np.flatnonzero(self.equations.kind == kind)
            if len(chosen) > FEW and len(_independent(self.equations, chosen)) < FEW:
                values = np.round(self.equations.difference[chosen] / SAME_M)
                _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
                common[chosen] = counts[which] >= SHARED_PART * len(chosen)
        return common

    def carried(self, middles: Floats) -> Floats:
        """Places (n, 3) of the old row in the new row's frame."""
        q = half_turn(middles, self.turned) - self.about
        carried: Floats = self.about + self.unknowns[T] + q @ self._turn_and_scale.T
        return carried

    def carried_back(self, middles: Floats) -> Floats:
        """Places (n, 3) of the new row in the old row's frame."""
        q = np.linalg.solve(self._turn_and_scale, (middles - self.about - self.unknowns[T]).T).T
        return half_turn(self.about + q, self.turned)

    @property
    def _turn_and_scale(self) -> Floats:
        """The linear part (3, 3) of how places are carried."""
        h, (x, y) = float(self.unknowns[HEADING]), self.unknowns[SCALE]
        return np.array([[1 + x, 0.0, h], [0.0, 1 + y, 0.0], [-h, 0.0, 1.0]])


def half_turn(points: Floats, turned: bool) -> Floats:
    """Points (n, 3), by half a turn about y if `turned`."""
    return points * np.array([-1.0, 1.0, -1.0]) if turned else points


def fit(
    old: Elements, new: Elements, pairs: Pairs, turned: bool = False, rounds: int = ROUNDS, free_scale: bool = False
) -> Fit:
    """The motion that most of the pairs agree upon. `free_scale`: whatever the maps say of how well they know their
    scales."""
    rows, columns = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    placed = half_turn(old.middles[rows], turned)
    about = np.median(placed, axis=0) * np.array([1.0, 0.0, 1.0])
    equations = _equations(old, new, rows, columns, placed - about, placed)
    prior = _prior(equations, len(old.kinds))
    if free_scale:
        prior[SCALE] = 1 / FREE_SCALE**2
    scatter, extra = PRIOR_SHARE * _medians(equations, equations.sigma), _excess(equations)
    freedom = np.full(len(scatter), np.inf)
    unknowns: Floats = np.zeros(len(prior))
    gain: Floats = np.zeros((len(prior), len(equations.pair)))
    covariance: Floats = np.diag(1 / prior)
    residual: Floats = equations.difference - _medians(equations, equations.difference)
    for number in range(rounds):
        normal = residual / np.sqrt(scatter**2 + extra)
        # the first rounds weigh as medians do, so that what changed has no say
        weight = (_early(normal) if number < rounds // 2 else _late(normal)) / (scatter**2 + extra)
        information = equations.slopes.T @ (weight[:, None] * equations.slopes) + np.diag(prior)
        covariance = np.asarray(np.linalg.inv(information), np.float64)
        gain = covariance @ (equations.slopes.T * weight)
        unknowns = gain @ equations.difference
        residual = equations.difference - equations.slopes @ unknowns
        scatter, freedom = _scatter(equations, residual)
    explained = np.einsum("mi,ij,mj->m", equations.slopes, covariance, equations.slopes)
    sigma: Floats = np.sqrt(scatter**2 + extra + explained)
    return Fit(equations, unknowns, covariance, about, turned, residual, sigma, freedom, gain)


def _early(normal: Floats) -> Floats:
    weights: Floats = 1 / np.maximum(np.abs(normal), 1.0)
    return weights


def _late(normal: Floats) -> Floats:
    """Tukey's weights."""
    weights: Floats = np.maximum(1 - (normal / TUKEY) ** 2, 0.0) ** 2
    return weights


def _equations(old: Elements, new: Elements, rows: Ints, columns: Ints, lever: Floats, placed: Floats) -> Equations:
    parts: list[Part] = []
    groups = old.groups[rows]
    plugins = sorted({plugin for plugin, _ in old.kinds})
    family = np.array([6 * plugins.index(plugin) for plugin, _ in old.kinds])
    count, kinds = len(rows), len(old.kinds)
    for axis in range(3):
        slopes = np.zeros((count, 6 + 6 * kinds))
        slopes[:, axis] = 1.0
        if axis == 0:
            slopes[:, HEADING], slopes[:, 4] = lever[:, 2], lever[:, 0]
        if axis == 1:
            slopes[:, 5] = lever[:, 1]
        if axis == 2:
            slopes[:, HEADING] = -lever[:, 0]
        slopes[np.arange(count), 6 + 6 * groups + axis] = 1.0
        sigma = np.hypot(old.middle_sigmas[rows, axis], new.middle_sigmas[columns, axis])
        difference = new.middles[columns, axis] - placed[:, axis]
        parts.append(
            (
                np.arange(count),
                axis,
                False,
                difference,
                slopes,
                sigma,
                6 * groups + axis,
                placed[:, axis],
                family[groups] + axis,
            )
        )
        sizes = old.sizes[rows, axis], new.sizes[columns, axis]
        # what has no extent at all in one of the maps was not measured there
        some = np.flatnonzero((np.maximum(*sizes) > LEAST_SIZE_M) & (np.minimum(*sizes) > 0))
        slopes = np.zeros((len(some), 6 + 6 * kinds))
        if axis < 2:
            slopes[:, 4 + axis] = sizes[0][some]
        slopes[np.arange(len(some)), 6 + 6 * groups[some] + 3 + axis] = 1.0
        sigma = np.hypot(old.size_sigmas[rows, axis], new.size_sigmas[columns, axis])[some]
        kind = 6 * groups[some] + 3 + axis
        parts.append(
            (
                some,
                axis,
                True,
                (sizes[1] - sizes[0])[some],
                slopes,
                sigma,
                kind,
                placed[some, axis],
                family[groups[some]] + 3 + axis,
            )
        )
    return _measured(_joined(parts))


def _measured(equations: Equations) -> Equations:
    """Those of figures that were measured, which a scale's error alone cannot make as uncertain as they are."""
    lever = np.abs(equations.slopes[:, SCALE]).sum(axis=1)
    kept = equations.sigma < MEASURED_M + MEASURED_SHARE * lever
    return Equations(*(getattr(equations, one.name)[kept] for one in fields(Equations)))


def _joined(parts: Sequence[Part]) -> Equations:
    pair, axis, size, difference, slopes, sigma, kind, place, family = zip(*parts, strict=True)
    lengths = [len(one) for one in pair]
    return Equations(
        np.concatenate(pair),
        np.repeat(np.array(axis), lengths),
        np.repeat(np.array(size), lengths),
        np.concatenate(difference),
        np.concatenate(slopes),
        np.maximum(np.concatenate(sigma), LEAST_SIGMA_M),
        np.concatenate(kind),
        np.concatenate(place),
        np.concatenate(family),
    )


def _prior(equations: Equations, kinds: int) -> Floats:
    """The information (k,) of the unknowns' prior about 0: offsets as large as a kind's sigmas, scales as large as
    sigmas far away allow."""
    sigmas = np.full(6 + 6 * kinds, LEAST_SIGMA_M)
    sigmas[T], sigmas[HEADING] = FREE_M, FREE_RAD
    for axis in (0, 1):
        chosen = (equations.axis == axis) & ~equations.size
        far = np.abs(equations.slopes[chosen, 4 + axis])
        known = far > 1.0
        rates = equations.sigma[chosen][known] / far[known]
        sigmas[4 + axis] = max(LEAST_SCALE, float(np.median(rates))) if known.any() else LEAST_SCALE
    for kind in np.unique(equations.kind):
        sigmas[6 + kind] = np.median(equations.sigma[equations.kind == kind])
    information: Floats = 1 / sigmas**2
    return information


def _medians(equations: Equations, values: Floats) -> Floats:
    """The median (m,) of values (m,) over each kind."""
    medians = np.zeros(len(values))
    for kind in np.unique(equations.kind):
        chosen = equations.kind == kind
        medians[chosen] = np.median(values[chosen])
    return medians


def _excess(equations: Equations) -> Floats:
    """The variance (m,) that an element's own sigma has beyond twice that of its likes nearest along the axis: it was
    seen worse."""
    extra = np.zeros(len(equations.sigma))
    variance = equations.sigma**2
    for kind in np.unique(equations.kind):
        chosen = np.flatnonzero(equations.kind == kind)
        if len(chosen) <= FEW:
            continue
        apart = np.abs(equations.place[chosen, None] - equations.place[None, chosen])
        near = np.argsort(apart, axis=1, kind="stable")[:, : PEERS + 1]
        usual = np.median(variance[chosen][near], axis=1)
        extra[chosen] = np.maximum(variance[chosen] - EXCESS * usual, 0.0)
    return extra


def _scatter(equations: Equations, residual: Floats) -> tuple[Floats, Floats]:
    """The standard deviation (m,) of each equation's own error, and the number (m,) of independent residuals that it
    rests upon.

    It is the scatter of the residuals of its kind, steadied by what share of the maps' sigma the scatter of its family
    is, as much as `PRIOR_COUNT` residuals do (moderated t-test, Smyth 2004). Of few residuals, or where all of a kind
    are one, it is the maps'.
    """
    scatter, freedom = np.zeros(len(residual)), np.full(len(residual), np.inf)
    kinds = [np.flatnonzero(equations.kind == kind) for kind in np.unique(equations.kind)]
    usual = [float(np.median(equations.sigma[chosen])) for chosen in kinds]
    spreads = [_spread(residual[chosen][_independent(equations, chosen)]) for chosen in kinds]
    families = [int(equations.family[chosen[0]]) for chosen in kinds]
    for chosen, sigma, (spread, count), family in zip(kinds, usual, spreads, families, strict=True):
        if count < 1:
            scatter[chosen] = sigma
            continue
        shares = [
            others[0] / one
            for others, one, of in zip(spreads, usual, families, strict=True)
            if of == family and others[1] > 0
        ]
        prior = min(float(np.median(shares)) * sigma, MOST_PRIOR * spread)
        steady = np.sqrt((count * spread**2 + PRIOR_COUNT * prior**2) / (count + PRIOR_COUNT))
        least = LEAST_SIGMA_M * (2.0 if equations.size[chosen[0]] else 1.0)
        scatter[chosen], freedom[chosen] = max(steady, least), count + PRIOR_COUNT
    return scatter, freedom


def _independent(equations: Equations, chosen: Ints) -> Ints:
    """The first of the equations that have the same difference: elements that share an edge have one error, which
    counts once."""
    return np.unique(np.round(equations.difference[chosen] / SAME_M), return_index=True)[1]


def _spread(residual: Floats) -> tuple[float, float]:
    """The standard deviation of residuals (n,) of which most are chance, and the number of degrees of freedom that tell
    it; 0 of few."""
    if len(residual) < FEW:
        return LEAST_SIGMA_M, 0.0
    spread = max(MAD * float(np.median(np.abs(residual))), LEAST_SIGMA_M)
    for _ in range(2):
        inside = np.abs(residual) < INSIDE * spread
        free = max(float(inside.sum()) - FITTED, 1.0)
        spread = max(float(np.sqrt(np.sum(residual[inside] ** 2) / free)), LEAST_SIGMA_M)
    return spread, free
