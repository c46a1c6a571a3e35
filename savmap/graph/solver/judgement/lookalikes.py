"""Landmarks that look odd among many of a kind: where a reference contradicts what was seen of its landmark, that tells which is wrong."""

from dataclasses import dataclass

import numpy as np

from savmap.graph.constraints import Pair
from savmap.graph.problem import Estimate, Problem
from savmap.types import Bools, Floats

LEAST_PAIRS, ALIKE_M, ALIKE_SIGMA = 5, 0.015, 6.0
"""Pairs that tell what is usual, and by how much others differ from it: makers' tolerances and half a pixel, or far beyond the usual spread."""
LEAST_OTHERS = 2
"""Pairs of a group that tell what is usual in it."""
FLAT_PART = 0.3


@dataclass(frozen=True)
class Span:
    """The distance from a reference's landmark to another one, which is `usual` for such pairs within a `tolerance`, m. `turn`: 1 where the
    distance shrinks as the landmark's coordinate grows."""

    size: float
    usual: float
    tolerance: float
    turn: float

    def is_odd(self, moved: float = 0.0) -> bool:
        """Whether it is unusual; strictly so, were the landmark's coordinate smaller by `moved`, m."""
        return abs(self.size + self.turn * moved - self.usual) > (ALIKE_M if moved else self.tolerance)

    @property
    def is_flat(self) -> bool:
        """Whether there is next to no distance: both landmarks are one and the same thing."""
        return abs(self.size) < FLAT_PART * abs(self.usual)


def spans_of(problem: Problem, estimate: Estimate) -> dict[str, Span]:
    """The spans of the references whose landmark is one of many pairs that are usually alike (see `Constraints.alike`), by name."""
    found: dict[str, Span] = {}
    for part in problem.parts:
        groups = [np.array([_size(problem, estimate, pair) for pair in group]) for group in part.alike]
        sizes = np.concatenate([*groups, np.zeros(0)])
        if len(sizes) < LEAST_PAIRS:
            continue
        usual = float(np.median(sizes))
        tolerance = max(ALIKE_M, ALIKE_SIGMA * float(np.median(np.abs(sizes - usual))))
        at = {
            (axis, key): Span(float(own[number]), _usual(np.delete(own, number), usual), tolerance, turn)
            for group, own in zip(part.alike, groups, strict=True)
            for number, (axis, a, b) in enumerate(group)
            for key, turn in ((a, 1.0), (b, -1.0))
        }
        for one in problem.relations:
            if one.name and one.axis and one.b is None and (one.axis, one.a) in at:
                found[one.name] = at[one.axis, one.a]
    return found


def _size(problem: Problem, estimate: Estimate, pair: Pair) -> float:
    """The distance of a pair along its axis, m."""
    axis, a, b = pair
    first, second = (estimate.points[problem.index(key)]["xyz".index(axis)] for key in (a, b))
    return float(second - first)


def _usual(others: Floats, everywhere: float) -> float:
    """What is usual of a pair: what the `others` (n,) of its group have, where some agree on it, else what most have everywhere."""
    if len(others) < LEAST_OTHERS or np.ptp(others) > ALIKE_M:
        return everywhere
    return float(np.median(others))


def measured_for(problem: Problem, names: frozenset[str]) -> Bools:
    """Which measurements (n,) are of the landmarks of references by name, and of those with the same coordinate."""
    keys = set[int]()
    for one in (one for one in problem.relations if one.name in names):
        group, grown = set[int](), {one.a}
        while grown != group:
            group = set(grown)
            grown |= {
                key
                for r in problem.relations
                if not r.name and r.axis == one.axis and r.b is not None and group & set(r.keys)
                for key in r.keys
            }
        keys |= group
    return np.isin(problem.measurements.keys, list(keys))
