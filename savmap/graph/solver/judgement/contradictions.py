"""References that the pictures and the other references contradict are found before any measurement is rejected in
favour of one.

In a solve with stiff references, a wrong one wins: what was seen of its own landmark does not fit any more, and is
rejected. So the row is solved with `softened` references first. Its shape is that of the pictures then, and only what
they leave open follows the references, which are compared with it and with one another (see `agreement`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import orth

from savmap.graph.constraints import Relation
from savmap.graph.covariance import Covariance
from savmap.graph.initial.gaps import where_frames_are_missing
from savmap.graph.initial.observability import SCALE_LIMIT
from savmap.graph.initial.outlier_references import (
    REFUTED_M,
    REFUTED_SIGMA,
    contradiction,
    is_gross,
    line_of,
    not_seen,
)
from savmap.graph.problem import Estimate, Problem
from savmap.graph.solver.judgement.agreement import Agreement, Names, Solved
from savmap.graph.solver.judgement.reference_tests import off_by, solved_references, stated
from savmap.graph.solver.judgement.soft_references import with_sigmas, without
from savmap.graph.solver.judgement.unchecked import Unchecked, is_alone, unchecked
from savmap.types import Floats, MapWarning
from savmap.types.maps import OFF_SIGMAS

KNOWN_M = 0.05
NAMED, AT_LEAST_NAMED = 4, 2
ABSURD = 10.0
"""What differs by so many times a figure, or as many metres, is no other figure: something else was taken for what it
is of."""
NOTHING_SIGMA = 3.0
"""A distance that is no more standard deviations than these may be nothing."""
LEAST_LEFT, LEAST_CHECKED = 4, 3
"""So many references check one another, and so few check one of them: two give scale and place."""
SEVERAL, LARGE_SHARE = 3, 0.4
"""As many wrong references, at this share of all, are more likely those of another row than as many mistakes."""
Place = tuple[float, float, float]
UNITS = {"feet": 0.3048, "inches": 0.0254, "centimetres": 0.01, "millimetres": 0.001}
UNIT_SIGMA, BY_CHANCE = 2.0, 0.05
"""A value is taken to be in another unit where it is right in that to so many standard deviations, and where a wrong
value would be so in one of the units in at most such a share of cases: a mistake in reading, typing or of the landmark
may give any value up to the larger one."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """The problem without the references that are wrong; where it is not clear which one is, with all of them as
    uncertain as they contradict one another. Notes for the user, warnings, errors that would stay `hidden`, and notes
    of these. `unseen`: to how many metres what references are of was seen, where that was not seen well. `given`: the
    problem with all references as they were given, where they differ."""

    problem: Problem
    notes: tuple[str, ...] = ()
    warnings: tuple[MapWarning, ...] = ()
    hidden: tuple[Unchecked, ...] = ()
    unchecked: tuple[str, ...] = ()
    unseen: Mapping[str, float] = field(default_factory=dict)
    given: Problem | None = None


def agreement(soft: Problem, given: Problem, estimate: Estimate, covariance: Covariance) -> Agreement:
    """How the given references agree with the estimate of the softened problem, which has this covariance."""
    solved = list(solved_references(soft, estimate))
    keys = sorted({key for item in solved for key in item.keys})
    slopes = np.zeros((len(solved), 3 * len(keys)))
    for row, item in zip(slopes, solved, strict=True):
        row.reshape(-1, 3)[[keys.index(key) for key in item.keys]] = item.slope.reshape(-1, 3)
    sigmas = np.array([item.use.sigma for item in solved_references(given, estimate)])
    values, softness, solution = np.array([(item.use.value, item.use.sigma, item.use.solved) for item in solved]).T
    names = tuple(item.use.name for item in solved)
    joint = slopes @ covariance.of(keys) @ slopes.T
    return Agreement.of(names, values, sigmas, Solved(solution, softness, joint, _gauge(soft, solution, slopes)))


def _gauge(problem: Problem, solution: Floats, slopes: Floats) -> Floats:
    """How references' values (r,) with slopes (r, 3n) to points change where the scene is scaled, and where it is moved
    along each axis whose origin is not fixed: orthonormal (r, g). Nothing is free where the camera's path is given."""
    if problem.camera.fixed is not None:
        return np.zeros((len(solution), 0))
    fixed = {item.column for item in problem.relations if item.b is None and not item.name}
    moved = slopes.reshape(len(solution), -1, 3).sum(axis=1)
    return np.asarray(orth(np.column_stack([solution, moved[:, [axis for axis in range(3) if axis not in fixed]]])))


