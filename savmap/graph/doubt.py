"""References whose landmark may be mistaken for another: those that all others refute are left out before the solve.

A height given for a section's lowest beam is right, but where that beam was not seen, the next one up was taken for it. The
linear start knows nothing of references, and they are linear in its scale and shift (see `scale`): Baarda's data snooping
on these few equations names the one that does not belong.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from savmap.errors import SolveError
from savmap.graph import scale
from savmap.graph.constraints import Relation
from savmap.graph.problem import Problem
from savmap.types import Floats

START_SIGMA_M = 0.05
REFUTED_SIGMA, REFUTED_M = 5.0, 0.25
GROSS_M, GROSS_PART = 0.5, 0.1
CLEARLY = 2.0
LEAST_SPARE = 1e-3

Doubt = tuple[Relation, float]


def undoubted(problem: Problem, cameras: Floats, points: Floats) -> tuple[Problem, tuple[str, ...]]:
    """The problem without the references that the others refute, and a line about each of these.

    cameras (f, 3), points (m, 3): the scene up to scale and shift (as it is, with fixed poses). Only a minority of the
    doubtful ones is left out. Raises SolveError where more are refuted grossly: the solve might reject what was seen
    instead.
    """
    doubtful = sum(bool(relation.doubt) for relation in problem.relations)
    left, out = problem, list[Doubt]()
    while (found := _refuted(left, cameras, points)) is not None:
        out.append(found)
        left = replace(left, relations=tuple(one for one in left.relations if one is not found[0]))
    if 2 * len(out) < doubtful or not out:
        lines = (f"{one.doubt} (what was found instead is at {other:.2f} m)" for one, other in out)
        return left, tuple(lines)
    if any(gross(relation.value, otherwise) for relation, otherwise in out):
        told = "; ".join(
            f"{one.name} is given as {one.value:.3f} m, but the rest says {other:.2f} m" for one, other in out
        )
        raise contradiction(problem, told)
    return problem, ()


def contradiction(problem: Problem, what: str) -> SolveError:
    """The error for references that cannot all be right, with what is off and what to do."""
    return SolveError(
        f"row {problem.frames.facts.name}: the references contradict one another or the video: {what}; "
        "measure again what is named, or leave it out where the video does not show that part (`savmap check` draws what is seen)"
    )


def readings(problem: Problem, cameras: Floats, points: Floats) -> list[tuple[Problem, tuple[str, ...]]]:
    """The problem with one set of every room's alternatives, best first, and a line about each set: those that agree with
    the linear start, cameras (f, 3) and points (m, 3) up to scale and shift, about as well as the best one does."""
    found: list[tuple[Problem, tuple[str, ...]]] = [(problem, ())]
    for room in (one for one in problem.rooms if one.alternatives):
        ways = _distinct(room.alternatives)
        found = [
            (replace(before, relations=(*before.relations, *relations)), (*told, name))
            for before, told in found
            for name, relations in ways.items()
        ]
    misfits = np.array([_misfit(way, cameras, points) for way, _ in found]) if len(found) > 1 else np.zeros(1)
    order = np.argsort(misfits, kind="stable").tolist()
    return [found[k] for k in order if misfits[k] <= CLEARLY * misfits.min()]


def _distinct(alternatives: Mapping[str, tuple[Relation, ...]]) -> dict[str, tuple[Relation, ...]]:
    """Alternatives that differ in more than their names; those that do not share one."""
    told: dict[tuple[Relation, ...], list[str]] = {}
    for name, relations in alternatives.items():
        told.setdefault(relations, []).append(name)
    return {" or ".join(names): relations for relations, names in told.items()}


def _misfit(problem: Problem, cameras: Floats, points: Floats) -> float:
    """Root mean square of what the references leave unexplained of one another, m."""
    fixed = problem.frames.fixed is not None
    similarity = scale.IDENTITY if fixed else scale.fit(problem, cameras, points, START_SIGMA_M)
    rows = [scale.equation(problem, relation, points) for relation in problem.relations if relation.name]
    return float(np.sqrt(np.mean([(r[4] - r[0] * similarity.scale - r[1:4] @ similarity.shift) ** 2 for r in rows])))


def gross(value: float, otherwise: float) -> bool:
    """Whether a reference is off by so much that another thing was measured or taken for it, or a wrong figure typed: a
    beam's setback or a mask's bias cannot be it."""
    return abs(otherwise - value) > max(GROSS_M, GROSS_PART * abs(value))


def _refuted(problem: Problem, cameras: Floats, points: Floats) -> Doubt | None:
    """The doubtful reference that fits worst, grossly and worse than any that is not, with what the others make of it."""
    worst: tuple[float, Doubt] | None = None
    for relation, off, otherwise in _deviations(problem, cameras, points):
        if off > REFUTED_SIGMA and (worst is None or off > worst[0]):
            worst = off, (relation, otherwise)
    if worst is None or not worst[1][0].doubt or abs(worst[1][1] - worst[1][0].value) < REFUTED_M:
        return None
    return worst[1]


def _deviations(problem: Problem, cameras: Floats, points: Floats) -> Iterator[tuple[Relation, float, float]]:
    """Each named relation, how many sigmas it is off what the others say, and what they say, m."""
    fixed = problem.frames.fixed is not None
    similarity = scale.IDENTITY if fixed else scale.fit(problem, cameras, points, START_SIGMA_M)
    for relation in (one for one in problem.relations if one.name):
        row = scale.equation(problem, relation, points)
        sigma = float(np.hypot(row[5], START_SIGMA_M))
        misfit = float(row[4] - row[0] * similarity.scale - row[1:4] @ similarity.shift)
        spare = 1.0 - float(row[:4] @ similarity.covariance @ row[:4]) / sigma**2
        if spare > LEAST_SPARE:
            yield relation, abs(misfit) / (sigma * float(np.sqrt(spare))), relation.value - misfit / spare
