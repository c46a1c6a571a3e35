"""Rows seen on one drive, solved jointly: the references of one row serve the others, for they share one camera path.

Every row is solved alone first, which rejects outliers. Then one graph holds all rows, each in its own frame of
coordinates with the measurements that it kept, and the poses of shared frames agree (see `shared_frames`). A row's
covariance is its part of the joint one. Where the rows contradict one another in this graph, each keeps the solution
that it has alone.
"""

from collections.abc import Callable, Collection, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import TypeVar

import gtsam
import numpy as np
from scipy.sparse import block_diag, csc_array

from savmap.errors import SolveError
from savmap.graph.covariance import Covariance, Covariances, SharedUnknowns, covariance
from savmap.graph.factors.markers import PLUGIN as MARKERS
from savmap.graph.factors.problem_factors import estimate_of, measurement_factors, other_factors, values_of
from savmap.graph.joint.rekey import rekey_factor, rekey_values, values_of_row
from savmap.graph.joint.shared_frames import SharedFrames, first_transform, shared_frame_factors, shared_frames
from savmap.graph.joint.shared_measurements import Moments, equal_camera_heights, shared_measurements
from savmap.graph.keys import centre_key, frame_key, rekey, row_of
from savmap.graph.problem import Problem
from savmap.graph.solver.elimination import KeyPosition, aisle_positions, hub_keys, ordering_of
from savmap.graph.solver.halves import half_differences
from savmap.graph.solver.judgement.contradictions import UNCHECKED
from savmap.graph.solver.judgement.reference_tests import tested_keys
from savmap.graph.solver.levenberg_marquardt import LevenbergMarquardt
from savmap.graph.solver.optimise import (
    Iterate,
    SolveOptions,
    bias_unknowns,
    converged,
    solution_of,
)
from savmap.graph.solver.panorama import panorama_errors
from savmap.graph.solver.solution import Solution
from savmap.types import Doubt, Floats, Ints

CONTRADICTION_SIGMA = 5.0
WORSE = 1.5
Result = TypeVar("Result")


def solve_rows(
    problems: Sequence[Problem], moments: Moments, site_wide: Collection[str] = (), options: SolveOptions | None = None
) -> list[Solution | SolveError]:
    """Solutions of rows, joint where they share frames: moments[r][f] identifies the picture that is frame f of row r.

    `site_wide`: plugins whose structures, as markers, are seen from all rows, so that several rows may measure the same
    one. A row that cannot be solved alone comes back as its error, and the others are solved without it; rows that
    contradict one another are solved alone, with a note.
    """
    alone: list[Iterate | SolveError] = [_attempt(converged, problem, options) for problem in problems]
    iterates = {row: result for row, result in enumerate(alone) if isinstance(result, Iterate)}
    number: dict[Hashable, int] = {}
    pictures = [[number.setdefault(moment, len(number)) for moment in moments[row]] for row in iterates]
    solved = _solutions(list(iterates.values()), pictures, site_wide)
    solutions = iter([_with_checks(*pair) for pair in zip(solved, iterates.values(), strict=True)])
    together = [result if isinstance(result, SolveError) else next(solutions) for result in alone]
    return [_beside_refused(row, together, problems, moments) for row in range(len(together))]


def _beside_refused(
    row: int, results: Sequence[Solution | SolveError], problems: Sequence[Problem], moments: Moments
) -> Solution | SolveError:
    """A row's result; with a doubt where another row of the same drive is refused, for what was given for both may be
    what is wrong."""
    result = results[row]
    if isinstance(result, SolveError):
        return result
    refused = [
        Doubt(
            "reference",
            "another row of its drive cannot be mapped",
            action=f"check what is given for both: row {problems[other].camera.facts.name}",
        )
        for other, error in enumerate(results)
        if isinstance(error, SolveError) and set(moments[row]) & set(moments[other])
    ]
    return replace(result, doubts=(*result.doubts, *refused))


def _solutions(
    iterates: Sequence[Iterate], moments: Moments, site_wide: Collection[str]
) -> Sequence[Solution | SolveError]:
    shared = shared_frames([iterate.problem.used for iterate in iterates], moments)
    doubts: tuple[Doubt, ...] = ()
    if shared:
        try:
            return JointRows(iterates, shared, moments, {*site_wide, MARKERS}).solutions()
        except SolveError as error:
            what, names = "the rows of a drive contradict one another", ", ".join(map(_name, iterates))
            details = (f"each is mapped without the others: {error}",)
            doubts = (Doubt("reference", what, action=f"check what is given for these rows: {names}", details=details),)
    return [_attempt(solution_of, reduce(Iterate.doubted, doubts, iterate)) for iterate in iterates]