def judgement_of(soft: Problem, problem: Problem, estimate: Estimate, covariances: Iterator[Covariance]) -> Judgement:
    """The problem without what is wrong in it, from the estimate of the softened problem and its covariances: that of
    the solve, and, where that contradicts a reference, that in which points whose measurements are at no one place
    count less.

    Raises SolveError where references contradict one another so that most of them may be wrong, or grossly without
    telling which is wrong, or at all where the user wants that; never for what is presumed.
    """
    agreed = agreement(soft, problem, estimate, next(covariances))
    explained = _possible(problem, agreed, _explanations(problem, agreed))
    unseen = dict[str, float]()
    if explained and explained[0]:
        seen = agreement(soft, problem, estimate, next(covariances))
        while vague := dict(_unseen(agreed, seen, explained, frozenset((*problem.presumed, *unseen)))):
            unseen |= vague
            agreed = replace(agreed, unseen=np.array([unseen.get(name, 0.0) for name in agreed.names]))
            explained = _possible(problem, agreed, _explanations(problem, agreed))
    return replace(_judged(problem, agreed, explained, estimate), unseen=unseen)


def _unseen(
    agreed: Agreement, seen: Agreement, explained: Sequence[Names], settled: Names
) -> Iterator[tuple[str, float]]:
    """The suspects, but those `known`, of what was not seen so well that it contradicts them, and to how many metres it
    was `seen`."""
    for suspects in explained:
        for name in suspects - settled:
            given, (rest, _), (_, sigma) = agreed.given(name), agreed.rest(name, suspects), seen.rest(name, suspects)
            if abs(rest - given.value) < OFF_SIGMAS * np.hypot(given.sigma, sigma):
                yield name, sigma


def _judged(problem: Problem, agreed: Agreement, explained: Sequence[Names], estimate: Estimate) -> Judgement:
    """What follows from the sets of references that may be wrong."""
    if explained and not explained[0]:
        return Judgement(
            problem, (), tuple(_granted(problem, agreed, explained[0])), *unchecked(problem, agreed, explained[0])
        )
    clear = len(explained) == 1 and _is_credible(problem, agreed, explained[0])
    wanted = problem.camera.references.on_contradiction
    if explained and explained[0] <= frozenset(problem.presumed):
        if clear:
            return _left_out(problem, estimate, agreed, explained[0], wanted != "leave_out")
        return _presumed_less(problem, agreed, explained[0])
    suspects = _suspects(agreed, explained, clear)
    lines = [f"{_line(problem, agreed, *suspect)}{in_unit(agreed, *suspect)}" for suspect in suspects]
    gross = any(is_gross(agreed.given(name).value, agreed.rest(name, out)[0]) for name, out in suspects)
    if not explained or wanted == "refuse" or (not clear and gross):
        mistaken = frozenset[str]() if wanted == "refuse" else _mistaken(problem, agreed, explained)
        if not mistaken:
            raise contradiction(problem, "; or ".join(lines[:NAMED]))
        return _left_out(problem, estimate, agreed, mistaken, wanted == "check")
    if clear:
        return _left_out(problem, estimate, agreed, explained[0], wanted == "check")
    return _uncertain(problem, agreed, suspects, lines)


def _mistaken(problem: Problem, agreed: Agreement, explained: Sequence[Names]) -> Names:
    """References to parts that may have been taken for others, as many as must be left out, the one that deviates most
    first, for the rest to agree and to check itself; or all of them, where others agree and tell what they would have;
    none where that is not so, or where others alone explain it. A part that was taken for another says nothing against
    a row."""
    parts, out = _mistakable(problem, agreed), frozenset[str]()
    if explained and not any(suspects <= parts for suspects in explained):
        return out
    while not agreed.agrees(out) and parts - out and len(agreed.all_names) - len(out) > LEAST_CHECKED:
        deviations = agreed.deviations(out)
        out |= {max(parts - out, key=lambda name: deviations[name])}
    if agreed.agrees(out):
        return out
    return parts if agreed.agrees(parts) and _is_credible(problem, agreed, parts) else frozenset()


def _explanations(problem: Problem, agreed: Agreement) -> list[Names]:
    """The sets of references that may be wrong. What is presumed is so before anything that was given. Those passed
    over are taken for likelier than others where that leaves enough to check one another; and one cause for all parts,
    that the same thing was taken for each, than several mistakes."""
    presumed = frozenset(problem.presumed)
    if presumed and agreed.agrees(presumed) and not agreed.agrees():
        return [presumed]
    explained = agreed.explanations(presumed | _passed_over(problem, agreed))
    if not all(len(agreed.all_names) - len(out) >= LEAST_LEFT for out in explained):
        explained = agreed.explanations(presumed)
    parts = _mistakable(problem, agreed)
    if any(len(out) < 2 or out <= parts for out in explained) or len(agreed.all_names) - len(parts) < LEAST_CHECKED:
        return explained
    return [parts] if agreed.agrees(parts) and _is_credible(problem, agreed, parts) else explained


