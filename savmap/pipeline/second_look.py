"""The second look: what all frames show together, on the planes that structures lie in, may differ from what single frames showed.

Once the camera's path is roughly known, the network's probabilities of all frames are added up on these planes
(savmap.vision.evidence). Where a plugin finds other objects in them than were tracked, every frame is measured again with these in
mind: faint ones are followed that no threshold finds, and what only looks like one in a few frames is passed over. The frames'
pictures tell where the floor is before each look, and in the end how deep flat parts lie, where a plugin asks for that.
"""

import logging
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap import graph
from savmap.errors import PluginFailedError, SiteError, SolveError, StructureError
from savmap.graph import References
from savmap.pipeline.initial_poses import first_poses
from savmap.pipeline.records import MeasuredRow, RowMeasurements, RowRequest, WalkedRow, strips_of
from savmap.plugin.manager import LoadedPlugin
from savmap.types import (
    Doubt,
    Expected,
    Feature,
    FlatDepth,
    Floats,
    Panorama,
    PlanePatch,
    Trajectory,
    View,
    ViewSpec,
)
from savmap.types.progress import Monitor
from savmap.vision.evidence import (
    DetectionSettings,
    FloorHeight,
    FloorTracks,
    Outlined,
    PackedView,
    depth_of,
    drift_of,
    expected_detections,
    floor_height,
    floor_tracks,
    gather,
    inner_part,
    lies_behind,
    outlines_in,
)
from savmap.vision.networks.segmenter import Segmentation
from savmap.vision.strips import PanoramaStrip

LOOKS = 2
LEAST_LANDMARKS = 2
UPRIGHT = 0.99
BELOW_FLOOR = 0.4
"""The floor is never higher than this share of the tracked points. Some true points lie below it: uprights' edges are extended to the picture's border.
These are a third of all points at most."""
BEYOND = 0.1
"""By so large a share of their extent may landmarks differ from look to look: the path's scale is an assumed one."""


@dataclass(frozen=True, eq=False)
class Expectation:
    """The objects that a plugin expects, those that are absent too, and the path of the camera, both in the unit of that path; the first positions (3,) of the
    landmarks that were tracked instead, and the planes that the objects lie in."""

    objects: Sequence[Expected]
    path: Trajectory
    points: Mapping[str, Floats] = field(default_factory=dict)
    planes: Sequence[PlanePatch] = ()

    @property
    def there(self) -> list[Expected]:
        """The objects without those that are absent."""
        return [thing for thing in self.objects if not thing.absent]

    @property
    def amiss(self) -> int:
        """How many objects were not tracked though they are there, or tracked though they are absent."""
        return sum(1 for _ in self.untracked()) + len(self.objects) - len(self.there)

    def untracked(self) -> Iterator[tuple[Expected, Doubt]]:
        """Each object at whose outline nothing was tracked, and a doubt about it."""
        for thing in self.there if self.points else ():
            if len(self._tracked_at(thing)) < LEAST_LANDMARKS:
                what = "all frames show something that is not mapped"
                action = f"look whether it is missing: {thing.label} near {self._nearest(thing)}"
                yield thing, Doubt("support", what, action=action)

    def unseen(self) -> Iterator[Doubt]:
        """A doubt about each object that is absent, and was tracked all the same."""
        for thing in self.objects:
            names = self._tracked_at(thing) if thing.absent else []
            if len(names) >= LEAST_LANDMARKS:
                what = "frames together do not show an element"
                action = f"look whether it is {thing.label}: {max(names, key=names.count)}"
                yield Doubt("support", what, action=action)

    def reaches_beyond(self, points: Mapping[str, Floats]) -> bool:
        """Whether an object that is there and was tracked lies beyond landmarks (3,) that are tracked later, by more than `BEYOND` of their extent."""
        if not points:
            return False
        places = np.array([*points.values()])
        low, high = places.min(axis=0), places.max(axis=0)
        room = BEYOND * float((high - low).max())
        return any(
            bool((thing.outline.min(axis=0) > high + room).any() or (thing.outline.max(axis=0) < low - room).any())
            for thing in self.there
            if len(self._tracked_at(thing)) >= LEAST_LANDMARKS
        )

    def _tracked_at(self, thing: Expected) -> list[str]:
        """The structure of each landmark that was tracked at an object's outline."""
        low, high = thing.outline.min(axis=0), thing.outline.max(axis=0)
        room = np.sort(high - low)[1] / 2
        return [
            structure_of(name)
            for name, place in self.points.items()
            if (place > low - room).all() and (place < high + room).all()
        ]

    def _nearest(self, thing: Expected) -> str:
        """The structure of the landmark that is nearest to the middle of an object."""
        middle = (thing.outline.min(axis=0) + thing.outline.max(axis=0)) / 2
        return structure_of(min(self.points, key=lambda name: float(np.linalg.norm(self.points[name] - middle))))


