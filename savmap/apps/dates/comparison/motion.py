"""How one row's frame lies in another's: robust weighted least squares over the elements that both have.

Errors of a row's elements are not independent. What they have in common is estimated with the rigid motion, each with
the standard deviation that the maps' own covariances allow it: the scale along x and y, and for each kind of element an
offset of its middles and of its sizes (masks that are too wide, a setback that is only assumed). What is left is each
element's own error. Its scatter among all elements of a kind, most of which have not changed, is measured, since a map
holds covariances of single vertices, which do not tell how much of an error is common.
"""

from dataclasses import dataclass, fields
from itertools import product

import numpy as np

from savmap.apps.dates.comparison.elements import Elements
from savmap.types import Bools, Floats, Ints, array_record

Pairs = tuple[tuple[int, int], ...]
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
"""Differences that are the same, and the part of a kind that has the same one where it is not of each by itself."""
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

    @property
    def kinds(self) -> list[Ints]:
        """The numbers of the equations of each kind."""
        return [np.flatnonzero(self.kind == kind) for kind in np.unique(self.kind)]

    def where(self, chosen: Bools) -> "Equations":
        """Those of the equations (m,) that are chosen."""
        return Equations(*(getattr(self, figure.name)[chosen] for figure in fields(self)))


@dataclass(frozen=True, eq=False)
@array_record
class Fit:
    """The solved equations: unknowns (k,) with covariance (k, k), the point (3,) m about which the row is turned and
    scaled, `turned` by half a turn or not, and for each equation the residual (m,) m, its standard deviation (m,) and
    the number (m,) of scattered ones that it rests upon. `gain` (k, m): how much each difference counts in each
    unknown."""

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
        for chosen in self.equations.kinds:
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
    equations = _equations(old, new, rows, columns, placed, about)
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
        # the first rounds weigh as medians do, so that what changed has no say; the others by Tukey's weights
        early = number < rounds // 2
        robust = 1 / np.maximum(np.abs(normal), 1.0) if early else np.maximum(1 - (normal / TUKEY) ** 2, 0.0) ** 2
        weight = robust / (scatter**2 + extra)
        information = equations.slopes.T @ (weight[:, None] * equations.slopes) + np.diag(prior)
        covariance = np.asarray(np.linalg.inv(information), np.float64)
        gain = covariance @ (equations.slopes.T * weight)
        unknowns = gain @ equations.difference
        residual = equations.difference - equations.slopes @ unknowns
        scatter, freedom = _scatter(equations, residual)
    explained = np.einsum("mi,ij,mj->m", equations.slopes, covariance, equations.slopes)
    sigma: Floats = np.sqrt(scatter**2 + extra + explained)
    return Fit(equations, unknowns, covariance, about, turned, residual, sigma, freedom, gain)


def _equations(old: Elements, new: Elements, rows: Ints, columns: Ints, placed: Floats, about: Floats) -> Equations:
    """The equations of figures that were measured: what has no extent at all in one of the maps was not, nor what a
    scale's error cannot make as uncertain as it is."""
    count, groups, lever = len(rows), old.groups[rows], placed - about
    plugins = sorted({plugin for plugin, _ in old.kinds})
    family = np.array([6 * plugins.index(plugin) for plugin, _ in old.kinds])[groups]
    parts: list[Equations] = []
    for axis, size in product(range(3), (False, True)):
        slopes = np.zeros((count, 6 + 6 * len(old.kinds)))
        kind = 6 * groups + 3 * size + axis
        slopes[np.arange(count), 6 + kind] = 1.0
        if size:
            before, after = old.sizes[rows, axis], new.sizes[columns, axis]
            sigma = np.hypot(old.size_sigmas[rows, axis], new.size_sigmas[columns, axis])
            measured = (np.maximum(before, after) > LEAST_SIZE_M) & (np.minimum(before, after) > 0)
        else:
            before, after = placed[:, axis], new.middles[columns, axis]
            sigma = np.hypot(old.middle_sigmas[rows, axis], new.middle_sigmas[columns, axis])
            measured = np.ones(count, dtype=np.bool_)
            slopes[:, axis] = 1.0
            if axis != 1:
                slopes[:, HEADING] = lever[:, 2] if axis == 0 else -lever[:, 0]
        if axis < 2:
            slopes[:, 4 + axis] = before if size else lever[:, axis]
        part = Equations(
            np.arange(count),
            np.full(count, axis),
            np.full(count, size),
            after - before,
            slopes,
            np.maximum(sigma, LEAST_SIGMA_M),
            kind,
            placed[:, axis],
            family + 3 * size + axis,
        )
        scaled = np.abs(slopes[:, SCALE]).sum(axis=1)
        parts.append(part.where(measured & (part.sigma < MEASURED_M + MEASURED_SHARE * scaled)))
    return Equations(*(np.concatenate([getattr(part, figure.name) for part in parts]) for figure in fields(Equations)))