def _mistakable(problem: Problem, agreed: Agreement) -> Names:
    """References to parts that may have been taken for others."""
    return frozenset(item.name for item in problem.relations if item.note_if_outlier) & {*agreed.all_names}


def _passed_over(problem: Problem, agreed: Agreement) -> Names:
    """References that seem to be of something that was not seen, the next one up in its place: at most half of those of
    their kind. Goods hide the lowest beams of several bays as easily as that of one."""
    kind = _mistakable(problem, agreed)
    higher = frozenset(name for name in kind if agreed.off[agreed.at(name)[0]] > REFUTED_M)
    return higher if 2 * len(higher) <= len(kind) else frozenset()


def _suspects(agreed: Agreement, explained: Sequence[Names], clear: bool) -> list[tuple[str, Names]]:
    """References that may be wrong, each with those that are left out with it: those that explain the contradiction
    and, where these are few or nothing explains it, those that deviate most."""
    suspects = {name: (name, out) for out in explained for name in sorted(out)}
    deviations = agreed.deviations()
    for name in sorted(deviations, key=lambda name: -deviations[name]):
        if not clear and len(suspects) < AT_LEAST_NAMED:
            suspects.setdefault(name, (name, frozenset({name})))
    return list(suspects.values())


def _is_credible(problem: Problem, agreed: Agreement, out: Names) -> bool:
    """Whether the rest determines what the references that are left out would have, or surely something else was seen
    than these are of; and they are not all those that give the scale."""
    scales, passed = _scales(problem), _passed_over(problem, agreed)

    def is_known(name: str) -> bool:
        (value, sigma), given = agreed.rest(name, out), agreed.given(name).value
        surely = name in passed and value - given > max(REFUTED_M, REFUTED_SIGMA * sigma)
        return surely or sigma < max(KNOWN_M, SCALE_LIMIT * abs(given))

    return all(map(is_known, out)) and not (len(scales) > 1 and scales <= out)


def _possible(problem: Problem, agreed: Agreement, explained: list[Names]) -> list[Names]:
    """The explanations that leave the scene some extent; all of them where none does. Equal heights of several bays
    also agree in a scene that has shrunk to a point, where every distance is 0. No such scene is real."""
    lengths = frozenset(item.name for item in problem.relations if item.name and item.b is not None)

    def is_nothing(name: str, out: Names) -> bool:
        value, sigma = agreed.rest(name, out)
        return value < NOTHING_SIGMA * sigma and value + NOTHING_SIGMA * sigma < agreed.given(name).value / ABSURD

    return [out for out in explained if not any(is_nothing(name, out) for name in lengths & out)] or explained


def _left_out(problem: Problem, soft: Estimate, agreed: Agreement, out: Names, warned: bool) -> Judgement:
    """Without those that do not fit. One whose landmark was evidently not seen, as the next one up was found, is worth
    a note. What is presumed is no reference of the user's: without it the scale or the place rest on fewer."""
    notes, warnings = list[str](), list[MapWarning]()
    for name in sorted(out):
        relation = next((item for item in problem.relations if item.name == name), None)
        otherwise, _ = agreed.rest(name, out)
        place = _place(problem, soft, relation)
        if relation is not None and relation.presumed:
            notes.append(line_of(relation, otherwise))
            harmless, warning = False, MapWarning("doubtful-scale", details=(notes[-1],))
        elif relation is not None and relation.note_if_outlier and otherwise > relation.value + REFUTED_M:
            notes.append(line_of(relation, otherwise))
            harmless, warning = relation.may_be_missing, not_seen(relation, otherwise, place)
        else:
            unit = in_unit(agreed, name, out)
            details = [f"{_line(problem, agreed, name, out)}{unit}: it is not used"]
            notes.append(f"{details[0]}; measure it again")
            if not unit and is_gross(agreed.given(name).value, otherwise):
                gap = where_frames_are_missing(problem)
                details.append(f"a part of the row may be missing from the map{f' ({gap})' if gap else ''}")
            harmless, warning = False, _conflict(agreed, (name,), (name, out), details, place)
        if warned and not harmless:
            warnings.append(warning)
    if len(warnings) >= max(SEVERAL, LARGE_SHARE * len(agreed.all_names)):
        count = f"{len(warnings)} of {len(agreed.all_names)}"
        line = f"{count} contradict the rest: check that they are of this row, and its `side`"
        warnings[0] = replace(warnings[0], details=(line, *warnings[0].details))
    warnings += _granted(problem, agreed, out)
    return Judgement(without(problem, out), tuple(notes), tuple(warnings), *unchecked(problem, agreed, out))


