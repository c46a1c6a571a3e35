"""Where the solve starts: from linear equations that need attitudes only. Where a path starts: as published (paper,
section III.E)."""

from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import SolveError, StructureError
from savmap.geometry.poses import rotations_at
from savmap.graph.initial.linear import linear_positions
from savmap.graph.initial.observability import (
    IDENTITY,
    PLACE_Y,
    Similarity,
    assume_missing,
    assumptions,
    fit,
    lowest,
    require_metric,
)
from savmap.graph.initial.outlier_references import (
    OutlierReference,
    consistent_alternatives,
    line_of,
    without_outliers,
)
from savmap.graph.problem import Estimate, Problem, first_poses
from savmap.types import Floats, MapWarning, RowFacts, Trajectory


def published_start(
    facts: RowFacts, attitudes: Floats, length_m: float, height_m: float, distance_m: float
) -> Trajectory:
    """All frames of a row: constant speed over length_m along x (n L / N), constant height and distance.

    attitudes (n, 3, 3) world_from_rig; nan where not known: then interpolated. A pass whose direction of travel is not
    known is taken to go towards +x. Raises StructureError if no attitude is known.
    """
    count = len(facts.frames)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = _filled(attitudes, facts)
    poses[:, 1, 3], poses[:, 2, 3] = height_m, distance_m
    for name in dict.fromkeys(facts.frames.passes):
        numbers = facts.frames.of_pass(name)
        along = np.linspace(0.0, length_m, len(numbers))
        poses[numbers, 0, 3] = along[::-1] if facts.travel.get(name, 0) < 0 else along
    return Trajectory(np.arange(count), poses)


def _filled(attitudes: Floats, facts: RowFacts) -> Floats:
    finite = np.asarray(np.isfinite(attitudes).all(axis=(1, 2)))
    if not finite.any():
        raise StructureError(f"row {facts.name}: the camera's attitude is not known in any frame")
    filled = attitudes.copy()
    for name in dict.fromkeys(facts.frames.passes):
        numbers = facts.frames.of_pass(name)
        good = numbers[finite[numbers]] if finite[numbers].any() else np.flatnonzero(finite)
        filled[numbers] = rotations_at(numbers, good, attitudes[good])
    return filled


@dataclass(frozen=True, eq=False)
class Start:
    """Where the solve starts: the problem as `given` and without references that are `refuted` roughly, which
    alternatives were chosen where only a part of a row was found, the estimate."""

    given: Problem
    problem: Problem
    alternatives: tuple[str, ...]
    refuted: tuple[OutlierReference, ...]
    estimate: Estimate

    @property
    def notes(self) -> tuple[str, ...]:
        """What to tell the user about the alternatives."""
        return tuple(
            f"only a part of the row was found: {name}, by the references that fit" for name in self.alternatives
        )

    @property
    def refuted_notes(self) -> tuple[str, ...]:
        """What to tell the user about references that are left out."""
        return tuple(line_of(*outlier) for outlier in self.refuted)

    @property
    def warnings(self) -> tuple[MapWarning, ...]:
        """What speaks against the alternatives, and against what was assumed."""
        assumed = () if self.problem.partial else assumptions(self.problem)
        return (
            *(MapWarning("incomplete-map", details=(note,)) for note in self.notes),
            *(MapWarning("doubtful-scale", details=(line,)) for line in assumed),
        )


def starts(problem: Problem) -> list[Start]:
    """A start of the solve for each choice of alternatives.

    Raises SolveError if scale or place are not observable in any choice.
    """
    poses, points = first_poses(problem), first_points(problem)
    measured = len(problem.measurements) > 0
    linear = linear_positions(problem, poses, points) if measured else (poses[:, :3, 3], points)
    begins, errors = list[Start](), list[SolveError]()
    for choice, names in consistent_alternatives(problem, *linear):
        try:
            begins.append(_start(choice, names, poses, linear))
        except SolveError as error:
            errors.append(error)
    if not begins:
        raise errors[0]
    return begins


def _start(
    problem: Problem,
    alternatives: tuple[str, ...],
    poses: Floats,
    linear: tuple[Floats, Floats],
) -> Start:
    """From first poses (f, 4, 4), whose attitudes stay, and the `linear` start's cameras (f, 3) and points (m, 3)."""
    cameras, positions = linear
    given = problem
    problem, refuted = without_outliers(problem, cameras, positions)
    if problem.camera.fixed is None:
        if problem.partial or problem.camera.facts.sees_in_part:
            assumed = assume_missing(problem, cameras, positions)
            if not problem.partial and PLACE_Y in assumed.assumed:
                low = positions[lowest(problem, positions), 1] * np.eye(3)[1]
                cameras, positions = cameras - low, positions - low
            extra = assumed.relations[len(problem.relations) :]
            given = replace(given, relations=(*given.relations, *extra), assumed=assumed.assumed)
            problem = assumed
        similarity = fit(problem, cameras, positions)
        require_metric(problem, similarity, positions.mean(axis=0))
        cameras, positions = similarity.points(cameras), similarity.points(positions)
    poses = poses.copy()
    poses[:, :3, 3] = cameras
    heights = np.array([height.value_m for height in problem.camera.references.camera_heights])
    variables = {key: value for part in problem.parts for key, value in part.variables.items()}
    return Start(given, problem, alternatives, refuted, Estimate(poses, positions, heights, variables))


def moved(problem: Problem, estimate: Estimate, similarity: Similarity) -> Estimate:
    """An estimate brought to the references of a problem, which may have fewer camera heights."""
    poses = estimate.poses.copy()
    poses[:, :3, 3] = similarity.points(poses[:, :3, 3])
    heights = np.array([height.value_m for height in problem.camera.references.camera_heights])
    return replace(estimate, poses=poses, points=similarity.points(estimate.points), heights=heights)


def aligned(problem: Problem, estimate: Estimate) -> Estimate:
    """An estimate brought to where a problem's references fit it best."""
    similarity = (
        IDENTITY if problem.camera.fixed is not None else fit(problem, estimate.poses[:, :3, 3], estimate.points)
    )
    return moved(problem, estimate, similarity)


def first_points(problem: Problem) -> Floats:
    """The plugins' first positions (m, 3)."""
    points = np.zeros((len(problem.keys), 3))
    for part in problem.parts:
        for name, key in part.keys.items():
            points[problem.index(key)] = part.initial[name]
    return points