def _prior(equations: Equations, kinds: int) -> Floats:
    """The information (k,) of the unknowns' prior about 0: offsets as large as a kind's sigmas, scales as large as
    sigmas far away allow."""
    sigmas = np.full(6 + 6 * kinds, LEAST_SIGMA_M)
    sigmas[T], sigmas[HEADING] = FREE_M, FREE_RAD
    for axis in (0, 1):
        chosen = (equations.axis == axis) & ~equations.size
        lever = np.abs(equations.slopes[chosen, 4 + axis])
        far = lever > 1.0
        rates = equations.sigma[chosen][far] / lever[far]
        sigmas[4 + axis] = max(LEAST_SCALE, float(np.median(rates))) if far.any() else LEAST_SCALE
    for chosen in equations.kinds:
        sigmas[6 + equations.kind[chosen[0]]] = np.median(equations.sigma[chosen])
    information: Floats = 1 / sigmas**2
    return information


def _medians(equations: Equations, values: Floats) -> Floats:
    """The median (m,) of values (m,) over each kind."""
    medians = np.zeros(len(values))
    for chosen in equations.kinds:
        medians[chosen] = np.median(values[chosen])
    return medians


def _excess(equations: Equations) -> Floats:
    """The variance (m,) of an element's sigma beyond twice that of the nearest of its kind along the axis: it was seen
    worse."""
    extra = np.zeros(len(equations.sigma))
    variance = equations.sigma**2
    for chosen in equations.kinds:
        if len(chosen) > FEW:
            distance = np.abs(equations.place[chosen, None] - equations.place[None, chosen])
            near = np.argsort(distance, axis=1, kind="stable")[:, : PEERS + 1]
            usual = np.median(variance[chosen][near], axis=1)
            extra[chosen] = np.maximum(variance[chosen] - EXCESS * usual, 0.0)
    return extra


def _scatter(equations: Equations, residual: Floats) -> tuple[Floats, Floats]:
    """The standard deviation (m,) of each equation's error, and the number (m,) of independent residuals that it rests
    upon.

    It is the scatter of the residuals of its kind, steadied by what share of the maps' sigma the scatter of its family
    is, as much as `PRIOR_COUNT` residuals do (moderated t-test, Smyth 2004). Of few residuals, or where all of a kind
    are one, it is the maps'.
    """
    scatter, freedom = np.zeros(len(residual)), np.full(len(residual), np.inf)
    kinds = equations.kinds
    usual = [float(np.median(equations.sigma[chosen])) for chosen in kinds]
    spreads = [_spread(residual[chosen][_independent(equations, chosen)]) for chosen in kinds]
    families = [int(equations.family[chosen[0]]) for chosen in kinds]
    for chosen, sigma, (spread, count), family in zip(kinds, usual, spreads, families, strict=True):
        if count < 1:
            scatter[chosen] = sigma
            continue
        shares = [
            other / of_maps
            for (other, others), of_maps, name in zip(spreads, usual, families, strict=True)
            if name == family and others > 0
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
    """The standard deviation of residuals (n,) of which most are chance, and its degrees of freedom; 0 of few."""
    if len(residual) < FEW:
        return LEAST_SIGMA_M, 0.0
    spread = max(MAD * float(np.median(np.abs(residual))), LEAST_SIGMA_M)
    for _ in range(2):
        inside = np.abs(residual) < INSIDE * spread
        free = max(float(inside.sum()) - FITTED, 1.0)
        spread = max(float(np.sqrt(np.sum(residual[inside] ** 2) / free)), LEAST_SIGMA_M)
    return spread, free
