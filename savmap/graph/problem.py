"""All rooms in one problem: names resolved, arrays laid out."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property

import gtsam
import numpy as np

from savmap.errors import SiteError, StructureError
from savmap.graph.constraints import Constraints, Relation, each
from savmap.graph.distortion import Scene
from savmap.graph.keys import frame_key, is_frame
from savmap.graph.motion import velocities
from savmap.graph.observations import Observations, Sight, join, sight
from savmap.graph.references import Frames, KnownLength, SurveyedPoint
from savmap.types import Axis, Floats, Ints


@dataclass(frozen=True)
class Problem:
    """Frames, rooms and all relations (the rooms' own, then the references'). Array order: `used` frames, sorted `keys`."""

    frames: Frames
    rooms: tuple[Constraints, ...]
    relations: tuple[Relation, ...]
    observations: Observations

    @cached_property
    def used(self) -> Ints:
        """Numbers (f,) of the frames that saw something, sorted."""
        return np.unique(self.observations.frames)

    @cached_property
    def keys(self) -> Ints:
        """Landmark keys (m,), sorted."""
        return np.array(sorted(key for room in self.rooms for key in room.keys.values()), np.int64)

    @cached_property
    def at_frame(self) -> Ints:
        """Index (n,) into `used` of each observation."""
        return np.searchsorted(self.used, self.observations.frames)

    @cached_property
    def at_key(self) -> Ints:
        """Index (n,) into `keys` of each observation."""
        return np.searchsorted(self.keys, self.observations.keys)

    @cached_property
    def sight(self) -> Sight:
        """The observations' linear forms in the rig frame."""
        return sight(self.observations)

    def without(self, bias: Floats, poses: Floats, points: Floats) -> "Problem":
        """The problem with observations freed of biases (k,), where poses (f, 4, 4) and points (m, 3) are about these."""
        if not len(bias):
            return self
        term = self.frames.calibration
        if term is None:
            return replace(self, observations=self.observations.without(bias))
        own = len(term.names)
        rest = self.observations.without(np.concatenate([bias[:-own], np.zeros(own)]))
        return replace(self, observations=term.freed(rest, bias[-own:], self._scene(poses, points)))

    def _scene(self, poses: Floats, points: Floats) -> Scene:
        stamps = self.frames.facts.frames.stamps_s[self.used]
        speeds, rates = np.zeros((2, len(poses), 3))
        for chunk in self.passes():
            speeds[chunk], rates[chunk] = velocities(poses[chunk], stamps[chunk])
        own = np.swapaxes(poses[self.at_frame, :3, :3], 1, 2)
        places = points[self.at_key] - poses[self.at_frame, :3, 3]
        ahead = np.einsum("nij,nj->ni", own, speeds[self.at_frame])
        return Scene(np.einsum("nij,nj->ni", own, places), ahead, rates[self.at_frame])

    def index(self, key: int) -> int:
        """Place of a landmark's key in `keys`."""
        return int(np.searchsorted(self.keys, key))

    def residuals(self, world_from_rig: Floats, points: Floats) -> Floats:
        """Whitened errors (n, 2) for poses (f, 4, 4) and points (m, 3)."""
        poses = world_from_rig[self.at_frame]
        return self.sight.turned(poses[:, :3, :3]).residuals(points[self.at_key] - poses[:, :3, 3])[0]

    def passes(self, names: tuple[str, ...] = ()) -> Iterator[Ints]:
        """Indices into `used` pass by pass, in order of time."""
        table = self.frames.facts.frames
        for name in dict.fromkeys(table.passes):
            if not names or name in names:
                yield np.flatnonzero([table.passes[frame] == name for frame in self.used.tolist()])

    def name_of(self, key: int) -> tuple[str, str]:
        """Room and landmark name of a key."""
        return self._names[key]

    @cached_property
    def _names(self) -> dict[int, tuple[str, str]]:
        return {key: (room.room, name) for room in self.rooms for name, key in room.keys.items()}


