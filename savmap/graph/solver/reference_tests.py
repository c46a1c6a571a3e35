"""Tests of each reference against the rest: Baarda's test, and references that contradict all measurements."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from savmap.graph.constraints import Relation
from savmap.graph.covariance import Covariance
from savmap.graph.initial.outlier_references import contradiction, is_gross
from savmap.graph.keys import camera_height_key
from savmap.graph.problem import Estimate, Problem
from savmap.graph.solver.residuals import Fit
from savmap.types import Floats, ReferenceUse

GROSS_SIGMA = 5.0
LEAST_SPARE = 1e-6
VAGUE_M, VAGUE_SHARE = 0.25, 0.1
UNSEEN = 2


@dataclass(frozen=True)
class ReferenceTest:
    """A reference's use, its value as all else gives it (`predicted`), and by how many standard deviations it deviates."""

    use: ReferenceUse
    predicted: float
    deviation: float

    @property
    def gross(self) -> bool:
        """Whether the deviation is significant, and gross."""
        return self.deviation > GROSS_SIGMA and is_gross(self.use.value, self.predicted)

    @property
    def line(self) -> str:
        """What it says, for the user."""
        given = f"{self.use.name} is given as {self.use.value:.3f} m +- {self.use.sigma:.3f} m"
        return f"{given}, but the rest says {self.predicted:.3f} m"


@dataclass(frozen=True, eq=False)
class SolvedReference:
    """A reference's value in the solution, and its derivative (3n,) to points by `keys` (n)."""

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


def reference_tests(problem: Problem, estimate: Estimate, covariance: Covariance) -> list[ReferenceTest]:
    """A test of every reference."""
    return [*_heights(problem, estimate, covariance), *_relations(problem, estimate, covariance)]


def tested_keys(problem: Problem) -> frozenset[int]:
    """The variables whose covariance `reference_tests` asks for."""
    heights = range(0 if problem.camera.fixed is not None else len(problem.camera.references.camera_heights))
    named = (key for relation in problem.relations if relation.name for key in relation.keys)
    return frozenset((*map(camera_height_key, heights), *named))


def _heights(problem: Problem, estimate: Estimate, covariance: Covariance) -> Iterator[ReferenceTest]:
    if problem.camera.fixed is not None:
        return
    for number, (height, solved) in enumerate(
        zip(problem.camera.references.camera_heights, estimate.heights, strict=True)
    ):
        name = " ".join(("camera height", *height.passes))
        solved_height = SolvedReference(float(solved), np.eye(3)[1], covariance, [camera_height_key(number)])
        yield _test(name, height.value_m, height.sigma_m, solved_height)


def _relations(problem: Problem, estimate: Estimate, covariance: Covariance) -> Iterator[ReferenceTest]:
    for relation in problem.relations:
        if relation.name:
            yield _test(relation.name, relation.value, relation.sigma, _solved(problem, relation, estimate, covariance))


def _solved(problem: Problem, relation: Relation, estimate: Estimate, covariance: Covariance) -> SolvedReference:
    at = estimate.points[problem.index(relation.a)]
    if relation.b is None:
        axis = relation.column
        return SolvedReference(float(at[axis]), np.eye(3)[axis], covariance, [relation.a])
    span = estimate.points[problem.index(relation.b)] - at
    along = span / np.linalg.norm(span) if relation.axis is None else np.eye(3)[relation.column]
    return SolvedReference(float(along @ span), np.concatenate([-along, along]), covariance, [relation.a, relation.b])


def _test(name: str, value: float, sigma: float, solved: SolvedReference) -> ReferenceTest:
    """Baarda's test: a residual's variance is the reference's less the solution's, plus what comes from unknowns that are not
    estimated.

    The residual is only a share of the deviation of the rest, for the solution follows the reference. Where the rest hardly
    determines the quantity, it cannot be tested.
    """
    share = max(1.0 - solved.estimated / sigma**2, LEAST_SPARE)
    spread = float(np.sqrt(share * sigma**2 + solved.considered))
    residual = solved.value - value
    use = ReferenceUse(name, value, sigma, solved.value)
    if spread / share > max(VAGUE_M, VAGUE_SHARE * abs(value)):
        return ReferenceTest(use, solved.value, 0.0)
    return ReferenceTest(use, value + residual / share, abs(residual) / spread)


def refuse_contradiction(problem: Problem, tests: list[ReferenceTest]) -> None:
    """Raises SolveError where references deviate grossly, naming those that deviate most."""
    wrong = [test for test in tests if test.gross]
    if wrong:
        lines = "; ".join(test.line for test in sorted(wrong, key=lambda test: -test.deviation)[:3])
        raise contradiction(problem, lines)


def refuse_unseen(problem: Problem, fit: Fit) -> None:
    """Raises SolveError where references fit only because all measurements of their landmarks were rejected: another reference is
    grossly wrong and has won."""
    seen, used = (np.bincount(keys, minlength=len(problem.keys)) for keys in (problem.at_key, problem.at_key[fit.kept]))
    lost = [
        relation.name
        for relation in problem.relations
        if relation.name and any(seen[at] and not used[at] for at in map(problem.index, relation.keys))
    ]
    if len(lost) >= UNSEEN:
        raise contradiction(problem, f"nothing that was seen of {', '.join(lost[:3])} fits the others")
