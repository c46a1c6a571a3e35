"""What nothing checks: by how much references may be wrong before the pictures or the other references show it, and how
far the map is wrong then (reliability, after Baarda)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.graph.covariance import Covariance
from savmap.graph.keys import rekey
from savmap.graph.problem import Estimate, Problem
from savmap.graph.solver.judgement.agreement import Agreement, Names
from savmap.graph.solver.judgement.reference_tests import solved_references, stated
from savmap.types import Floats

UNCHECKED_SIGMA, UNKNOWN_M = 5.0, 1.0
SURELY = 1.0
"""Errors of as many standard deviations as are critical are noticed in half of all cases, with one more in five of six.
"""
NAMED, COMPARED = 2, 4
"""Of the references of a note; of those whose value by all others is told."""


@dataclass(frozen=True)
class Unchecked:
    """References by `names`, `what` for people, that may be wrong together by `error_m` before anything shows it.
    `alone`: nothing else says anything of them; then the error is as large as they are."""

    what: str
    names: Names
    error_m: float
    single: bool

    @property
    def size(self) -> str:
        """The error, for people."""
        cm = f"{100 * self.error_m:.0f} cm" if self.error_m < 1 else f"{self.error_m:.1f} m"
        return "any error" if self.single else f"an error of {cm}"


def unchecked(problem: Problem, agreed: Agreement, out: Names) -> tuple[tuple[Unchecked, ...], tuple[str, ...]]:
    """Of references that agree without those that are `out`: those that nothing can contradict, for they alone give
    scale or place, then those that the others check so loosely that an error of many standard deviations would stay
    hidden, the largest first; and what to tell the user of them.

    What may be wrong is each, and all heights on the structure, measured from a wrong floor or to a wrong edge. A
    height of 0 is the floor's, by definition."""
    errors = [(name, frozenset({name})) for name in agreed.all_names if name not in out]
    levels = (item for item in problem.relations if item.name and item.axis == "y" and item.b is None and item.value)
    heights = frozenset(item.name for item in levels) - out
    errors += [("all given heights together", heights)] if len(heights) > 1 else []
    hidden = list[Unchecked]()
    for what, names in errors:
        error_m = _unnoticed(agreed, names, out)
        if is_alone(agreed, names, out):
            if len(names) == 1 or not any(item.single for item in hidden):
                hidden.append(Unchecked(what, names, _largest(agreed, names), True))
        elif error_m > UNCHECKED_SIGMA * min(agreed.given(name).sigma for name in names):
            hidden.append(Unchecked(what, names, error_m, False))
    hidden.sort(key=lambda item: (not item.single, -item.error_m))
    return tuple(hidden), tuple(_notes(problem, agreed, out, hidden))


def _notes(problem: Problem, agreed: Agreement, out: Names, hidden: Sequence[Unchecked]) -> Iterator[str]:
    """What to tell the user of errors that would stay `hidden`: a line for each measurement that would check some of
    it, the worst first; then what all others say of single references."""
    cameras = {item.name for item in problem.camera.references.camera_heights} - out
    relations = {relation.name: relation for relation in problem.relations if relation.name}
    heights = {name for name, relation in relations.items() if relation.b is None and relation.axis == "y"}
    by_remedy: dict[str, list[Unchecked]] = {}
    for item in hidden:
        remedy = "one more length"
        if not any(relation.b is not None for relation in relations.values()):
            remedy = "a length"
        elif item.names <= heights:
            remedy = f"the camera's height{', more exactly' if cameras else ''}"
        elif item.names <= cameras and not heights:
            remedy = "a height on the structure"
        by_remedy.setdefault(remedy, []).append(item)
    for remedy, items in by_remedy.items():
        first, *others = (item for item in items if 2 * item.error_m > items[0].error_m)  # much smaller ones distract
        lines = [f"{first.what} ({first.size} would stay hidden)", *(f"{item.what} ({item.size})" for item in others)]
        more = f" and {len(lines) - NAMED} more" if len(lines) > NAMED else ""
        what = "them" if others or len(first.names) > 1 else "it"
        yield f"not checked by a second reference: {', '.join(lines[:NAMED])}{more}. To check {what}: {remedy}"
    singles = (name for item in hidden if not item.single and len(item.names) == 1 for name in item.names)
    for name in list(singles)[:COMPARED]:
        value, sigma = agreed.rest(name, out)
        given = stated(agreed.given(name), name not in problem.not_given)
        yield f"{given}; all others say {value:.3f} m +- {sigma:.3f} m"


def moves(rows: Sequence[tuple[Problem, Estimate, Sequence[Unchecked]]], whole: Covariance) -> Floats:
    """How far (k, 3m) the points of a covariance move with each unchecked error of the rows that it is of. What has the
    same name and value in several rows is one reference."""
    gains, values = dict[tuple[str, float], Floats](), [dict[str, float]() for _ in rows]
    for row, (problem, estimate, _) in enumerate(rows):
        for item in solved_references(problem, estimate):
            name, value = item.use.name, item.use.value
            gain = whole.estimated_with([rekey(key, row) for key in item.keys]) @ item.slope / item.use.sigma**2
            gains[name, value] = gains.get((name, value), 0.0) + gain
            values[row][name] = value
    moved = [
        item.error_m * np.sum([gains[name, value_of[name]] for name in sorted(item.names)], axis=0)
        for value_of, (_, _, hidden) in zip(values, rows, strict=True)
        for item in hidden
    ]
    return np.array(moved).reshape(-1, len(whole.points))


def is_alone(agreed: Agreement, names: Names, out: Names) -> bool:
    """Whether no other reference that is not `out` says anything of these."""
    return _unnoticed(agreed, names, out) > _largest(agreed, names)


def _largest(agreed: Agreement, names: Names) -> float:
    return max(UNKNOWN_M, *(abs(agreed.given(name).value) for name in names))


def _unnoticed(agreed: Agreement, names: Names, out: Names) -> float:
    """The error of references, common to all of them, m, that the rest notices in five of six cases only."""
    return (agreed.critical + SURELY) * agreed.common_error(names, out)