def merge(frames: Frames, *rooms: Constraints) -> Problem:
    """Join the rooms and turn the references into relations.

    Raises SiteError for a reference to something that was not found, StructureError if nothing was observed.
    """
    if not any(len(room.observations) for room in rooms):
        raise StructureError(f"row {frames.facts.name}: nothing was tracked in any frame, so there is nothing to solve")
    observations = join([room.observations for room in rooms])
    observations = observations.take(np.isin(observations.frames, (frames.fixed or frames.start).frames))
    if not len(observations):
        raise StructureError(f"row {frames.facts.name}: no frame with a known pose saw anything")
    if frames.calibration is not None:
        observations = frames.calibration.added(observations)
    own = tuple(relation for room in rooms for relation in room.relations)
    solved = {frame_key(frame) for frame in np.unique(observations.frames).tolist()}
    kept = tuple(_over(room, solved) for room in rooms)
    return Problem(frames, kept, (*own, *_given(frames, rooms, own)), observations)


def _over(room: Constraints, frames: set[int]) -> Constraints:
    """A room without factors over other frames than those of these keys, and without variables of its own that only they bind."""
    factors = [one for one in each(room.factors) if _frames(one) <= frames]
    if room.factors is None or len(factors) == room.factors.size():
        return room
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.add(factor)
    bound = set[int]().union(*(factor.keys() for factor in factors))
    return replace(room, factors=graph, own={key: value for key, value in room.own.items() if key in bound})


def _frames(factor: gtsam.NonlinearFactor) -> set[int]:
    """Keys of the frames that a factor binds."""
    keys = factor.keys()
    return {key for key in keys if is_frame(key)}


def _given(frames: Frames, rooms: tuple[Constraints, ...], own: tuple[Relation, ...]) -> Iterator[Relation]:
    for length in frames.references.lengths:
        yield _length(length, rooms, own, frames.facts.name)
    for point in frames.references.points:
        yield from _point(point, rooms, frames.facts.name)


def _length(length: KnownLength, rooms: tuple[Constraints, ...], own: tuple[Relation, ...], row: str) -> Relation:
    axis_a, a = _find(length.start, rooms, row)
    axis_b, b = _find(length.end, rooms, row)
    axis = length.axis or axis_a or axis_b or _free_axis(a, b, own)
    if axis is None or len({axis, axis_a or axis, axis_b or axis}) > 1:
        raise SiteError(
            f"row {row}: length from '{length.start}' to '{length.end}' is along no one axis; name two parallel edges or give its axis"
        )
    return Relation(axis, a, b, length.value_m, length.sigma_m, f"length {length.start} to {length.end}")


def _point(point: SurveyedPoint, rooms: tuple[Constraints, ...], row: str) -> Iterator[Relation]:
    only, key = _find(point.name, rooms, row)
    axes: tuple[Axis, ...] = ("x", "y", "z")
    for axis, value in zip(axes, point.position_m, strict=True):
        if value is not None and only in (None, axis):
            yield Relation(axis, key, None, value, point.sigma_m, f"surveyed {point.name}, {axis}")


def _find(name: str, rooms: tuple[Constraints, ...], row: str) -> tuple[Axis | None, int]:
    for room in rooms:
        if name in room.places:
            return room.places[name]
        if name in room.keys:
            return None, room.keys[name]
    every = [known for room in rooms for known in (*room.places, *room.keys)]
    near = get_close_matches(name, every, 1, 0.0)
    hint = f"; the nearest name is '{near[0]}'" if near else ""
    raise SiteError(f"row {row}: reference to '{name}', but no such thing was found in the video{hint}")


def _free_axis(a: int, b: int, relations: tuple[Relation, ...]) -> Axis | None:
    """The one axis along which two vertices differ, by the grid; None if that is not clear."""
    axes: tuple[Axis, ...] = ("x", "y")
    free = [axis for axis in axes if not _tied(axis, a, b, relations)]
    return free[0] if len(free) == 1 else None


def _tied(axis: Axis, a: int, b: int, relations: tuple[Relation, ...]) -> bool:
    group = {a}
    pairs = [{r.a, r.b} for r in relations if r.axis == axis and r.b is not None and not r.name]
    while True:
        grown = group.union(*(pair for pair in pairs if pair & group))
        if grown == group:
            return b in group
        group = grown
