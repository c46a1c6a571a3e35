"""All plugins' constraints and the user's references in one problem: names resolved, arrays laid out."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property

import gtsam
import numpy as np

from savmap.errors import SiteError, StructureError
from savmap.graph.calibration import Scene, drive_axes, velocities
from savmap.graph.constraints import Constraints, Relation, factors_in
from savmap.graph.factors.walked import walked_constraints
from savmap.graph.keys import Variable, frame_key, is_frame
from savmap.graph.measurements import ImageMeasurements, LinearForms, join, linear_forms
from savmap.graph.references import CameraPriors, KnownLength, References, SurveyedPoint
from savmap.types import Axis, Floats, Ints

SURE_PX, UNKNOWNS = 20.0, 6
CARRIED_PX = 0.5
"""Beside its noise, of what a camera sees that is carried by hand: it turns while a picture is read out."""
NUMBER = re.compile(r"\d+")


@dataclass(frozen=True, eq=False)
class Problem:
    """What is known of the camera, all plugins' `parts`, and all relations (the plugins', then those of the
    references).

    Array order: `used` frames, sorted `keys`. A `partial` problem holds only the plugins that locate the camera:
    references to other plugins' landmarks are left out, and `assumed` says what of scale and place was assumed instead,
    if anything.
    """

    camera: CameraPriors
    parts: tuple[Constraints, ...]
    relations: tuple[Relation, ...]
    measurements: ImageMeasurements
    partial: bool = False
    assumed: tuple[str, ...] = ()

    @cached_property
    def used(self) -> Ints:
        """Numbers (f,) of the frames that something was measured in, or that a plugin's factor binds, sorted."""
        return np.union1d(self.measurements.frames, frames_of(self.parts))

    @cached_property
    def keys(self) -> Ints:
        """Landmark keys (m,), sorted."""
        return np.array(sorted(key for part in self.parts for key in part.keys.values()), np.int64)

    @cached_property
    def at_frame(self) -> Ints:
        """Index (n,) into `used` of each measurement."""
        return np.searchsorted(self.used, self.measurements.frames)

    @cached_property
    def at_key(self) -> Ints:
        """Index (n,) into `keys` of each measurement."""
        return np.searchsorted(self.keys, self.measurements.keys)

    @cached_property
    def linear_forms(self) -> LinearForms:
        """The measurements' linear forms in the rig frame."""
        return linear_forms(self.measurements)

    def without(self, bias: Floats, poses: Floats, points: Floats) -> "Problem":
        """The problem with measurements corrected for biases (k,), where poses (f, 4, 4) and points (m, 3) are near
        these."""
        if not len(bias):
            return self
        term = self.camera.calibration
        if term is None:
            return replace(self, measurements=self.measurements.without(bias))
        count = len(term.names)
        rest = self.measurements.without(np.concatenate([bias[:-count], np.zeros(count)]))
        return replace(self, measurements=term.corrected(rest, bias[-count:], self._scene(poses, points)))

    def _scene(self, poses: Floats, points: Floats) -> Scene:
        stamps = self.camera.facts.frames.stamps_s[self.used]
        speeds, rates = np.zeros((2, len(poses), 3))
        for of_pass in self.passes():
            speeds[of_pass], rates[of_pass] = velocities(poses[of_pass], stamps[of_pass])
        rig_from_world = np.swapaxes(poses[self.at_frame, :3, :3], 1, 2)
        offsets = points[self.at_key] - poses[self.at_frame, :3, 3]
        ahead = np.einsum("nij,nj->ni", rig_from_world, speeds[self.at_frame])
        drive = drive_axes(poses, speeds)
        return Scene(np.einsum("nij,nj->ni", rig_from_world, offsets), ahead, rates[self.at_frame], drive)

    @cached_property
    def presumed(self) -> Mapping[str, str]:
        """What plugins take for granted, by name, with what to tell the user where it is not so."""
        return {relation.name: relation.presumed for relation in self.relations if relation.presumed}

    @cached_property
    def not_given(self) -> frozenset[str]:
        """Names of references that nobody measured."""
        return frozenset(relation.name for relation in self.relations if not relation.is_given)

    def index(self, key: int) -> int:
        """Index of a landmark's key in `keys`."""
        return int(np.searchsorted(self.keys, key))

    def residuals(self, world_from_rig: Floats, points: Floats) -> Floats:
        """Whitened errors (n, 2) for poses (f, 4, 4) and points (m, 3)."""
        poses = world_from_rig[self.at_frame]
        return self.linear_forms.rotated(poses[:, :3, :3]).residuals(points[self.at_key] - poses[:, :3, 3])[0]

    def passes(self, names: tuple[str, ...] = ()) -> Iterator[Ints]:
        """Indices into `used` pass by pass, in order of time."""
        table = self.camera.facts.frames
        for name in dict.fromkeys(table.passes):
            if not names or name in names:
                yield np.flatnonzero([table.passes[frame] == name for frame in self.used.tolist()])

    def name_of(self, key: int) -> tuple[str, str]:
        """Plugin and landmark name of a key."""
        return self._names[key]

    @cached_property
    def _names(self) -> dict[int, tuple[str, str]]:
        return {key: (part.plugin, name) for part in self.parts for name, key in part.keys.items()}