def structure_of(landmark: str) -> str:
    """What a landmark's name says it is of."""
    return landmark.rsplit(" / ", 1)[0]


def look_again(measured: WalkedRow, monitor: Monitor) -> MeasuredRow:
    """What was measured, with the features of each plugin anew whose evidence shows other objects than were tracked. What is still not
    tracked after the last look is doubted."""
    row, measurements = measured.request, measured.measurements
    for plugin in measured.plugins:
        if (
            plugin.name not in measured.packed_views
            or plugin.name not in measurements.locators
            or plugin.failure is not None
        ):
            continue
        alone = PluginAlone(row, plugin)
        measurements = best_measurements(alone, measured, measurements, monitor)
        depths = tuple(depths_of(alone, measured, measurements)) if plugin.has("flat_parts") else ()
        measurements = replace(measurements, depths=(*measurements.depths, *depths)) if depths else measurements
        if measured.floor and not measurements.floor.tracks:
            measurements = replace(measurements, floor=floor_of(alone, measured, measurements))
    return MeasuredRow(row, measurements, strips=measured.strips)


def not_followed(plugin: LoadedPlugin) -> Doubt:
    """A doubt where what was measured anew cannot be tracked, so that what was measured at first stays."""
    details = ("what single frames show is mapped",)
    action = f"look at what is mapped of: {plugin.name}"
    return Doubt("support", "what all frames show could not be tracked", action=action, details=details)


class PluginAlone:
    """A plugin and where the camera was by what it alone tracked, worked out once for the same features. `floor_share`: how high the camera is over the
    floor, as a share of its distance from the plugin's upright plane, where the pictures told."""

    def __init__(self, row: RowRequest, plugin: LoadedPlugin) -> None:
        self.row, self.plugin = row, plugin
        self.floor_share: float | None = None
        self._features: Sequence[Feature] | None = None
        self._located: graph.LocatedCamera | None = None

    def located(self, measurements: RowMeasurements) -> graph.LocatedCamera | None:
        """The camera's path and the landmarks; None where the plugin cannot be tracked at all.

        The scale of the path may be an assumed one: no reference is used, for other references are no reason to look again.
        """
        features = measurements.features[self.plugin.name]
        if features is not self._features:
            self._features, self._located = features, self._locate(features, measurements)
        return self._located

    def _locate(self, features: Sequence[Feature], measurements: RowMeasurements) -> graph.LocatedCamera | None:
        alone, path = self.plugin.before_pixels(), self.row.path
        bare = replace(self.row, references=References(), travel_m=None, calibration=None)
        try:
            start, frames = first_poses(bare, measurements)
            with warnings_held_back():
                tracks = alone.track(features, measurements.facts, start.world_from_rig[:, :3, :3], path)
                constraints = alone.constrain(tracks, measurements.facts, path or start)
            return graph.locate_camera(graph.merge(frames, constraints, partial=True))
        except (StructureError, SolveError, SiteError, PluginFailedError):
            return None


def best_measurements(
    alone: PluginAlone, measured: WalkedRow, measurements: RowMeasurements, monitor: Monitor
) -> RowMeasurements:
    """The measurements, of the first ones and those of up to `LOOKS` looks, after which the fewest of a plugin's expected objects are amiss.

    A look may lose what an earlier one had; one that loses an end of what was tracked is not used, and is the last. Each object that is still amiss is
    doubted.
    """
    row, plugin, doubts = alone.row.name, alone.plugin, list[Doubt]()
    states = [(measurements, expect(alone, measured, measurements))]
    while len(states) <= LOOKS and (expectation := states[-1][1]) is not None:
        monitor.note(f"row {row}: `{plugin.name}` looks again for {len(expectation.there)} objects")
        features = SecondLook(plugin, expectation, measured).features()
        anew = replace(measurements, features={**measurements.features, plugin.name: features})
        located = alone.located(anew)
        if located is None:
            doubts = [not_followed(plugin)]
            break
        if expectation.reaches_beyond(located.points[plugin.name]):
            break
        states.append((anew, expect(alone, measured, anew)))
    best, left = min(reversed(states), key=lambda state: state[1].amiss if state[1] is not None else 0)
    if left is not None and not doubts:
        doubts = [*unexplained(left, measured.packed_views[plugin.name], measurements.facts.views), *left.unseen()]
    return replace(best, doubts=(*best.doubts, *doubts)) if doubts else best


