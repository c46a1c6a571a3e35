"""Rows seen on one drive, solved as one: what is known of one row serves the others, for it is one camera path.

Every row is solved by itself first, which rejects what does not fit. Then one graph holds all rows, each in its own frame of
coordinates with what was kept, and the poses of shared frames are tied (see `ties`). A row's covariance is its part of the whole
one. Where rows contradict one another so, each keeps its own solution.
"""

from collections.abc import Callable, Collection, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import gtsam
import numpy as np
from scipy.sparse import block_diag, csc_array

from savmap.errors import SolveError
from savmap.graph.carry import carried_factor, carried_key, carried_values, row_of, values_of_row
from savmap.graph.covariance import Covariance, Covariances, Shared, covariance
from savmap.graph.factors import HUBER, estimate_of, observation_factors, other_factors, values_of
from savmap.graph.keys import centre_key, frame_key
from savmap.graph.markers import ROOM as MARKERS
from savmap.graph.once import counted_once, level_floor
from savmap.graph.optimise import LevenbergMarquardt, SolveOptions, State, concluded, settled, shared_biases
from savmap.graph.order import Place, hubs, ordered, places
from savmap.graph.problem import Problem
from savmap.graph.residuals import fit_of
from savmap.graph.solution import Solution
from savmap.graph.ties import Tie, first_transform, tie_factors, ties_of
from savmap.graph.verdicts import tested_keys
from savmap.types import Floats, Ints

OFF_SIGMA = 5.0
WORSE = 1.5
Moments = Sequence[Sequence[Hashable]]
Result = TypeVar("Result")


def solve_rows(
    problems: Sequence[Problem], moments: Moments, everywhere: Collection[str] = (), options: SolveOptions | None = None
) -> list[Solution | SolveError]:
    """Solutions of rows, together where they share frames: moments[r][f] tells which picture frame f of row r is.

    `everywhere`: rooms whose things, as markers, are seen from all rows, and that several rows therefore tell of. A row that
    cannot be solved by itself comes back as its error, and the others are solved without it; rows that make no sense
    together are solved apart and say so.
    """
    found: list[State | SolveError] = [_attempt(settled, problem, options) for problem in problems]
    states = {row: own for row, own in enumerate(found) if isinstance(own, State)}
    number: dict[Hashable, int] = {}
    pictures = [[number.setdefault(moment, len(number)) for moment in moments[row]] for row in states]
    solutions = iter(_solutions(list(states.values()), pictures, everywhere))
    return [own if isinstance(own, SolveError) else next(solutions) for own in found]


def _solutions(
    states: Sequence[State], moments: Moments, everywhere: Collection[str]
) -> Sequence[Solution | SolveError]:
    ties = ties_of([state.problem.used for state in states], moments)
    apart: tuple[str, ...] = ()
    if ties:
        try:
            return Together(states, ties, moments, {*everywhere, MARKERS}).solutions()
        except SolveError as error:
            apart = (f"mapped without the other rows of this drive, for together they make no sense: {error}",)
    notes = [replace(state, notes=(*state.notes, *apart)) for state in states]
    return [_attempt(concluded, state) for state in notes]


def _attempt(solve: Callable[..., Result], *arguments: object) -> Result | SolveError:
    try:
        return solve(*arguments)
    except SolveError as error:
        return error