@dataclass(frozen=True, eq=False)
class Estimate:
    """Poses world_from_rig (f, 4, 4) of the used frames, points (m, 3), camera heights (h,) of the references, and the
    plugins' variables by key."""

    poses: Floats
    points: Floats
    heights: Floats
    variables: Mapping[int, Variable] = field(default_factory=dict)


def merge(camera: CameraPriors, *parts: Constraints, partial: bool = False) -> Problem:
    """Join the plugins' parts and turn the references into relations.

    With `partial`, references to names that these plugins do not have are left out, for the camera is located before
    the other plugins' landmarks are known. Frames that saw less than places them are left out, unless a walked path
    binds them to the rest. Raises SiteError for a reference to an unknown name otherwise,
    StructureError if nothing was measured: no landmark in a frame with a first pose nor, where the camera's path is
    given, anything by a plugin's factor in one of its frames.
    """
    measurements = _measured(camera, parts, camera.walked is not None)
    if camera.walked is not None:
        measurements = replace(measurements, covariances=measurements.covariances + CARRIED_PX**2 * np.eye(2))
    if camera.calibration is not None:
        measurements = camera.calibration.with_parameters(measurements)
    frames = measurements.frames if camera.fixed is None else np.union1d(measurements.frames, camera.fixed.frames)
    solved = {frame_key(frame) for frame in np.unique(frames).tolist()}
    kept = tuple(_within(part, solved) for part in parts)
    if camera.walked is not None:
        kept = (*kept, walked_constraints(camera.walked, camera.facts.frames, np.unique(frames)))
    if not len(measurements) and not len(frames_of(kept)):
        raise StructureError(f"row {camera.facts.name}: no frame with a known pose saw anything")
    structure = tuple(relation for part in parts for relation in part.relations)
    references = _uniquely_named(_reference_relations(camera, parts, structure, partial))
    return Problem(camera, kept, (*structure, *references), measurements, partial)


def _measured(camera: CameraPriors, parts: Sequence[Constraints], all_frames: bool) -> ImageMeasurements:
    """All measurements in frames with a first pose, those that show little among them if `all_frames`. Raises
    StructureError where there is nothing at all to solve."""
    bound = camera.fixed is not None and any(part.factors is not None and part.factors.size() for part in parts)
    if not bound and not any(len(part.measurements) for part in parts):
        raise StructureError(f"row {camera.facts.name}: nothing was tracked in any frame, so there is nothing to solve")
    measurements = join([part.measurements for part in parts])
    measurements = measurements.take(np.isin(measurements.frames, (camera.fixed or camera.start).frames))
    return measurements if all_frames or camera.fixed is not None else _of_sure_frames(measurements)


def _of_sure_frames(measurements: ImageMeasurements) -> ImageMeasurements:
    """Those of frames with as many equations as a pose has unknowns: a few others spoil the whole. A pixel anywhere
    along a line gives one equation."""
    equations = (np.linalg.eigvalsh(measurements.covariances) < SURE_PX**2).sum(axis=1)
    frames, index = np.unique(measurements.frames, return_inverse=True)
    sure = np.bincount(index, weights=equations, minlength=len(frames)) >= UNKNOWNS
    return measurements.take(sure[index])


def first_poses(problem: Problem) -> Floats:
    """Given poses (f, 4, 4) of the used frames: the fixed ones, or the start's."""
    given = problem.camera.fixed or problem.camera.start
    order = np.argsort(given.frames)
    return given.world_from_rig[order[np.searchsorted(given.frames[order], problem.used)]]


def _within(part: Constraints, frames: set[int]) -> Constraints:
    """A part without factors that bind other frames than these keys', and the variables that only they bind."""
    factors = [factor for factor in factors_in(part.factors) if _frame_keys(factor) <= frames]
    if part.factors is None or len(factors) == part.factors.size():
        return part
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.add(factor)
    bound = set[int]().union(*(factor.keys() for factor in factors))
    variables = {key: value for key, value in part.variables.items() if key in bound}
    return replace(part, factors=graph, variables=variables)


def _frame_keys(factor: gtsam.NonlinearFactor) -> set[int]:
    """Keys of the frames that a factor binds."""
    keys = factor.keys()
    return {key for key in keys if is_frame(key)}


def frames_of(parts: Sequence[Constraints]) -> Ints:
    """Numbers (k,) of the frames that the plugins' factors bind."""
    keys = set[int]().union(*(_frame_keys(factor) for part in parts for factor in factors_in(part.factors)))
    return np.array(sorted(gtsam.symbolIndex(key) for key in keys), np.int64)


