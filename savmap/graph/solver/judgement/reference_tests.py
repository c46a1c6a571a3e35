"""Tests of each reference against the rest: Baarda's test, and references that contradict all measurements."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

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
    """A reference's use, its value as all else gives it (`predicted`), by how many standard deviations it deviates, and
    whether somebody measured it."""

    use: ReferenceUse
    predicted: float
    deviation: float
    is_given: bool

    @property
    def gross(self) -> bool:
        """Whether the deviation is significant, and gross."""
        return self.deviation > GROSS_SIGMA and is_gross(self.use.value, self.predicted)

    @property
    def line(self) -> str:
        """What it says, for the user."""
        return f"{stated(self.use, self.is_given)}, but the rest says {self.predicted:.3f} m"


def stated(use: ReferenceUse, is_given: bool) -> str:
    """What a line says of a reference: what nobody measured is not given."""
    return f"{use.name} is {'given as' if is_given else 'taken to be at'} {use.value:.3f} m +- {use.sigma:.3f} m"


def off_by(off_m: float, sigma_m: float) -> str:
    """A reference's difference from what the rest says, for the user."""
    return f"{abs(off_m):.2f} m off, {abs(off_m) / sigma_m:.0f} sigma"


@dataclass(frozen=True, eq=False)
class SolvedReference:
    """A reference as it is given, if it is, its value in the solution, and that value's derivative (3n,) to points by
    `keys` (n)."""

    use: ReferenceUse
    slope: Floats
    keys: list[int]
    is_given: bool = True

    def considered(self, covariance: Covariance) -> float:
        """The variance that comes from what was not estimated."""
        return float(self.slope @ covariance.considered(self.keys) @ self.slope)

    def estimated(self, covariance: Covariance) -> float:
        """The variance beside that."""
        return float(self.slope @ covariance.of(self.keys) @ self.slope) - self.considered(covariance)


def reference_tests(
    problem: Problem, estimate: Estimate, covariance: Covariance, unseen: Mapping[str, float]
) -> list[ReferenceTest]:
    """A test of every reference; `unseen`: those of what was not seen well, and to how many metres it was."""
    solved = solved_references(problem, estimate)
    return [_test(item, covariance, unseen.get(item.use.name, 0.0)) for item in solved]


def solved_references(problem: Problem, estimate: Estimate) -> Iterator[SolvedReference]:
    """Every reference: the camera's heights, unless its path is given, then the relations."""
    heights = () if problem.camera.fixed is not None else problem.camera.references.camera_heights
    for number, height in enumerate(heights):
        use = ReferenceUse(height.name, height.value_m, height.sigma_m, float(estimate.heights[number]))
        yield SolvedReference(use, np.eye(3)[1], [camera_height_key(number)])
    yield from (_solved(problem, relation, estimate) for relation in problem.relations if relation.name)


def reference_uses(given: Problem, used: Problem, estimate: Estimate) -> Iterator[ReferenceUse]:
    """Every reference as it was given, or seen, with how it was used, and its value in the solution of the `used`
    problem: of a camera height that was left out, the camera's mean height. What is presumed is none."""
    uses: dict[str, list[ReferenceUse]] = {}
    for solved in solved_references(used, estimate):
        uses.setdefault(solved.use.name, []).append(solved.use)
    heights = () if given.camera.fixed is not None else given.camera.references.camera_heights
    mean_height = float(estimate.poses[:, 1, 3].mean())
    every = [ReferenceUse(item.name, item.value_m, item.sigma_m, mean_height) for item in heights]
    relations = (relation for relation in given.relations if relation.name and not relation.presumed)
    every += [_solved(used, relation, estimate).use for relation in relations]
    for given_use in every:
        of_name = uses.get(given_use.name)
        use = of_name.pop(0) if of_name else None
        if use is None:
            yield replace(given_use, left_out=True)
        else:
            yield replace(use, sigma=given_use.sigma, softened=use.sigma if use.sigma > given_use.sigma else None)


def tested_keys(problem: Problem) -> frozenset[int]:
    """The variables whose covariance `reference_tests` asks for."""
    heights = range(0 if problem.camera.fixed is not None else len(problem.camera.references.camera_heights))
    named = (key for relation in problem.relations if relation.name for key in relation.keys)
    return frozenset((*map(camera_height_key, heights), *named))


def _solved(problem: Problem, relation: Relation, estimate: Estimate) -> SolvedReference:
    at = estimate.points[problem.index(relation.a)]
    if relation.b is None:
        value, slope = float(at[relation.column]), np.eye(3)[relation.column]
    else:
        span = estimate.points[problem.index(relation.b)] - at
        along = span / np.linalg.norm(span) if relation.axis is None else np.eye(3)[relation.column]
        value, slope = float(along @ span), np.concatenate([-along, along])
    use = ReferenceUse(relation.name, relation.value, relation.sigma, value)
    return SolvedReference(use, slope, list(relation.keys), relation.is_given)


def _test(solved: SolvedReference, covariance: Covariance, unseen: float) -> ReferenceTest:
    """Baarda's test: a residual's variance is the reference's less the solution's, plus what comes from unknowns that
    are not estimated.

    The residual is only a share of the deviation of the rest, for the solution follows the reference. Where the rest
    hardly determines the quantity, it cannot be tested.
    """
    use = solved.use
    share = max(1.0 - solved.estimated(covariance) / use.sigma**2, LEAST_SPARE)
    spread = float(np.sqrt(share * use.sigma**2 + solved.considered(covariance) + (share * unseen) ** 2))
    residual = use.solved - use.value
    if spread / share > max(VAGUE_M, VAGUE_SHARE * abs(use.value)):
        return ReferenceTest(use, use.solved, 0.0, solved.is_given)
    return ReferenceTest(use, use.value + residual / share, abs(residual) / spread, solved.is_given)


def refuse_contradiction(problem: Problem, tests: Sequence[ReferenceTest]) -> None:
    """Raises SolveError where references deviate grossly, naming those that deviate most; not for what is presumed, or
    for parts that may have been taken for others where some other reference gives the scale."""
    presumed = problem.presumed
    parts = {item.name for item in problem.relations if item.note_if_outlier}
    spared = {*presumed, *(parts if {test.use.name for test in tests} - parts - {*presumed} else ())}
    wrong = [test for test in tests if test.gross and test.use.name not in spared]
    if wrong:
        lines = [test.line for test in sorted(wrong, key=lambda test: -test.deviation)[:3]]
        if sum(test.use.name not in presumed for test in tests) == 1:
            lines = [f"{stated(wrong[0].use, wrong[0].is_given)}, but what is seen does not fit: is it in metres?"]
        raise contradiction(problem, "; ".join(lines))


def refuse_unseen(problem: Problem, fit: Fit) -> None:
    """Raises SolveError where references fit only because all measurements of their landmarks were rejected: another
    reference is grossly wrong and has won."""
    seen, used = (np.bincount(keys, minlength=len(problem.keys)) for keys in (problem.at_key, problem.at_key[fit.kept]))
    lost = [
        relation.name
        for relation in problem.relations
        if relation.name
        and not relation.presumed
        and any(seen[at] and not used[at] for at in map(problem.index, relation.keys))
    ]
    if len(lost) >= UNSEEN:
        raise contradiction(problem, f"nothing that was seen of {', '.join(lost[:3])} fits the others")