@dataclass(frozen=True)
class Together:
    """Rows at their own optima, and what they share."""

    states: Sequence[State]
    ties: Sequence[Tie]
    moments: Moments
    everywhere: Collection[str]

    def solutions(self) -> list[Solution]:
        """The joint optimum, row by row. Raises SolveError where the rows contradict one another."""
        problems = counted_once([state.problem for state in self.states], self.moments, self.everywhere)
        begin = [replace(state, problem=problem) for state, problem in zip(self.states, problems, strict=True)]
        values = self._begin(begin)
        graph = self._graph(begin, values, robust=True)
        values = LevenbergMarquardt(self._names, self._order(begin, values)).minimum(graph, values)
        found = [
            replace(_moved(own, values, row), problem=problem)
            for row, (own, problem) in enumerate(zip(self.states, problems, strict=True))
        ]
        _require_pictures_fit(self.states, found)
        asked = {carried_key(key, row) for row, state in enumerate(found) for key in tested_keys(state.problem)}
        tested = _parts(found, self._covariance(found, values, asked))
        told = _parts(found, self._covariance([state.told for state in found], values))
        solutions = [
            concluded(replace(new, problem=own.problem), Covariances(*parts))
            for own, new, *parts in zip(self.states, found, tested, told, strict=True)
        ]
        _require_references_fit(self.states, solutions)
        return [replace(one, report={**one.report, "solved_together": self._names}) for one in solutions]

    @property
    def _names(self) -> str:
        return "rows " + " and ".join(state.problem.frames.facts.name for state in self.states)

    def _begin(self, states: Sequence[State]) -> gtsam.Values:
        values = gtsam.Values()
        for row, state in enumerate(states):
            values.insert(carried_values(values_of(state.problem, state.estimate), row))
        for tie in self.ties:
            values.insert(
                tie.key, first_transform(_poses(states[tie.a], tie.frames_a), _poses(states[tie.b], tie.frames_b))
            )
        return values

    def _order(self, states: Sequence[State], values: gtsam.Values) -> gtsam.Ordering:
        """Variables by their places along the aisle, as the first row of each group has it."""
        aisle_from_row = {tie.b: (tie.a, values.atPose3(tie.key)) for tie in reversed(self.ties)}
        spots, late = list[Place](), [tie.key for tie in self.ties]
        for row, state in enumerate(states):
            lead, transform = aisle_from_row.get(row, (row, gtsam.Pose3()))
            if lead in aisle_from_row:
                transform = aisle_from_row[lead][1].compose(transform)
            spots += places(state.problem, state.estimate, transform, row)
            late += hubs(state.problem, row)
        return ordered(spots, late)

    def _graph(self, states: Sequence[State], values: gtsam.Values, robust: bool) -> gtsam.NonlinearFactorGraph:
        """All rows' factors and the ties, the observations' last."""
        graph = gtsam.NonlinearFactorGraph()
        for row, state in enumerate(states):
            others = other_factors(state.problem, state.estimate)
            for factor in (others.at(number) for number in range(others.size())):
                graph.add(carried_factor(factor, row))
        for tie in self.ties:
            for factor in tie_factors(tie, values.atPose3(tie.key)):
                graph.add(factor)
        for factor in level_floor([state.problem for state in states]):
            graph.add(factor)
        for row, state in enumerate(states):
            huber = HUBER * state.fit.scale / float(np.sqrt(state.inflation)) if robust else None
            for factor in observation_factors(state.kept, state.inflation, huber):
                graph.add(carried_factor(factor, row))
        return graph

    def _covariance(
        self, states: Sequence[State], values: gtsam.Values, only: Collection[int] | None = None
    ) -> Covariance:
        frames = [carried_key(frame_key(f), row) for row, s in enumerate(states) for f in s.problem.used.tolist()]
        places = [carried_key(centre_key(f), row) for row, s in enumerate(states) for f in s.problem.used.tolist()]
        own = [shared_biases(state, None) for state in states]
        shared = Shared(
            csc_array(block_diag([one.columns for one in own])),
            *(np.concatenate([getattr(one, name) for one in own]) for name in ("value", "prior", "free")),
        )
        graph = self._graph(states, values, robust=False)
        return covariance(graph, values, [*frames, *(tie.key for tie in self.ties)], places, shared, only)


def _poses(state: State, frames: Ints) -> Floats:
    poses: Floats = state.estimate.poses[np.searchsorted(state.problem.used, frames)]
    return poses


def _moved(state: State, values: gtsam.Values, row: int) -> State:
    """A row's state at the joint optimum; what was kept stays so."""
    estimate = estimate_of(state.problem, values_of_row(values, row), state.estimate)
    fit = fit_of(state.problem, estimate, state.fit.kept, np.inf)
    return replace(state, estimate=estimate, fit=replace(fit, kept=state.fit.kept))


def _parts(states: Sequence[State], whole: Covariance) -> list[Covariance]:
    """Each row's part of the joint covariance."""
    rows = np.array([row_of(key) for key in whole.keys])
    places = np.cumsum([0, *(len(state.problem.used) for state in states)])
    biases = np.cumsum([0, *(len(state.bias) for state in states)])
    parts = []
    for row in range(len(states)):
        own = np.flatnonzero(rows == row)
        slots = (3 * own[:, None] + np.arange(3)).ravel()
        bias = slice(biases[row], biases[row + 1])
        parts.append(
            Covariance(
                tuple(carried_key(whole.keys[index], -row) for index in own.tolist()),
                whole.points[np.ix_(slots, slots)],
                whole.places[places[row] : places[row + 1]],
                whole.shared[bias, bias],
                whole.step[bias],
                whole.followed[slots],
            )
        )
    return parts


def _require_pictures_fit(alone: Sequence[State], together: Sequence[State]) -> None:
    for own, new in zip(alone, together, strict=True):
        before, after = (float(np.sqrt(np.mean(state.fit.errors[own.fit.kept] ** 2))) for state in (own, new))
        if after > WORSE * before:
            raise SolveError(
                f"row {own.problem.frames.facts.name}: its pictures do not fit one camera path with the other rows' "
                f"(residuals grow to {after / before:.1f} times)"
            )


def _require_references_fit(alone: Sequence[State], together: Sequence[Solution]) -> None:
    """Raises SolveError for a reference that is off what the rest says by far, and twice as much as in its row alone."""
    for state, solution in zip(alone, together, strict=True):
        if max(solution.off.values(), default=0.0) > OFF_SIGMA:
            before = concluded(state).off
            worse = {name: off for name, off in solution.off.items() if off > max(OFF_SIGMA, 2 * before[name])}
            if worse:
                name = max(worse, key=worse.__getitem__)
                raise SolveError(
                    f"row {state.problem.frames.facts.name}: {name} is {worse[name]:.0f} standard deviations off what the "
                    f"rows say together, {before[name]:.1f} by itself"
                )