def _reference_relations(
    camera: CameraPriors, parts: tuple[Constraints, ...], structure: tuple[Relation, ...], partial: bool
) -> Iterator[Relation]:
    row = camera.facts.name
    names = _names_of(parts)
    for length in camera.references.lengths:
        if not partial or {length.start, length.end} <= set(names):
            yield _length(length, parts, structure, row)
    for point in camera.references.points:
        if not partial or point.name in names:
            yield from _point(point, parts, row)


def found_references(
    references: References, parts: Sequence[Constraints], row: str
) -> tuple[References, Mapping[str, str]]:
    """The references of which every landmark was found, and of the others, by name, a line that says so."""
    names, missed = _names_of(parts), dict[str, str]()

    def is_found(reference: str, *needed: str) -> bool:
        for name in needed:
            if name not in names:
                missed[reference] = _not_found(name, names, row)
        return reference not in missed

    lengths = tuple(
        item for item in references.lengths if is_found(f"length {item.start} to {item.end}", item.start, item.end)
    )
    points = tuple(item for item in references.points if is_found(f"surveyed {item.name}", item.name))
    return replace(references, lengths=lengths, points=points), missed


def _not_found(name: str, names: Sequence[str], row: str) -> str:
    """What to tell the user of a reference to what was not found."""
    return f"row {row}: reference to '{name}', but no such thing was found in the video{_nearest_name(name, names)}"


def _uniquely_named(relations: Iterable[Relation]) -> Iterator[Relation]:
    """What is given twice is two references, either of which may be wrong: each has its name."""
    seen: dict[str, int] = {}
    for relation in relations:
        seen[relation.name] = count = seen.get(relation.name, 0) + 1
        yield replace(relation, name=f"{relation.name} (given again, {count})") if count > 1 else relation


def _length(length: KnownLength, parts: tuple[Constraints, ...], structure: tuple[Relation, ...], row: str) -> Relation:
    axis_a, a = _named_coordinate(length.start, parts, row)
    axis_b, b = _named_coordinate(length.end, parts, row)
    axis = length.axis or axis_a or axis_b or _free_axis(a, b, structure)
    if axis is None or len({axis, axis_a or axis, axis_b or axis}) > 1:
        raise SiteError(
            f"row {row}: length from '{length.start}' to '{length.end}' is along no one axis; "
            "name two parallel edges or give its axis"
        )
    return Relation(axis, a, b, length.value_m, length.sigma_m, f"length {length.start} to {length.end}")


def _point(point: SurveyedPoint, parts: tuple[Constraints, ...], row: str) -> Iterator[Relation]:
    only, key = _named_coordinate(point.name, parts, row)
    axes: tuple[Axis, ...] = ("x", "y", "z")
    for axis, value in zip(axes, point.position_m, strict=True):
        if value is not None and only in (None, axis):
            yield Relation(axis, key, None, value, point.sigma_m, f"surveyed {point.name}, {axis}")


def _named_coordinate(name: str, parts: tuple[Constraints, ...], row: str) -> tuple[Axis | None, int]:
    """The axis, if it is one coordinate only, and the landmark's key of a name in a reference."""
    for part in parts:
        if name in part.coordinates:
            return part.coordinates[name]
        if name in part.keys:
            return None, part.keys[name]
    raise SiteError(_not_found(name, _names_of(parts), row))


def _names_of(parts: Sequence[Constraints]) -> list[str]:
    """The names that references may use."""
    return [name for part in parts for name in (*part.coordinates, *part.keys)]


def _nearest_name(name: str, names: Sequence[str]) -> str:
    """A hint at the name that was meant: that with the nearest numbers, else the most alike."""
    alike = [other for other in names if NUMBER.split(other) == NUMBER.split(name)]
    if alike:
        wanted = np.array(NUMBER.findall(name), dtype=np.float64)
        near = min(alike, key=lambda other: float(np.abs(np.array(NUMBER.findall(other), np.float64) - wanted).sum()))
        return f"; the nearest name is '{near}': is all of the row in the video?"
    close = get_close_matches(name, names, 1, 0.0)
    return f"; the nearest name is '{close[0]}'" if close else ""


def _free_axis(a: int, b: int, structure: tuple[Relation, ...]) -> Axis | None:
    """The one axis along which two landmarks differ, by the grid; None if that is not clear."""
    axes: tuple[Axis, ...] = ("x", "y")
    free = [axis for axis in axes if not _connected(axis, a, b, structure)]
    return free[0] if len(free) == 1 else None


def _connected(axis: Axis, a: int, b: int, structure: tuple[Relation, ...]) -> bool:
    """Whether relations along an axis bind two landmarks, through others or not."""
    group = {a}
    pairs = [{r.a, r.b} for r in structure if r.axis == axis and r.b is not None and not r.name]
    while True:
        grown = group.union(*(pair for pair in pairs if pair & group))
        if grown == group:
            return b in group
        group = grown
