"""References whose landmark may have been taken for another: those that all others refute are left out for a first
solve.

The user's figure is right, but the edge that it was measured to was not seen, and the next one was taken for it. The
linear start does not use references, and they are linear in its scale and shift (see `observability`): Baarda's data
snooping on these few equations finds the one that does not belong.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from savmap.errors import SolveError
from savmap.graph.constraints import Relation
from savmap.graph.initial.gaps import where_frames_are_missing
from savmap.graph.initial.observability import IDENTITY, Similarity, equation, fit
from savmap.graph.problem import Problem
from savmap.types import Floats, MapWarning

START_SIGMA_M = 0.05
REFUTED_SIGMA, REFUTED_M = 5.0, 0.25
GROSS_M, GROSS_PART = 0.5, 0.1
CLEARLY = 2.0
LEAST_SPARE = 1e-3

OutlierReference = tuple[Relation, float]
"""A reference, and what the others say its value is, m."""


def without_outliers(problem: Problem, cameras: Floats, points: Floats) -> tuple[Problem, tuple[OutlierReference, ...]]:
    """The problem without the references that the others refute, and these.

    cameras (f, 3), points (m, 3): the scene up to scale and shift (as it is, with fixed poses). Only a minority of
    those with a `note_if_outlier` is left out.
    """
    candidates = sum(bool(relation.note_if_outlier) for relation in problem.relations)
    left, out = problem, list[OutlierReference]()
    while (outlier := _refuted(left, cameras, points)) is not None:
        out.append(outlier)
        left = replace(left, relations=tuple(relation for relation in left.relations if relation is not outlier[0]))
    return (left, tuple(out)) if 2 * len(out) < candidates else (problem, ())


def line_of(relation: Relation, otherwise: float) -> str:
    """A line for the user about a reference that is left out, for its landmark was not seen."""
    return f"{relation.presumed or relation.note_if_outlier} (what was found instead is at {otherwise:.2f} m)"


def not_seen(relation: Relation, otherwise: float, place: tuple[float, float, float] | None = None) -> MapWarning:
    """The warning about such a reference."""
    figure = f"found at {otherwise:.2f} m, given {relation.value:.2f} m"
    off = abs(otherwise - relation.value)
    details = (line_of(relation, otherwise),)
    return MapWarning("reference-conflict", (relation.name,), figure, place, details=details, size=off)


def contradiction(problem: Problem, what: str) -> SolveError:
    """The error for references that cannot all be right, with which ones contradict, where frames are missing, and what
    to do."""
    gap = where_frames_are_missing(problem)
    return SolveError(
        f"row {problem.camera.facts.name}: the references contradict one another or the video: {what}; "
        + (f"{gap}; " if gap else "")
        + "measure again what is named, or leave it out where the video does not show that part "
        "(`savmap check` draws what is seen)"
    )


def consistent_alternatives(problem: Problem, cameras: Floats, points: Floats) -> list[tuple[Problem, tuple[str, ...]]]:
    """The problem with one set of every plugin's alternatives, best first, and the description of each set: those that
    agree with the linear start, cameras (f, 3) and points (m, 3) up to scale and shift, about as well as the best one
    does."""
    chosen: list[tuple[Problem, tuple[str, ...]]] = [(problem, ())]
    for part in (part for part in problem.parts if part.alternatives):
        sets = _distinct(part.alternatives)
        chosen = [
            (replace(before, relations=(*before.relations, *relations)), (*names, name))
            for before, names in chosen
            for name, relations in sets.items()
        ]
    misfits = np.array([_misfit(choice, cameras, points) for choice, _ in chosen]) if len(chosen) > 1 else np.zeros(1)
    order = np.argsort(misfits, kind="stable").tolist()
    return [chosen[k] for k in order if misfits[k] <= CLEARLY * misfits.min()]


def _distinct(alternatives: Mapping[str, tuple[Relation, ...]]) -> dict[str, tuple[Relation, ...]]:
    """Sets of relations that differ in more than what they are called; equal ones are a set under both names."""
    names_of: dict[tuple[Relation, ...], list[str]] = {}
    for name, relations in alternatives.items():
        nameless = tuple(replace(relation, name="", note_if_outlier="") for relation in relations)
        names_of.setdefault(nameless, []).append(name)
    return {" or ".join(names): alternatives[names[0]] for names in names_of.values()}


def _misfit(problem: Problem, cameras: Floats, points: Floats) -> float:
    """Root mean square of what the references leave unexplained of one another, m."""
    similarity = _fit(problem, cameras, points)
    rows = [equation(problem, relation, points) for relation in problem.relations if relation.name]
    return float(np.sqrt(np.mean([(r[4] - r[0] * similarity.scale - r[1:4] @ similarity.shift) ** 2 for r in rows])))


def is_gross(value: float, otherwise: float) -> bool:
    """Whether a reference is off by so much that another object was measured or taken for it, or a wrong figure typed:
    an edge's setback or a mask's bias is smaller."""
    return abs(otherwise - value) > max(GROSS_M, GROSS_PART * abs(value))


def _refuted(problem: Problem, cameras: Floats, points: Floats) -> OutlierReference | None:
    """The worst reference, where it is grossly off and has a `note_if_outlier`, with what the others say."""
    deviations = [*_deviations(problem, cameras, points)]
    relation, deviation, otherwise = max(deviations, key=lambda tested: tested[1], default=(None, 0.0, 0.0))
    if relation is None or deviation <= REFUTED_SIGMA or not relation.note_if_outlier:
        return None
    return None if abs(otherwise - relation.value) < REFUTED_M else (relation, otherwise)


def _deviations(problem: Problem, cameras: Floats, points: Floats) -> Iterator[tuple[Relation, float, float]]:
    """Each named relation, by how many standard deviations the others contradict it, and what they say, m."""
    similarity = _fit(problem, cameras, points)
    for relation in (relation for relation in problem.relations if relation.name):
        row = equation(problem, relation, points)
        sigma = float(np.hypot(row[5], START_SIGMA_M))
        misfit = float(row[4] - row[0] * similarity.scale - row[1:4] @ similarity.shift)
        spare = 1.0 - float(row[:4] @ similarity.covariance @ row[:4]) / sigma**2
        if spare > LEAST_SPARE:
            yield relation, abs(misfit) / (sigma * float(np.sqrt(spare))), relation.value - misfit / spare


def _fit(problem: Problem, cameras: Floats, points: Floats) -> Similarity:
    return IDENTITY if problem.camera.fixed is not None else fit(problem, cameras, points, START_SIGMA_M)
