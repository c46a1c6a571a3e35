"""Rows seen on one drive, solved jointly: the references of one row serve the others, for they share one camera path.

Every row is solved by itself first, which rejects outliers. Then one graph holds all rows, each in its own frame of
coordinates with the measurements that it kept. Faces across an aisle are parallel only roughly: world_from_rig of a
frame in row a is that in row b moved by one unknown rigid transform, a_from_b, on which all shared frames agree. A
measurement that several rows share counts once: in each row it weighs that much less. A row's covariance is its part of
the joint one. Where the rows contradict one another in this graph, each keeps the solution that it has by itself.
"""

from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import TypeVar

import gtsam
import numpy as np
from scipy.sparse import block_diag, csc_array
from scipy.spatial.transform import Rotation

from savmap.errors import SolveError
from savmap.graph.constraints import Relation
from savmap.graph.covariance import Covariance, Covariances, covariance
from savmap.graph.factors.problem_factors import along, estimate_of, other_factors, values_of
from savmap.graph.factors.projections import projection_factors
from savmap.graph.factors.scene import MARKERS
from savmap.graph.keys import (
    NO_ROW,
    TRANSFORM,
    camera_height_key,
    frame_key,
    rekey,
    row_of,
    value_at,
    width_of,
)
from savmap.graph.normal_equations import SharedUnknowns
from savmap.graph.problem import Problem
from savmap.graph.references import CameraHeight
from savmap.graph.solver.checks import checked
from savmap.graph.solver.judgement.reference_tests import tested_keys
from savmap.graph.solver.judgement.soft_references import without
from savmap.graph.solver.levenberg_marquardt import minimum
from savmap.graph.solver.optimise import (
    Iterate,
    bias_unknowns,
    converged,
    solution_of,
    with_hidden,
)
from savmap.graph.solver.solution import Solution
from savmap.types import Floats, Ints, MapWarning

CONTRADICTION_SIGMA = 5.0
WORSE = 1.5
Result = TypeVar("Result")
LEAST_FRAMES = 3
EQUAL_RAD, EQUAL_M = float(np.radians(0.01)), 1e-3
TURN_RAD, PLACE_M = 0.5, 20.0
LEVEL_M = 0.01
Moments = Sequence[Sequence[Hashable]]


def solve_rows(
    problems: Sequence[Problem], moments: Moments, site_wide: Collection[str] = ()
) -> list[Solution | SolveError]:
    """Solutions of rows, joint where they share frames: moments[r][f] identifies the picture that is frame f of row r.

    `site_wide`: plugins whose structures, as markers, are seen from all rows, so that several rows may measure the same
    one. A row that cannot be solved alone comes back as its error, and the others are solved without it; rows that
    contradict one another are solved alone, with a note.
    """
    single = _refuted_once([_attempt(converged, problem) for problem in problems], problems, moments)
    iterates = {row: result for row, result in enumerate(single) if isinstance(result, Iterate)}
    number: dict[Hashable, int] = {}
    pictures = [[number.setdefault(moment, len(number)) for moment in moments[row]] for row in iterates]
    solved = _solutions(list(iterates.values()), pictures, site_wide)
    solutions = iter(
        [
            result if isinstance(result, SolveError) else checked(result, iterate)
            for result, iterate in zip(solved, iterates.values(), strict=True)
        ]
    )
    together = [result if isinstance(result, SolveError) else next(solutions) for result in single]
    return [_with_refusals(row, together, problems, moments) for row in range(len(together))]


def _refuted_once(
    results: list[Iterate | SolveError], problems: Sequence[Problem], moments: Moments
) -> list[Iterate | SolveError]:
    """The rows by themselves, where a camera height of their drive, which is one reference, is named in one row that
    leaves it out: others that do not agree with it either are solved without it."""
    named = set[CameraHeight]()
    heights = [set(problem.camera.references.camera_heights) for problem in problems]
    for first, result in enumerate(results):
        if isinstance(result, SolveError):
            continue
        used = {height.name for height in result.problem.camera.references.camera_heights}
        refuted = {height for height in heights[first] if height.name not in used} - named
        named |= refuted
        for row, (problem, other) in enumerate(zip(problems, results, strict=True)):
            shared = refuted & heights[row] if row != first and set(moments[first]) & set(moments[row]) else set()
            agrees = isinstance(other, Iterate) and shared <= {*other.problem.camera.references.camera_heights}
            if shared and not agrees:
                again = _attempt(converged, without(problem, [height.name for height in shared]))
                if isinstance(again, Iterate) and again.judgement:
                    results[row] = replace(again, judgement=replace(again.judgement, given=problem))
    return results