def expect(alone: PluginAlone, measured: WalkedRow, measurements: RowMeasurements) -> Expectation | None:
    """What a plugin expects by the evidence; None where that is what it tracked, or where it cannot be tracked at all."""
    located, plugin = alone.located(measurements), alone.plugin
    if located is None:
        return None
    points, packed_views, views = (
        located.points[plugin.name],
        measured.packed_views[plugin.name],
        measurements.facts.views,
    )
    planes = plugin.planes(points)
    evidence = [gather(patch, plugin.classes, packed_views, views, located.path) for patch in planes]
    floor = floor_before(alone, measured, located.path, planes, points) if evidence else None
    objects = plugin.expect(points, evidence, floor.y if floor else None) if evidence else []
    return Expectation(objects, located.path, points, planes) if objects else None


def unexplained(
    left: Expectation, packed_views: Sequence[PackedView], views: Mapping[str, ViewSpec]
) -> Iterator[Doubt]:
    """A doubt about each object at whose outline nothing was tracked, but for what only shows through an opening of its plane: the rear of a
    structure is level, too, and goes on in the evidence of its front. What stands above or below it in the same opening is behind it as well
    where most does and nothing in it was tracked. Of what stands across the camera's way no picture tells that; where all that meets it lies
    behind, so does it."""
    behind: set[int] = set()
    across, along = list[tuple[Expected, Doubt]](), list[tuple[Expected, Doubt]]()
    for thing, doubt in left.untracked():
        part = inner_part(thing.outline, left.planes)
        (across if part is None else along).append((thing, doubt))
        if part is not None and lies_behind(part, packed_views, views, left.path):
            behind.add(id(thing))
    missing = {id(thing) for thing, _ in along}
    for thing, doubt in along:
        others = [id(other) for other in left.there if other is not thing and is_over(thing, other)]
        through = missing.issuperset(others) and 2 * sum(other in behind for other in others) > len(others) + 1
        if id(thing) not in behind and not through:
            yield doubt
    for thing, doubt in across:
        met = [other for other in left.objects if other is not thing and meets(thing, other)]
        if not met or any(id(other) not in behind for other in met):
            yield doubt


def is_over(one: Expected, other: Expected) -> bool:
    """Whether an object is above or below another, as long: their outlines' longest extents are the same to a tenth."""
    (low, high), (first, last) = ((thing.outline.min(axis=0), thing.outline.max(axis=0)) for thing in (one, other))
    axis, room = int((high - low).argmax()), 0.1 * float((high - low).max())
    return bool(abs(low[axis] - first[axis]) < room and abs(high[axis] - last[axis]) < room)


def meets(one: Expected, other: Expected) -> bool:
    """Whether two objects' outlines touch, to half of the lesser thickness of either."""
    (low, high), (first, last) = ((thing.outline.min(axis=0), thing.outline.max(axis=0)) for thing in (one, other))
    room = min(float(np.sort(size)[1]) for size in (high - low, last - first)) / 2
    return bool((low < last + room).all() and (first < high + room).all())


def depths_of(alone: PluginAlone, measured: WalkedRow, measurements: RowMeasurements) -> Iterator[FlatDepth]:
    """How deep the plugin's flat parts lie, where the pictures tell."""
    located, plugin = alone.located(measurements), alone.plugin
    if located is None:
        return
    packed_views, views = measured.packed_views[plugin.name], measurements.facts.views
    for flat in plugin.flat_parts(located.points[plugin.name]):
        depth = depth_of(plugin.name, flat, packed_views, views, located.path)
        if depth is not None:
            yield depth


def floor_before(
    alone: PluginAlone,
    measured: WalkedRow,
    path: Trajectory,
    planes: Sequence[PlanePatch],
    points: Mapping[str, Floats],
) -> FloorHeight | None:
    """The floor before the first upright plane of a plugin's, where the pictures tell. What lies higher than much of what was tracked, points (3,), is
    something else."""
    face = first_upright(planes)
    if face is None:
        return None
    floor = floor_height(face, measured.floor, measured.floor_views, path, alone.floor_share)
    if floor is None or floor.y > np.quantile([place[1] for place in points.values()], BELOW_FLOOR):
        return None
    alone.floor_share = floor.share
    return floor


