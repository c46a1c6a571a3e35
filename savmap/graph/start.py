"""Where the solve starts: as published (paper, section III.E), or from linear equations that need attitudes only."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from savmap.errors import SolveError, StructureError
from savmap.graph import linear
from savmap.graph.constraints import Own
from savmap.graph.doubt import readings, undoubted
from savmap.graph.problem import Problem
from savmap.graph.scale import fit, require_metric
from savmap.types import Floats, Ints, RowFacts, Trajectory


@dataclass(frozen=True)
class Estimate:
    """Poses world_from_rig (f, 4, 4) of the used frames, points (m, 3), camera heights (h,) of the references, and the plugins'
    own variables by key."""

    poses: Floats
    points: Floats
    heights: Floats
    own: Mapping[int, Own] = field(default_factory=dict)


def published_start(
    facts: RowFacts, attitudes: Floats, length_m: float, height_m: float, distance_m: float
) -> Trajectory:
    """All frames of a row: constant speed over length_m along x (n L / N), constant height and distance.

    attitudes (n, 3, 3) world_from_rig; nan where not known: then interpolated. A pass whose direction of travel is not known
    is taken to go towards +x. Raises StructureError if no attitude is known.
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
    known = np.asarray(np.isfinite(attitudes).all(axis=(1, 2)))
    if not known.any():
        raise StructureError(f"row {facts.name}: the camera's attitude is not known in any frame")
    filled = attitudes.copy()
    for name in dict.fromkeys(facts.frames.passes):
        numbers = facts.frames.of_pass(name)
        good = numbers[known[numbers]] if known[numbers].any() else np.flatnonzero(known)
        filled[numbers] = rotations_at(numbers, good, attitudes[good])
    return filled


def rotations_at(wanted: Ints, frames: Ints, rotations: Floats) -> Floats:
    """Rotations (w, 3, 3) at frame numbers `wanted`, interpolated between those at sorted `frames`; held beyond the ends."""
    if len(frames) == 1:
        return np.repeat(rotations, len(wanted), axis=0)
    spline = Slerp(frames, Rotation.from_matrix(rotations))
    turned: Floats = spline(np.clip(wanted, frames[0], frames[-1])).as_matrix()
    return turned


@dataclass(frozen=True)
class Start:
    """Where the solve starts: the problem without references that were refuted, how it was read where only a part of a row
    was found, a line about each refuted reference, the estimate."""

    problem: Problem
    reading: tuple[str, ...]
    doubts: tuple[str, ...]
    estimate: Estimate

    @property
    def notes(self) -> tuple[str, ...]:
        """What to tell the user."""
        return (
            *(f"only a part of the row was found: {name}, by the references that fit" for name in self.reading),
            *self.doubts,
        )


def starts(problem: Problem, kind: str) -> list[Start]:
    """A start of the solve for each way to read the references; `kind` is "linear" or "published".

    Raises SolveError if gauge or scale are not observable, or if references contradict one another however they are read.
    """
    poses, points = first_poses(problem), first_points(problem)
    cameras, found = linear.places(problem, poses, points)
    ways, wrong = list[Start](), list[SolveError]()
    for way, reading in readings(problem, cameras, found):
        try:
            ways.append(_start(way, reading, kind, (poses, points, cameras, found)))
        except SolveError as error:
            wrong.append(error)
    if not ways:
        raise wrong[0]
    return ways


def _start(
    problem: Problem, reading: tuple[str, ...], kind: str, scene: tuple[Floats, Floats, Floats, Floats]
) -> Start:
    poses, points, cameras, found = scene
    problem, doubts = undoubted(problem, cameras, found)
    if problem.frames.fixed is None:
        similarity = fit(problem, cameras, found)
        require_metric(problem, similarity, found.mean(axis=0))
        cameras, found = similarity.points(cameras), similarity.points(found)
    if kind == "linear" or problem.frames.fixed is not None:
        poses, points = poses.copy(), found
        poses[:, :3, 3] = cameras
    heights = np.array([height.value_m for height in problem.frames.references.camera_heights])
    own = {key: value for room in problem.rooms for key, value in room.own.items()}
    return Start(problem, reading, doubts, Estimate(poses, points, heights, own))


def first_poses(problem: Problem) -> Floats:
    """Given poses (f, 4, 4) of the used frames: the fixed ones, or the start's."""
    given = problem.frames.fixed or problem.frames.start
    order = np.argsort(given.frames)
    return given.world_from_rig[order[np.searchsorted(given.frames[order], problem.used)]]


def first_points(problem: Problem) -> Floats:
    """The rooms' own starts (m, 3)."""
    points = np.zeros((len(problem.keys), 3))
    for room in problem.rooms:
        for name, key in room.keys.items():
            points[problem.index(key)] = room.initial[name]
    return points