def _name(iterate: Iterate) -> str:
    return iterate.problem.camera.facts.name


def _with_checks(result: Solution | SolveError, iterate: Iterate) -> Solution | SolveError:
    """A row's solution with how its landmarks repeat in either half of the frames, and what is wrong with its
    panoramas, at the optimum that the row has alone."""
    if isinstance(result, SolveError):
        return result
    halves = half_differences(iterate.problem, iterate.estimate, iterate.fit.kept, iterate.inflation, iterate.huber)
    wrong = panorama_errors(iterate)
    checked = replace(result, halves=halves, vertical_scale=wrong.vertical_scale, lens_distance=wrong.lens_distance)
    return replace(checked, report={**result.report, **wrong.report})


def _attempt(solve: Callable[..., Result], *arguments: object) -> Result | SolveError:
    try:
        return solve(*arguments)
    except SolveError as error:
        return error


@dataclass(frozen=True, eq=False)
class JointRows:
    """Rows at the optima that they have alone, and the frames that they share."""

    iterates: Sequence[Iterate]
    shared: Sequence[SharedFrames]
    moments: Moments
    site_wide: Collection[str]

    def solutions(self) -> list[Solution]:
        """The joint optimum, row by row. Raises SolveError where the rows contradict one another."""
        problems = shared_measurements([iterate.problem for iterate in self.iterates], self.moments, self.site_wide)
        begin = [replace(iterate, problem=problem) for iterate, problem in zip(self.iterates, problems, strict=True)]
        values = self._begin(begin)
        graph = self._graph(begin, values, robust=True)
        values = LevenbergMarquardt(self._names, self._order(begin, values)).minimum(graph, values)
        moved = [
            replace(_moved(alone, values, row), problem=problem)
            for row, (alone, problem) in enumerate(zip(self.iterates, problems, strict=True))
        ]
        _require_pictures_fit(self.iterates, moved)
        wanted = {rekey(key, row) for row, iterate in enumerate(moved) for key in tested_keys(iterate.problem)}
        tested = _parts(moved, self._covariance(moved, values, wanted))
        reported = _parts(moved, self._covariance([iterate.reported for iterate in moved], values))
        solutions = [
            solution_of(replace(joint, problem=alone.problem), Covariances(*parts))
            for alone, joint, *parts in zip(self.iterates, moved, tested, reported, strict=True)
        ]
        _require_references_fit(self.iterates, solutions)
        return [
            replace(row, report={**row.report, "solved_together": self._names}, unchecked=self._by_itself(row))
            for row in solutions
        ]

    def _by_itself(self, row: Solution) -> tuple[str, ...]:
        """What nothing would notice in a row by itself: the others' references give the scale of all."""
        if not any(UNCHECKED in line for line in row.unchecked):
            return row.unchecked
        return (*row.unchecked, f"{self._names} are solved together: another's references count here, too")

    @property
    def _names(self) -> str:
        return "rows " + " and ".join(iterate.problem.camera.facts.name for iterate in self.iterates)

    def _begin(self, iterates: Sequence[Iterate]) -> gtsam.Values:
        values = gtsam.Values()
        for row, iterate in enumerate(iterates):
            values.insert(rekey_values(values_of(iterate.problem, iterate.estimate), row))
        for pair in self.shared:
            values.insert(
                pair.key,
                first_transform(_poses(iterates[pair.a], pair.frames_a), _poses(iterates[pair.b], pair.frames_b)),
            )
        return values

    def _order(self, iterates: Sequence[Iterate], values: gtsam.Values) -> gtsam.Ordering:
        """Variables by their positions along the aisle, in the frame of the first row of each group."""
        aisle_from_row = {pair.b: (pair.a, values.atPose3(pair.key)) for pair in reversed(self.shared)}
        positions, late = list[KeyPosition](), [pair.key for pair in self.shared]
        for row, iterate in enumerate(iterates):
            lead, transform = aisle_from_row.get(row, (row, gtsam.Pose3()))
            if lead in aisle_from_row:
                transform = aisle_from_row[lead][1].compose(transform)
            positions += aisle_positions(iterate.problem, iterate.estimate, transform, row)
            late += hub_keys(iterate.problem, row)
        return ordering_of(positions, late)

    def _graph(self, iterates: Sequence[Iterate], values: gtsam.Values, robust: bool) -> gtsam.NonlinearFactorGraph:
        """All rows' factors and those of shared frames, the measurements' last."""
        graph = gtsam.NonlinearFactorGraph()
        for row, iterate in enumerate(iterates):
            others = other_factors(iterate.problem, iterate.estimate)
            for factor in (others.at(number) for number in range(others.size())):
                graph.add(rekey_factor(factor, row))
        for pair in self.shared:
            for factor in shared_frame_factors(pair, values.atPose3(pair.key)):
                graph.add(factor)
        for factor in equal_camera_heights([iterate.problem for iterate in iterates]):
            graph.add(factor)
        for row, iterate in enumerate(iterates):
            huber = iterate.huber[iterate.fit.kept] if robust else None
            for factor in measurement_factors(iterate.kept, huber):
                graph.add(rekey_factor(factor, row))
        return graph

    def _covariance(
        self, iterates: Sequence[Iterate], values: gtsam.Values, only: Collection[int] | None = None
    ) -> Covariance:
        frames = [rekey(frame_key(f), row) for row, s in enumerate(iterates) for f in s.problem.used.tolist()]
        centres = [rekey(centre_key(f), row) for row, s in enumerate(iterates) for f in s.problem.used.tolist()]
        biases = [bias_unknowns(iterate, None) for iterate in iterates]
        unknowns = SharedUnknowns(
            csc_array(block_diag([of_row.columns for of_row in biases])),
            *(np.concatenate([getattr(of_row, name) for of_row in biases]) for name in ("value", "prior", "free")),
        )
        graph = self._graph(iterates, values, robust=False)
        return covariance(graph, values, [*frames, *(pair.key for pair in self.shared)], centres, unknowns, only)