REFUSED = "another row of its drive cannot be mapped: what is given for both may be wrong"


def _with_refusals(
    row: int, results: Sequence[Solution | SolveError], problems: Sequence[Problem], moments: Moments
) -> Solution | SolveError:
    """A row's result; with a warning where another row of its drive is refused."""
    result = results[row]
    if isinstance(result, SolveError):
        return result
    refused = [
        MapWarning("reference-conflict", (f"row {problems[other].camera.facts.name}",), details=(REFUSED,))
        for other, error in enumerate(results)
        if isinstance(error, SolveError) and set(moments[row]) & set(moments[other])
    ]
    return replace(result, warnings=(*result.warnings, *refused))


def _solutions(
    iterates: Sequence[Iterate], moments: Moments, site_wide: Collection[str]
) -> Sequence[Solution | SolveError]:
    shared = shared_frames([iterate.problem.used for iterate in iterates], moments)
    warnings: tuple[MapWarning, ...] = ()
    if shared:
        try:
            return JointRows(iterates, shared, moments, {*site_wide, MARKERS}).solutions()
        except SolveError as error:
            names = tuple(f"row {iterate.problem.camera.facts.name}" for iterate in iterates)
            details = (f"the rows of a drive contradict one another; each is mapped without the others: {error}",)
            warnings = (MapWarning("reference-conflict", names, details=details),)
    return [_attempt(solution_of, reduce(Iterate.warned, warnings, iterate)) for iterate in iterates]


def _attempt(solve: Callable[..., Result], *arguments: object) -> Result | SolveError:
    try:
        return solve(*arguments)
    except SolveError as error:
        return error


@dataclass(frozen=True, eq=False)
class SharedFrames:
    """Frames (k,) of row `a` and those (k,) of row `b` that are the same pictures; `key` of the transform a_from_b."""

    a: int
    b: int
    frames_a: Ints
    frames_b: Ints
    key: int


@dataclass(frozen=True, eq=False)
class JointRows:
    """Rows at the optima that they have by themselves, and the frames that they share."""

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
        values = minimum(self._names, graph, values)
        moved = [
            replace(_moved(iterate, values, row), problem=problem)
            for row, (iterate, problem) in enumerate(zip(self.iterates, problems, strict=True))
        ]
        _require_pictures_fit(self.iterates, moved)
        wanted = {rekey(key, row) for row, iterate in enumerate(moved) for key in tested_keys(iterate.problem)}
        tested = _parts(moved, self._covariance(moved, values, wanted))
        whole = self._covariance([iterate.reported for iterate in moved], values)
        reported = _parts(moved, with_hidden(moved, whole))
        solutions = [
            solution_of(replace(joint, problem=single.problem), Covariances(*parts))
            for single, joint, *parts in zip(self.iterates, moved, tested, reported, strict=True)
        ]
        _require_references_fit(self.iterates, solutions)
        by_itself = f"{self._names} are solved together: another's references count here, too"
        return [
            replace(
                row,
                report={**row.report, "solved_together": self._names},
                unchecked=(*row.unchecked, *([by_itself] if row.unchecked else [])),
            )
            for row in solutions
        ]

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

    def _graph(self, iterates: Sequence[Iterate], values: gtsam.Values, robust: bool) -> gtsam.NonlinearFactorGraph:
        """All rows' factors, those of shared frames, and all rows' measurements last."""
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
            for factor in projection_factors(iterate.kept, iterate.huber[iterate.fit.kept] if robust else None, row):
                graph.add(factor)
        return graph

    def _covariance(
        self, iterates: Sequence[Iterate], values: gtsam.Values, only: Collection[int] | None = None
    ) -> Covariance:
        biases = [bias_unknowns(iterate, None) for iterate in iterates]
        unknowns = SharedUnknowns(
            csc_array(block_diag([of_row.columns for of_row in biases])),
            *(np.concatenate([getattr(of_row, name) for of_row in biases]) for name in ("value", "prior", "free")),
        )
        return covariance(self._graph(iterates, values, robust=False), values, unknowns, only)


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
                whole.hidden[:, slots],
            )
        )
    return parts


