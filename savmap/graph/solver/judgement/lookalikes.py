"""Landmarks that look odd among many of a kind: where a reference contradicts what was seen of its landmark, that tells which is wrong."""

from dataclasses import dataclass

import numpy as np

from savmap.graph.problem import Estimate, Problem
from savmap.types import Bools

LEAST_PAIRS, ALIKE_M, ALIKE_SIGMA = 5, 0.015, 6.0
"""Pairs that tell what is usual, and by how much others differ from it: makers' tolerances and half a pixel, or far beyond the usual spread."""
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
        ends = [(axis, a, b) for axis, a, b in part.alike]
        y = {key: estimate.points[problem.index(key)] for _, a, b in ends for key in (a, b)}
        sizes = np.array([y[b]["xyz".index(axis)] - y[a]["xyz".index(axis)] for axis, a, b in ends])
        if len(sizes) < LEAST_PAIRS:
            continue
        usual = float(np.median(sizes))
        tolerance = max(ALIKE_M, ALIKE_SIGMA * float(np.median(np.abs(sizes - usual))))
        at = {
            (axis, key): (size, turn)
            for (axis, a, b), size in zip(ends, sizes.tolist(), strict=True)
            for key, turn in ((a, 1.0), (b, -1.0))
        }
        for one in problem.relations:
            if one.name and one.axis and one.b is None and (one.axis, one.a) in at:
                size, turn = at[one.axis, one.a]
                found[one.name] = Span(size, usual, tolerance, turn)
    return found


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
