"""What all frames show together: objects on planes, found in their evidence, and measured in every frame at their
places.

The drive's path is roughly the camera's before the face, so that the networks' scores of all frames add up on the
planes that structures lie in. A plugin finds its objects there, each with the probability that it exists, and measures
their edges along their outlines, in the strips that the drive kept of the frames; the path is solved by these. A second
round does the same with that path.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import SiteError, SolveError, StructureError
from savmap.pipeline.first_path import paths_before_face
from savmap.pipeline.passes import laid_on, moved
from savmap.pipeline.path import completed, continued, located_by
from savmap.pipeline.records import MeasuredRow, RowMeasurements, WalkedRow, strips_of
from savmap.plugin.manager import LoadedPlugin
from savmap.types import (
    Feature,
    FlatDepth,
    Floats,
    FoundObject,
    Panorama,
    PlaneEvidence,
    PlanePatch,
    Structure,
    Trajectory,
)
from savmap.types.progress import Monitor
from savmap.vision.evidence import (
    FloorHeight,
    PackedView,
    depth_of,
    floor_before,
    floor_tracks,
    gather,
)
from savmap.vision.strips import PanoramaStrip

UPRIGHT = 0.99
"""The least y of the up direction of an upright plane."""
REACH = 3.0
"""What is further ahead or behind, in distances from its plane, is seen too far aslant to be measured."""


@dataclass(frozen=True, eq=False)
class Asked:
    """Where the camera was, up to scale, and what the plugins that were asked so far found from there."""

    path: Trajectory | None
    measurements: RowMeasurements


def find_structures(walked: WalkedRow, monitor: Monitor) -> MeasuredRow:
    """The row with what every plugin finds in the evidence of all frames, measured in each of them; those that locate
    the camera come first. Raises StructureError where one of these finds nothing."""
    measurements = walked.measurements
    walked = replace(walked, request=completed(walked.request, measurements.facts.frames))
    asked = Asked(walked.request.path, measurements)
    for plugin in sorted(walked.plugins, key=lambda plugin: plugin.name not in measurements.locators):
        if plugin.name in walked.packed_views and plugin.failure is None:
            locates = plugin.name in measurements.locators
            finder = Finder(walked, plugin)
            asked = finder.located(asked) if locates else finder.seen_from_path(asked, monitor)
    return MeasuredRow(walked.request, asked.measurements, strips=walked.strips)


class Finder:
    """Finds a plugin's objects in a row that was walked along."""

    def __init__(self, walked: WalkedRow, plugin: LoadedPlugin) -> None:
        self.walked, self.plugin = walked, plugin
        self.facts, self.packed_views = walked.measurements.facts, walked.packed_views[plugin.name]
        self._faces: list[PlanePatch] = []
        self._floor_share: float | None = None

    def located(self, asked: Asked) -> Asked:
        """With the objects of a plugin that locates the camera, the path by them, and how deep flat parts and the floor
        lie: in two rounds, of which the second finds and measures with the path that the first one gave."""
        measurements, path = asked.measurements, asked.path or self._first_path()
        points: Mapping[str, Floats] = {}
        for last in (False, True):
            measurements, path, points = self.round(measurements, path, points, last)
        depths = tuple(self._depths(path, points)) if self.plugin.has("flat_parts") else ()
        measurements = replace(measurements, depths=(*measurements.depths, *depths))
        floor = None if measurements.floor.tracks else self._floor(path, np.array([*points.values()]))
        if floor is not None and not self._is_above_something(floor.y, measurements, points):
            walked, face = self.walked, self._faces[-1]
            tracks = floor_tracks(face, walked.floor, walked.floor_views, path, floor)
            measurements = replace(measurements, floor=tracks)
        return Asked(path, replace(measurements, path=path))

    def round(
        self, measurements: RowMeasurements, path: Trajectory, points: Mapping[str, Floats], last: bool
    ) -> tuple[RowMeasurements, Trajectory, Mapping[str, Floats]]:
        """Gather, find, measure edges along outlines, track, constrain, solve up to scale: what was measured from a
        path, and the path and the landmarks by it. The floor is looked for in the last round, whose path is exact."""
        measured = self._measured(measurements, path, points, last)
        try:
            located = located_by(self.plugin, self.walked.request, measured, path)
        except (SolveError, SiteError) as error:
            raise StructureError(f"row {self.facts.name}: what is found cannot be solved: {error}") from error
        return measured, continued(located.path, self.facts.frames), located.points[self.plugin.name]

    def seen_from_path(self, asked: Asked, monitor: Monitor) -> Asked:
        """With the objects of a plugin that needs to be told where the camera was."""
        if asked.path is None:
            return asked
        try:
            return Asked(asked.path, self._measured(asked.measurements, asked.path, {}, True))
        except StructureError as error:
            monitor.note(str(error))
            return Asked(asked.path, self._with(asked.measurements, [], []))

    def _first_path(self) -> Trajectory:
        """The drive's path before the face; those of several passes laid on one another by what is found in each."""
        paths = paths_before_face(self.walked, self.plugin)
        if len(paths) == 1:
            return paths[0]
        of_pass = [self._found(path) for path in paths]
        main = int(np.argmax([len(objects) for objects in of_pass]))
        for number, objects in enumerate(of_pass):
            if number != main:
                laid = laid_on(of_pass[main], objects)
                if laid is None:
                    raise StructureError(
                        f"row {self.facts.name}: passes {number + 1} and {main + 1} do not show enough of the same bays"
                    )
                paths[number] = moved(paths[number], laid)
        return Trajectory.joined(paths)

    def _found(self, path: Trajectory) -> list[FoundObject]:
        """What a first look from a path finds."""
        return self.plugin.find(lambda patch: self._gather(path, patch), path, {}, self.facts, None)

    def _measured(
        self, measurements: RowMeasurements, path: Trajectory, points: Mapping[str, Floats], on_floor: bool
    ) -> RowMeasurements:
        """With what is found from a path, above the floor if that is to be looked for, and features of it in all
        frames."""
        gathered: dict[tuple[bytes, bytes, float], PlaneEvidence] = {}

        def evidence(patch: PlanePatch) -> PlaneEvidence:
            key = np.append(patch.origin, patch.size).tobytes(), patch.axes.tobytes(), patch.cell
            if key not in gathered:
                gathered[key] = self._gather(path, patch)
            return gathered[key]

        objects = self.plugin.find(evidence, path, points, self.facts, None)
        mapped = [item for item in objects if item.is_mapped]
        outlines = [np.zeros((0, 3)), *(item.outline for item in mapped)]
        floor = self._floor(path, np.concatenate(outlines)) if on_floor else None
        if floor is not None and lies_below(floor.y, mapped):
            objects = self.plugin.find(evidence, path, points, self.facts, floor.y)
            mapped = [item for item in objects if item.is_mapped]
        return self._with(measurements, objects, [*self._features(mapped, path)])

    def _with(
        self, measurements: RowMeasurements, objects: list[FoundObject], features: list[Feature]
    ) -> RowMeasurements:
        name = self.plugin.name
        return replace(
            measurements,
            features={**measurements.features, name: features},
            objects={**measurements.objects, name: tuple(objects)},
        )

    def _gather(self, path: Trajectory, patch: PlanePatch) -> PlaneEvidence:
        if patch.up[1] > UPRIGHT:
            self._faces.append(patch)
        return gather(patch, self.plugin.classes, self.packed_views, self.facts.views, path)

    def _floor(self, path: Trajectory, points: Floats) -> FloorHeight | None:
        """Where the floor is before the upright plane that was looked at last, where the pictures tell."""
        if not self._faces or not len(points):
            return None
        walked, face = self.walked, self._faces[-1]
        floor = floor_before(face, points, walked.floor, walked.floor_views, path, self._floor_share)
        self._floor_share = floor.share if floor else None
        return floor

    def _is_above_something(self, y: float, measurements: RowMeasurements, points: Mapping[str, Floats]) -> bool:
        """Whether all landmarks of some mapped object lie below a height: then that is not the floor's."""
        heights: dict[str, list[float]] = {item.id: [] for item in measurements.objects[self.plugin.name]}
        for name, point in points.items():
            for item in heights:
                if name.startswith(f"{item} / "):
                    heights[item].append(float(point[1]))
        return any(max(of_item) < y for of_item in heights.values() if of_item)

    def _depths(self, path: Trajectory, points: Mapping[str, Floats]) -> Iterator[FlatDepth]:
        """How deep the plugin's flat parts lie, where the pictures tell."""
        for flat in self.plugin.flat_parts(points):
            depth = depth_of(self.plugin.name, flat, self.packed_views, self.facts.views, path)
            if depth is not None:
                yield depth

    def _features(self, objects: list[FoundObject], path: Trajectory) -> Iterator[Feature]:
        """What is measured of objects in all frames whose pose is known."""
        series = strips_of(self.walked.request.name)
        strip: PanoramaStrip | None = None
        panorama: Panorama | None = None
        for packed, pose, near in self._shown(objects, path):
            if strip is None or strip.frame != packed.frame:
                strip = self.walked.journal.get(PanoramaStrip, series, packed.frame)
                panorama = strip.panorama() if strip is not None else None
            if panorama is not None:
                spec, scores = self.facts.views[packed.view], packed.probabilities()
                yield from self.plugin.measure(near, spec, packed.frame, pose, scores, panorama)

    def _shown(
        self, objects: list[FoundObject], path: Trajectory
    ) -> Iterator[tuple[PackedView, Floats, list[FoundObject]]]:
        """Views of frames whose pose (4, 4) is known, and the objects that are not too far ahead or behind there."""
        poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
        places = path.world_from_rig[:, :3, 3]
        along = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)[2][0]
        for packed in self.packed_views:
            if (pose := poses.get(packed.frame)) is not None:
                yield packed, pose, [item for item in objects if is_near(item, pose[:3, 3], along)]