def _require_pictures_fit(single: Sequence[Iterate], together: Sequence[Iterate]) -> None:
    """Raises SolveError for a row whose residuals grow much in the joint solution."""
    for first, joint in zip(single, together, strict=True):
        squares = [iterate.fit.errors[first.fit.kept] ** 2 for iterate in (first, joint)]
        before, after = (float(np.sqrt(np.mean(square))) if square.size else 0.0 for square in squares)
        if after > WORSE * before:
            raise SolveError(
                f"row {first.problem.camera.facts.name}: its pictures do not fit one camera path with the other rows' "
                f"(residuals grow to {after / before:.1f} times)"
            )


def _require_references_fit(single: Sequence[Iterate], together: Sequence[Solution]) -> None:
    """Raises SolveError for a reference that deviates by far from the rest, and twice as much as in its row alone."""
    for iterate, solution in zip(single, together, strict=True):
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
                    f"row {iterate.problem.camera.facts.name}: {name} is {worse[name]:.0f} standard deviations off "
                    f"what the rows say together, {before[name]:.1f} by itself"
                )


def shared_frames(frames: Sequence[Ints], moments: Sequence[Sequence[Hashable]]) -> list[SharedFrames]:
    """Shared frames of pairs of rows whose `frames` were located; moments[r][f] identifies the picture that is frame f
    of row r. Every shared picture binds each row to the first one that has it."""
    first: dict[Hashable, tuple[int, int]] = {}
    pairs: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for row, numbers in enumerate(frames):
        for frame in numbers.tolist():
            lead, number = first.setdefault(moments[row][frame], (row, frame))
            if lead != row:
                pairs.setdefault((lead, row), []).append((number, frame))
    enough = [(rows, np.array(same, np.int64)) for rows, same in pairs.items() if len(same) >= LEAST_FRAMES]
    return [
        SharedFrames(*rows, same[:, 0], same[:, 1], rekey(gtsam.symbol(TRANSFORM, number), NO_ROW))
        for number, (rows, same) in enumerate(enough)
    ]


def shared_frame_factors(shared: SharedFrames, a_from_b: gtsam.Pose3) -> list[gtsam.NonlinearFactor]:
    """The poses of every shared frame agree; the transform has a wide prior about `a_from_b`."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([EQUAL_RAD, EQUAL_M], 3))
    loose = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([TURN_RAD, PLACE_M], 3))
    return [
        gtsam.PriorFactorPose3(shared.key, a_from_b, loose),
        *(
            gtsam.CustomFactor(
                noise, [rekey(frame_key(a), shared.a), shared.key, rekey(frame_key(b), shared.b)], _disagreement
            )
            for a, b in zip(shared.frames_a.tolist(), shared.frames_b.tolist(), strict=True)
        ),
    ]


def first_transform(poses_a: Floats, poses_b: Floats) -> gtsam.Pose3:
    """a_from_b between poses (k, 4, 4) of the same frames: the mean rotation, and the shift between the mean
    positions."""
    turn = Rotation.from_matrix(poses_a[:, :3, :3] @ np.swapaxes(poses_b[:, :3, :3], 1, 2)).mean().as_matrix()
    shift = (poses_a[:, :3, 3] - poses_b[:, :3, 3] @ turn.T).mean(axis=0)
    return gtsam.Pose3(gtsam.Rot3(turn), shift)


def _disagreement(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
    """Log(X_a^-1 T X_b), and its derivatives by small motions on the right of X_a, T and X_b."""
    in_a, a_from_b, in_b = map(values.atPose3, factor.keys())
    difference = in_a.inverse().compose(a_from_b).compose(in_b)
    error: Floats = gtsam.Pose3.Logmap(difference)
    if jacobians is not None:
        slope = gtsam.Pose3.LogmapDerivative(difference)
        jacobians[0] = -slope @ difference.inverse().AdjointMap()
        jacobians[1] = slope @ in_b.inverse().AdjointMap()
        jacobians[2] = slope
    return error


def shared_measurements(problems: Sequence[Problem], moments: Moments, site_wide: Collection[str]) -> list[Problem]:
    """The problems with wider sigmas for what several of them share: an equal camera height and, of the plugins whose
    structures are seen from all rows (`site_wide`), pixels of one picture and references of one name."""
    heights = Counter(height for problem in problems for height in problem.camera.references.camera_heights)
    named = Counter(name for problem in problems for name in _names(problem, site_wide) if name)
    seen = Counter(
        source
        for problem, pictures in zip(problems, moments, strict=True)
        for source in set(_sources(problem, pictures, site_wide))
        if source
    )

    def widened(problem: Problem, pictures: Sequence[Hashable]) -> Problem:
        references = problem.camera.references
        wider = tuple(replace(h, sigma_m=h.sigma_m * heights[h] ** 0.5) for h in references.camera_heights)
        names = _names(problem, site_wide)
        rows = np.array([seen[source] if source else 1 for source in _sources(problem, pictures, site_wide)])
        measurements = problem.measurements
        return replace(
            problem,
            camera=replace(problem.camera, references=replace(references, camera_heights=wider)),
            relations=tuple(
                replace(relation, sigma=relation.sigma * named[name] ** 0.5) if name else relation
                for relation, name in zip(problem.relations, names, strict=True)
            ),
            measurements=replace(measurements, covariances=measurements.covariances * rows[:, None, None]),
        )

    return [widened(problem, pictures) for problem, pictures in zip(problems, moments, strict=True)]


def _names(problem: Problem, site_wide: Collection[str]) -> list[Hashable]:
    """What identifies the user's figure of each relation; None for those of a single row."""

    def name(relation: Relation) -> Hashable:
        plugin = problem.name_of(relation.a)[0]
        return (plugin, relation.name, relation.value) if relation.name and plugin in site_wide else None

    return [name(relation) for relation in problem.relations]