def _poses(iterate: Iterate, frames: Ints) -> Floats:
    poses: Floats = iterate.estimate.poses[np.searchsorted(iterate.problem.used, frames)]
    return poses


def _moved(iterate: Iterate, values: gtsam.Values, row: int) -> Iterate:
    """A row's iterate at the joint optimum; the kept measurements stay the same."""
    estimate = estimate_of(iterate.problem, values_of_row(values, row), iterate.estimate)
    errors, kept = iterate.problem.residuals(estimate.poses, estimate.points), iterate.fit.kept
    before = float((iterate.fit.errors[kept] ** 2).sum())
    times = float((errors[kept] ** 2).sum()) / before if before else 1.0
    fit = replace(iterate.fit, errors=errors, scale=iterate.fit.scale * times**0.5)
    return replace(iterate, estimate=estimate, fit=fit)


def _parts(iterates: Sequence[Iterate], whole: Covariance) -> list[Covariance]:
    """Each row's part of the joint covariance."""
    rows = np.array([row_of(key) for key in whole.keys])
    cameras = np.cumsum([0, *(len(iterate.problem.used) for iterate in iterates)])
    biases = np.cumsum([0, *(len(iterate.bias) for iterate in iterates)])
    parts = []
    for row in range(len(iterates)):
        of_row = np.flatnonzero(rows == row)
        slots = (3 * of_row[:, None] + np.arange(3)).ravel()
        bias = slice(biases[row], biases[row + 1])
        parts.append(
            Covariance(
                tuple(rekey(whole.keys[index], -row) for index in of_row.tolist()),
                whole.points[np.ix_(slots, slots)],
                whole.cameras[cameras[row] : cameras[row + 1]],
                whole.shared[bias, bias],
                whole.step[bias],
                whole.followed[slots],
            )
        )
    return parts


def _require_pictures_fit(alone: Sequence[Iterate], together: Sequence[Iterate]) -> None:
    """Raises SolveError for a row whose residuals grow much in the joint solution."""
    for first, joint in zip(alone, together, strict=True):
        squares = [iterate.fit.errors[first.fit.kept] ** 2 for iterate in (first, joint)]
        before, after = (float(np.sqrt(np.mean(square))) if square.size else 0.0 for square in squares)
        if after > WORSE * before:
            raise SolveError(
                f"row {first.problem.camera.facts.name}: its pictures do not fit one camera path with the other rows' "
                f"(residuals grow to {after / before:.1f} times)"
            )


def _require_references_fit(alone: Sequence[Iterate], together: Sequence[Solution]) -> None:
    """Raises SolveError for a reference that deviates by far from the rest, and twice as much as in its row alone."""
    for iterate, solution in zip(alone, together, strict=True):
        if max(solution.deviations.values(), default=0.0) > CONTRADICTION_SIGMA:
            before = solution_of(iterate).deviations
            worse = {
                name: deviation
                for name, deviation in solution.deviations.items()
                if deviation > max(CONTRADICTION_SIGMA, 2 * before[name])
            }
            if worse:
                name = max(worse, key=worse.__getitem__)
                raise SolveError(
                    f"row {iterate.problem.camera.facts.name}: {name} is {worse[name]:.0f} standard deviations off what the "
                    f"rows say together, {before[name]:.1f} by itself"
                )
