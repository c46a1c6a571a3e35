"""Which of the references the pictures and the other references contradict: Baarda's test, of every set of a few.

What the pictures say of the references' values is a normal distribution that leaves scale and place open: these follow
from references alone, and what a solve says of them beside is assumptions, such as that of a steady camera, which
refute no reference. What all but some references say together, and of those, is algebra of as many unknowns as there
are references: every set of suspects is tried.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, islice, product

import numpy as np
from scipy.special import ndtri

from savmap.types import Floats, Ints, ReferenceUse

FALSE_ALARMS = 0.01
"""In how many rows whose references are all right one of them is taken for wrong."""
CLEARLY = 16.0
"""A set of suspects is excluded where it explains so much less than another one, in squared standard deviations: odds
of 3000 to 1."""
LOOSE_M = 100.0
RANK = 1e-12
"""Variances that are so much smaller than the largest are those of rounding: of differences between references to one
thing."""
MOST_TRIED = 2000
LEAST_BELIEVED = 2
"""References that an explanation must leave standing, where there are so many."""
Names = frozenset[str]


@dataclass(frozen=True, eq=False)
class Solved:
    """The references' `values` (r,) in a solve that takes them for uncertain by `sigmas` (r,), m, with their
    `covariance` (r, r), and the orthonormal directions (r, g) in which they change where the whole scene is scaled or
    moved, which pictures do not show."""

    values: Floats
    sigmas: Floats
    covariance: Floats
    gauge: Floats


@dataclass(frozen=True, eq=False)
class Agreement:
    """References by `names` (r,), of which equal ones are one reference, that are `off` (r,) what was solved for with
    soft references, m, and have standard deviations `sigmas` (r,). `unseen` (r,): to how many metres what a reference
    is of was seen, where that was not seen well.

    Their values change with unknowns y (k,) by `slopes` (r, k): two references to one thing change alike. What the
    pictures say of y costs y' information y - 2 shift' y."""

    names: tuple[str, ...]
    values: Floats
    off: Floats
    sigmas: Floats
    unseen: Floats
    slopes: Floats
    information: Floats
    shift: Floats

    @classmethod
    def of(cls, names: tuple[str, ...], values: Floats, sigmas: Floats, solved: Solved) -> "Agreement":
        """From what is `solved` of the references' values in a solve that takes them for softer than they are."""
        variances, axes = np.linalg.eigh((solved.covariance + solved.covariance.T) / 2)
        kept = variances > RANK * variances.max(initial=0.0)
        slopes, off = axes[:, kept], solved.values - values
        soft = slopes.T / solved.sigmas**2
        weight, turned = np.linalg.eigh(np.diag(1 / variances[kept]) - soft @ slopes)
        information = (turned * np.maximum(weight, 0.0)) @ turned.T
        shift = soft @ off
        assumed = _assumed(information, slopes.T @ solved.gauge)
        along = information @ assumed
        determined_parts = information - along @ along.T, shift - along @ (assumed.T @ shift)
        return cls(names, values, off, sigmas, np.zeros_like(sigmas), slopes, *determined_parts)

    @cached_property
    def all_names(self) -> tuple[str, ...]:
        """Each name once."""
        return tuple(dict.fromkeys(self.names))

    @cached_property
    def critical(self) -> float:
        """Beyond how many standard deviations a reference contradicts the rest, as many as are tested (Bonferroni)."""
        return -float(ndtri(FALSE_ALARMS / 2 / max(len(self.all_names), 1)))

    def at(self, name: str) -> Ints:
        """Indices of a reference."""
        return np.flatnonzero([member == name for member in self.names])

    def given(self, name: str) -> ReferenceUse:
        """A reference as it was given."""
        index = int(self.at(name)[0])
        return ReferenceUse(name, float(self.values[index]), float(self.sigmas[index]), float("nan"))

    def cost(self, out: Names = frozenset()) -> float:
        """How badly pictures and references agree without those that are `out`: a sum of squares in standard
        deviations, up to a constant."""
        matrix, right, weight = self._normal(out)
        return float(weight @ self.off**2 - right @ np.linalg.solve(matrix, right))

    def deviations(self, out: Names = frozenset()) -> Mapping[str, float]:
        """By how many standard deviations each reference that is not `out` deviates from what all others say."""
        whole = self.cost(out)
        return {
            name: float(np.sqrt(max(whole - self.cost(out | {name}), 0.0)))
            for name in self.all_names
            if name not in out
        }

    def rest(self, name: str, out: Names = frozenset()) -> tuple[float, float]:
        """What all others but those that are `out` say of a reference's value, and its standard deviation, m; of
        several by one name, the one that is farthest off."""
        index = int(max(self.at(name), key=lambda index: abs(self.off[index])))
        matrix, right, _ = self._normal(out | {name})
        slope, inverse = self.slopes[index], np.linalg.inv(matrix)
        moved, variance = slope @ inverse @ right, slope @ inverse @ slope + self.unseen[index] ** 2
        return float(self.values[index] + self.off[index] + moved), float(np.sqrt(variance))

    def common_error(self, names: Names, out: Names = frozenset()) -> float:
        """How well an error that some references have in common shows without those that are `out`: its standard
        deviation, m. For a single reference that is of its difference from what all others say."""
        matrix, _, weight = self._normal(out)
        member = weight * np.isin(self.names, sorted(names))
        along = self.slopes.T @ member
        shown = float(member.sum() - along @ np.linalg.solve(matrix, along))
        return float(max(shown, LOOSE_M**-2.0) ** -0.5)

    def explanations(self, mistakable: Names = frozenset()) -> list[Names]:
        """The least sets without which all others agree, those that explain about as much as the best of them does,
        that one first; the empty one alone where all agree. None where no minority will do; references whose landmark
        is `mistakable` for another, for it looks odd, count last and may be many."""
        for firm in range((len(self.all_names) + 1) // 2):
            for loose in range(len(mistakable) + 1):
                explained = self._explanations(mistakable, firm, loose)
                if explained:
                    return explained
        return []

    def _explanations(self, mistakable: Names, firm: int, loose: int) -> list[Names]:
        """Those with so many references of either kind."""
        costs = {out: self.cost(out) for out in self._sets(mistakable, firm, loose)}
        if not costs or len(self.all_names) - firm - loose < min(LEAST_BELIEVED, len(self.all_names)):
            return []
        best = min(costs, key=costs.__getitem__)
        if not self.agrees(best) or not self._refutes(best):
            return []
        half = (self.cost() + costs[best]) / 2
        near = sorted((out for out in costs if costs[out] <= costs[best] + CLEARLY), key=costs.__getitem__)
        return [out for out in near if self._refutes(out) and (costs[out] <= half or self.agrees(out))]

    def _refutes(self, out: Names) -> bool:
        """Whether the rest contradicts each of those that are out."""
        whole = self.cost(out)
        return all(self.cost(out - {name}) - whole > self.critical**2 for name in out)

    def agrees(self, out: Names = frozenset()) -> bool:
        """Whether those that are not `out` agree."""
        return max(self.deviations(out).values(), default=0.0) <= self.critical

    def _sets(self, mistakable: Names, firm: int, loose: int) -> list[Names]:
        """Sets of suspects, as many as can be tried, those that deviate most first."""
        others = [name for name in self._worst_first if name not in mistakable]
        some = product(combinations(others, firm), combinations(sorted(mistakable), loose))
        return [frozenset((*a, *b)) for a, b in islice(some, MOST_TRIED)]

    @cached_property
    def _worst_first(self) -> list[str]:
        deviations = self.deviations()
        return sorted(deviations, key=lambda name: -deviations[name])

    def _normal(self, out: Names) -> tuple[Floats, Floats, Floats]:
        """The normal equations of y without those that are `out`: matrix (k, k) and right side (k,), and the
        references' weights (r,)."""
        used = np.array([name not in out for name in self.names])
        weight = used / (self.sigmas**2 + self.unseen**2)
        matrix = self.information + (self.slopes.T * weight) @ self.slopes + np.eye(len(self.shift)) / LOOSE_M**2
        return matrix, self.shift - self.slopes.T @ (weight * self.off), weight


def _assumed(information: Floats, gauge: Floats) -> Floats:
    """Independent directions (k, d) within the gauge (k, g), each one standard deviation long, in which there is
    information (k, k) at all."""
    strength, turned = np.linalg.eigh(gauge.T @ information @ gauge)
    determined = strength > LOOSE_M**-2.0
    return np.asarray(gauge @ turned[:, determined] / np.sqrt(strength[determined]))