def floor_of(alone: PluginAlone, measured: WalkedRow, measurements: RowMeasurements) -> FloorTracks:
    """Points of the floor before the plugin's first upright plane, where the pictures tell."""
    located = alone.located(measurements)
    if located is None:
        return FloorTracks()
    points = located.points[alone.plugin.name]
    planes = alone.plugin.planes(points)
    face, floor = first_upright(planes), floor_before(alone, measured, located.path, planes, points)
    if face is None or floor is None:
        return FloorTracks()
    return floor_tracks(face, measured.floor, measured.floor_views, located.path, floor)


def first_upright(planes: Sequence[PlanePatch]) -> PlanePatch | None:
    """The first of the planes that stands upright."""
    return next((plane for plane in planes if plane.up[1] > UPRIGHT), None)


@contextmanager
def warnings_held_back() -> Iterator[None]:
    """While this lasts, what plugins and libraries warn of in this thread is not told: what is used in the end is tracked once more,
    and that is told."""
    here = threading.get_ident()

    def told(record: logging.LogRecord) -> bool:
        return record.thread != here or record.levelno > logging.WARNING

    handlers = tuple(logging.getLogger().handlers)
    for handler in handlers:
        handler.addFilter(told)
    try:
        yield
    finally:
        for handler in handlers:
            handler.removeFilter(told)


class SecondLook:
    """Measures what is expected in single frames, in the strips that the drive kept of them."""

    def __init__(self, plugin: LoadedPlugin, expectation: Expectation, walked: WalkedRow) -> None:
        self.plugin, self.expected, self.walked, self.settings = plugin, expectation, walked, DetectionSettings()
        self.poses = dict(zip(expectation.path.frames.tolist(), expectation.path.world_from_rig, strict=True))

    def features(self) -> list[Feature]:
        """What the plugin extracts from the expected objects in all frames whose pose is known, but for what is
        absent."""
        series, strip = strips_of(self.walked.request.name), None
        features: list[Feature] = []
        for packed_view in self.walked.packed_views[self.plugin.name]:
            if packed_view.frame not in self.poses:
                continue
            if strip is None or strip.frame != packed_view.frame:
                strip = self.walked.journal.get(PanoramaStrip, series, packed_view.frame)
                panorama = strip.panorama() if strip is not None else None
            if strip is not None and panorama is not None:
                seen = strip.segmentation(self.plugin.name, packed_view.view, self.plugin.classes)
                found = self._in_view(packed_view, seen, panorama)
                features += [replace(feature, expected=True) for feature in found]
        return features

    def _in_view(self, packed_view: PackedView, segmentation: Segmentation, panorama: Panorama) -> list[Feature]:
        spec = self.walked.measurements.facts.views[packed_view.view]
        view = View(spec, panorama.frame, panorama.stamp_s, packed_view.image())
        outlines = self._outlines(view, segmentation)
        there = [(thing, outline) for thing, outline in outlines if not thing.absent]
        detections = expected_detections(view, segmentation, there, self.settings)
        return _of_objects(self.plugin.extract_features(view, detections, panorama), outlines)

    def _outlines(self, view: View, segmentation: Segmentation) -> list[Outlined]:
        """The expected objects that a view shows, absent ones too, with their outlines where the network sees them."""
        outlines = outlines_in(view.spec, self.poses[view.frame], self.expected.objects)
        drift = drift_of(segmentation, [(thing, outline) for thing, outline in outlines if not thing.absent])
        return [(thing, outline + drift) for thing, outline in outlines]


def _of_objects(features: Sequence[Feature], outlines: Sequence[Outlined]) -> list[Feature]:
    """The features of those instances of a view that do not lie at an absent object's outline, farther inside of it than of any other's."""
    if not any(thing.absent for thing, _ in outlines):
        return [*features]
    exact = [(thing, outline.astype(np.float32)) for thing, outline in outlines]
    pixels: dict[tuple[str, int], list[Floats]] = {}
    for feature in features:
        pixels.setdefault((feature.label, feature.instance), []).append(feature.pixels)
    absent = {key for key, own in pixels.items() if _is_absent(key[0], np.concatenate(own).mean(axis=0), exact)}
    return [feature for feature in features if (feature.label, feature.instance) not in absent]


def _is_absent(label: str, place: Floats, outlines: Sequence[tuple[Expected, NDArray[np.float32]]]) -> bool:
    """Whether a place (2,) px is nearer to an absent object of a class, to a pixel, than to all that are there."""
    inside = {True: -np.inf, False: -np.inf}
    for thing, outline in outlines:
        if thing.label == label:
            depth = cv2.pointPolygonTest(outline, (float(place[0]), float(place[1])), True)
            inside[thing.absent] = max(inside[thing.absent], depth)
    return inside[True] > max(inside[False], -1.0)
