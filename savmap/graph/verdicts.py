"""Each reference against what the rest says of it: Baarda's test, and references that stand against all that was seen."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from savmap.graph.constraints import Relation
from savmap.graph.covariance import Covariance
from savmap.graph.doubt import contradiction, gross
from savmap.graph.keys import mast_key
from savmap.graph.problem import Problem
from savmap.graph.residuals import Fit
from savmap.graph.start import Estimate
from savmap.types import Floats, ReferenceUse

GROSS_SIGMA = 5.0
LEAST_SPARE = 1e-6
VAGUE_M, VAGUE_SHARE = 0.25, 0.1
UNSEEN = 2


@dataclass(frozen=True)
class Verdict:
    """A reference's use, what its value would be if it had not been given, and how many standard deviations it is off."""

    use: ReferenceUse
    otherwise: float
    off: float

    @property
    def gross(self) -> bool:
        """Off significantly, and grossly."""
        return self.off > GROSS_SIGMA and gross(self.use.value, self.otherwise)


@dataclass(frozen=True)
class Measured:
    """What the solution says of a reference: its value, and its derivative (3n,) to points by `keys` (n)."""

    value: float
    slope: Floats
    covariance: Covariance
    keys: list[int]

    @property
    def considered(self) -> float:
        """The variance that comes from what was not estimated."""
        return float(self.slope @ self.covariance.considered(self.keys) @ self.slope)

    @property
    def estimated(self) -> float:
        """The variance beside that."""
        return float(self.slope @ self.covariance.of(self.keys) @ self.slope) - self.considered


def judged(problem: Problem, estimate: Estimate, covariance: Covariance) -> list[Verdict]:
    """A verdict on every reference."""
    return [*_heights(problem, estimate, covariance), *_relations(problem, estimate, covariance)]


def tested_keys(problem: Problem) -> frozenset[int]:
    """The variables whose covariance `judged` asks for."""
    masts = range(0 if problem.frames.fixed is not None else len(problem.frames.references.camera_heights))
    named = (key for relation in problem.relations if relation.name for key in (relation.a, relation.b))
    return frozenset((*map(mast_key, masts), *(key for key in named if key is not None)))


def _heights(problem: Problem, estimate: Estimate, covariance: Covariance) -> Iterator[Verdict]:
    if problem.frames.fixed is not None:
        return
    for number, (height, solved) in enumerate(
        zip(problem.frames.references.camera_heights, estimate.heights, strict=True)
    ):
        name = " ".join(("camera height", *height.passes))
        measured = Measured(float(solved), np.eye(3)[1], covariance, [mast_key(number)])
        yield _verdict(name, height.value_m, height.sigma_m, measured)


def _relations(problem: Problem, estimate: Estimate, covariance: Covariance) -> Iterator[Verdict]:
    for relation in problem.relations:
        if relation.name:
            yield _verdict(
                relation.name, relation.value, relation.sigma, _solved(problem, relation, estimate, covariance)
            )


def _solved(problem: Problem, relation: Relation, estimate: Estimate, covariance: Covariance) -> Measured:
    at = estimate.points[problem.index(relation.a)]
    if relation.b is None:
        axis = relation.column
        return Measured(float(at[axis]), np.eye(3)[axis], covariance, [relation.a])
    span = estimate.points[problem.index(relation.b)] - at
    along = span / np.linalg.norm(span) if relation.axis is None else np.eye(3)[relation.column]
    return Measured(float(along @ span), np.concatenate([-along, along]), covariance, [relation.a, relation.b])


def _verdict(name: str, value: float, sigma: float, solved: Measured) -> Verdict:
    """Baarda's test: a residual's own variance is the reference's less the solution's, and with it what the solution follows
    of that which was not estimated.

    The residual is but a part of what the rest deviates: the share that the reference leaves it. Where the rest hardly
    speaks of what the reference says, it cannot be tested.
    """
    share = max(1.0 - solved.estimated / sigma**2, LEAST_SPARE)
    spread = float(np.sqrt(share * sigma**2 + solved.considered))
    residual = solved.value - value
    use = ReferenceUse(name, value, sigma, solved.value)
    if spread / share > max(VAGUE_M, VAGUE_SHARE * abs(value)):
        return Verdict(use, solved.value, 0.0)
    return Verdict(use, value + residual / share, abs(residual) / spread)


def refuse_contradiction(problem: Problem, verdicts: list[Verdict]) -> None:
    """Raises SolveError where references are off grossly, naming those that are off most."""
    wrong = [verdict for verdict in verdicts if verdict.gross]
    if wrong:
        lines = "; ".join(told(verdict) for verdict in sorted(wrong, key=lambda v: -v.off)[:3])
        raise contradiction(problem, lines)


def refuse_unseen(problem: Problem, fit: Fit) -> None:
    """Raises SolveError where references hold only because all that was seen of their landmarks was rejected: another one, grossly
    wrong, has won."""
    seen, used = (np.bincount(keys, minlength=len(problem.keys)) for keys in (problem.at_key, problem.at_key[fit.kept]))
    lost = [
        relation.name
        for relation in problem.relations
        if relation.name
        and any(seen[at] and not used[at] for at in map(problem.index, filter(None, (relation.a, relation.b))))
    ]
    if len(lost) >= UNSEEN:
        raise contradiction(problem, f"nothing that was seen of {', '.join(lost[:3])} fits the others")


def told(verdict: Verdict) -> str:
    """A line for the user."""
    use = verdict.use
    return f"{use.name} is given as {use.value:.3f} m +- {use.sigma:.3f} m, but the rest says {verdict.otherwise:.3f} m"