def _presumed_less(problem: Problem, agreed: Agreement, out: Names) -> Judgement:
    """With what is presumed as uncertain as it deviates: without it the rest does not give scale or place."""
    deviations = agreed.deviations()
    wider = {name: deviations[name] * agreed.given(name).sigma for name in out}
    details = tuple(problem.presumed[name] for name in sorted(out))
    warnings = (MapWarning("doubtful-scale", details=details), *_granted(problem, agreed, frozenset()))
    return Judgement(with_sigmas(problem, wider), details, warnings, *unchecked(problem, agreed, frozenset()))


def _uncertain(
    problem: Problem, agreed: Agreement, suspects: Sequence[tuple[str, Names]], lines: Sequence[str]
) -> Judgement:
    """With all of them, each as uncertain as it deviates."""
    wider = {name: abs(agreed.given(name).value - agreed.rest(name, out)[0]) for name, out in suspects}
    details = ["which one is wrong is not clear; each is used as inaccurate as it is off", *lines]
    if problem.camera.calibration is None:  # lenses that stand apart bend the scene
        details.append(
            "if they are right, the camera's lenses may not fit together: try `calibration: {lens_distance: true}`, or "
            "`{panorama: true}`"
        )
    worst = max(suspects, key=lambda item: wider[item[0]])
    warning = _conflict(agreed, [name for name, _ in suspects], worst, details)
    return Judgement(with_sigmas(problem, wider), notes=(warning.line,), warnings=(warning,))


def _granted(problem: Problem, agreed: Agreement, out: Names) -> Iterator[MapWarning]:
    """A warning about each reference that nobody measured and nothing checks: with it the map's scale or place is taken
    for granted."""
    for name in problem.presumed:
        if name not in out and is_alone(agreed, frozenset({name}), out):
            why = (
                f"scale or place rest on the {name}, and the floor itself does not show where it is: guards or goods "
                "may hide it, and the map is wrong by as much then; give a length, or a height on the structure"
            )
            yield MapWarning("doubtful-scale", details=(why,))


def _scales(problem: Problem) -> Names:
    """References that give the scale each by itself, with where the floor is: camera heights and distances."""
    heights = (item.name for item in problem.camera.references.camera_heights)
    return frozenset((*heights, *(item.name for item in problem.relations if item.name and item.b is not None)))


def _conflict(
    agreed: Agreement,
    names: Sequence[str],
    worst: tuple[str, Names],
    details: Sequence[str],
    place: Place | None = None,
) -> MapWarning:
    """The warning about references that contradict the rest, of which one is the furthest off without some others."""
    use, (otherwise, sigma) = agreed.given(worst[0]), agreed.rest(*worst)
    figure, off = off_by(otherwise - use.value, float(np.hypot(use.sigma, sigma))), abs(otherwise - use.value)
    return MapWarning("reference-conflict", tuple(names), figure, place, details=tuple(details), size=off)


def _line(problem: Problem, agreed: Agreement, name: str, out: Names) -> str:
    use = agreed.given(name)
    otherwise, sigma = agreed.rest(name, out)
    says = f"says {otherwise:.3f} m +- {sigma:.3f} m"
    is_size = name in _scales(problem)  # cameras are above the floor, and ends apart
    if abs(otherwise - use.value) > ABSURD * max(abs(use.value), 1.0) or (is_size and otherwise <= 0 < use.value):
        says = "does not fit it at all"
    return f"{stated(use, name not in problem.not_given)}, but the rest {says}"


def in_unit(agreed: Agreement, name: str, out: Names) -> str:
    """A hint, where a reference seems to be given in another unit, in which it is what the rest says by no chance."""
    use, (otherwise, sigma) = agreed.given(name), agreed.rest(name, out)
    for unit, metres in UNITS.items():
        within = UNIT_SIGMA * float(np.hypot(use.sigma * metres, sigma))
        if abs(use.value * metres - otherwise) <= within:
            likely = len(UNITS) * 2 * within < BY_CHANCE * max(abs(use.value), abs(otherwise))
            return f" ({use.value:.3f} {unit} are {use.value * metres:.3f} m)" if likely else ""
    return ""


def _place(problem: Problem, soft: Estimate, relation: Relation | None) -> Place | None:
    """Where a reference's landmarks are, m. Edges of uprights, of which nobody measured where along them they are, are
    put in the middle."""
    if relation is None:
        return None
    ends = [soft.points[problem.index(key)] for key in (relation.a, relation.b) if key is not None]
    place = np.mean(ends, axis=0)
    if relation.axis == "x":
        place[1:] = np.median(soft.points[:, 1:], axis=0)
    x, y, z = place.tolist()
    return x, y, z