def _sources(problem: Problem, moments: Sequence[Hashable], site_wide: Collection[str]) -> list[Hashable]:
    """Plugin and picture of each measurement; None for what is seen from a single row."""
    plugins = [problem.name_of(key)[0] for key in problem.measurements.keys.tolist()]
    frames = problem.measurements.frames.tolist()
    return [
        (plugin, moments[frame]) if plugin in site_wide else None for plugin, frame in zip(plugins, frames, strict=True)
    ]


def equal_camera_heights(problems: Sequence[Problem]) -> Iterator[gtsam.NonlinearFactor]:
    """One camera height given for several rows: the camera is equally high above the floors of all of them, +- 1 cm."""
    first: dict[CameraHeight, int] = {}
    for row, problem in enumerate(problems):
        for number, height in enumerate(problem.camera.references.camera_heights):
            key = rekey(camera_height_key(number), row)
            lead = first.setdefault(height, key)
            if lead != key:
                yield gtsam.BetweenFactorPoint3(lead, key, np.zeros(3), along(1, LEVEL_M))


def rekey_factor(factor: gtsam.NonlinearFactor, row: int) -> gtsam.NonlinearFactor:
    """A row's factor over its keys in the graph of several rows."""
    if row == 0:
        return factor
    keys = factor.keys()
    keys = [rekey(key, row) for key in keys]
    return _wrapped(factor, keys) if isinstance(factor, gtsam.CustomFactor) else factor.rekey(keys)


def rekey_values(values: gtsam.Values, row: int) -> gtsam.Values:
    """A row's values at their keys in the graph of several rows."""
    keys = values.keys()
    return _renamed(values, [(key, rekey(key, row)) for key in keys])


def values_of_row(values: gtsam.Values, row: int) -> gtsam.Values:
    """The values of one row, at the keys that it has by itself."""
    keys = values.keys()
    return _renamed(values, [(key, rekey(key, -row)) for key in keys if row_of(key) == row])


def _renamed(values: gtsam.Values, names: Sequence[tuple[int, int]]) -> gtsam.Values:
    renamed = gtsam.Values()
    for old, new in names:
        renamed.insert(new, value_at(values, old))
    return renamed


def _wrapped(factor: gtsam.CustomFactor, keys: Sequence[int]) -> gtsam.CustomFactor:
    """A factor written in Python cannot be copied: its whitened linear form under other keys."""
    names = list(zip(keys, factor.keys(), strict=True))

    def error(_: object, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        matrix, right = factor.linearize(_renamed(values, names)).jacobian()
        if jacobians is not None:
            ends = np.cumsum([width_of(key) for key in keys])
            for number, slope in enumerate(np.split(matrix, ends[:-1], axis=1)):
                jacobians[number] = slope
        return -right

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(factor.dim()), list(keys), error)