def lies_below(y: float, objects: Sequence[FoundObject]) -> bool:
    """Whether some objects lie below a height that nothing beside them reaches through: what does stands on no floor
    there."""
    spans = np.array([[item.outline[:, 1].min(), item.outline[:, 1].max()] for item in objects]).reshape(-1, 2)
    below = spans[:, 1] < y
    through = ~below & (spans[:, 0] < np.max(spans[below, 1], initial=-np.inf))
    return bool(below.any() and not through.any())


def is_near(item: FoundObject, camera: Floats, along: Floats) -> bool:
    """Whether a camera (3,) that goes along a direction (3,) is before some corner or the middle of an object, but for
    `REACH` of its distance from the object's plane."""
    middle = item.outline.mean(axis=0)
    normal = np.linalg.svd(item.outline - middle, full_matrices=False)[2][2]
    rays = np.vstack([item.outline, middle]) - camera
    return bool((np.abs(rays @ along) < REACH * np.abs(rays @ normal)).any())


def uncertain_objects(objects: Iterable[FoundObject], structures: Sequence[Structure]) -> tuple[FoundObject, ...]:
    """What is found and not mapped, in metres: laid there as the mapped objects lie where their structures are."""
    objects = [*objects]
    places = {structure.id: structure.vertices.mean(axis=0) for structure in structures}
    mapped = [item for item in objects if item.id in places]
    others = [item for item in objects if item.id not in places]
    if len(mapped) < 2 or not others:
        return ()
    before = np.array([item.outline.mean(axis=0) for item in mapped])
    after = np.array([places[item.id] for item in mapped])
    scale = float(np.linalg.norm(after - after.mean(axis=0)) / np.linalg.norm(before - before.mean(axis=0)))
    return tuple(
        replace(item, outline=after.mean(axis=0) + scale * (item.outline - before.mean(axis=0))) for item in others
    )
