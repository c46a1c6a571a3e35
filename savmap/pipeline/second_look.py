"""The second look: what all frames show together, on the planes that structures lie in, may differ from what single frames showed.

Once the camera's path is roughly known, the network's probabilities of all frames are added up on these planes
(savmap.vision.evidence). Where a plugin finds other objects in them than were tracked, every frame is measured again with these in
mind: faint ones are followed that no threshold finds, and what only looks like one in a few frames is passed over. The frames'
pictures tell where the floor is before each look, and in the end how deep flat parts lie, where a plugin asks for that.
"""

from collections.abc import Iterator
from dataclasses import replace

from savmap.pipeline.path import PluginAlone
from savmap.pipeline.records import MeasuredRow, RowMeasurements, WalkedRow, strips_of
from savmap.plugin.manager import LoadedPlugin
from savmap.types import Feature, FlatDepth, MapWarning, Panorama, View
from savmap.types.progress import Monitor
from savmap.vision.evidence import (
    FloorTracks,
    PackedView,
    depth_of,
    drift_of,
    expected_detections,
    features_of,
    floor_tracks,
    gather,
    outlines_in,
)
from savmap.vision.evidence.expectation import Expectation, unexplained
from savmap.vision.networks.segmenter import Segmentation
from savmap.vision.strips import PanoramaStrip

LOOKS = 2


def look_again(measured: WalkedRow, monitor: Monitor) -> MeasuredRow:
    """What was measured, with the features of each plugin anew whose evidence shows other objects than were tracked. What is still not
    tracked after the last look is warned of."""
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


def best_measurements(
    alone: PluginAlone, measured: WalkedRow, measurements: RowMeasurements, monitor: Monitor
) -> RowMeasurements:
    """The measurements, of the first ones and those of up to `LOOKS` looks, after which the fewest of a plugin's expected objects are amiss.

    A look may lose what an earlier one had; one that loses an end of what was tracked is not used, and is the last. Each object that is still amiss is
    warned of.
    """
    row, plugin, warnings = alone.row.name, alone.plugin, list[MapWarning]()
    states = [(measurements, expect(alone, measured, measurements))]
    while len(states) <= LOOKS and (expectation := states[-1][1]) is not None:
        monitor.note(f"row {row}: `{plugin.name}` looks again for {len(expectation.there)} objects")
        features = SecondLook(plugin, expectation, measured).features()
        anew = replace(measurements, features={**measurements.features, plugin.name: features})
        located = alone.located(anew)
        if located is None:
            details = ("what all frames show could not be tracked; what single frames show is mapped",)
            warnings = [MapWarning("incomplete-map", (plugin.name,), details=details)]
            break
        if expectation.reaches_beyond(located.points[plugin.name]):
            break
        states.append((anew, expect(alone, measured, anew)))
    best, left = min(reversed(states), key=lambda state: state[1].amiss if state[1] is not None else 0)
    if left is not None and not warnings:
        warnings = [*unexplained(left, measured.packed_views[plugin.name], measurements.facts.views), *left.unseen()]
    return replace(best, warnings=(*best.warnings, *warnings)) if warnings else best


def expect(alone: PluginAlone, measured: WalkedRow, measurements: RowMeasurements) -> Expectation | None:
    """What a plugin expects by the evidence; None where that is what it tracked, or where it cannot be tracked at all."""
    located, plugin = alone.located(measurements), alone.plugin
    if located is None:
        return None
    points, packed_views = located.points[plugin.name], measured.packed_views[plugin.name]
    planes = plugin.planes(points)
    evidence = [gather(patch, plugin.classes, packed_views, measurements.facts.views, located.path) for patch in planes]
    if not evidence:
        return None
    floor = alone.floor(measured, located)
    objects = plugin.expect(points, evidence, floor[1].y if floor else None)
    return Expectation(objects, located.path, points, planes) if objects else None


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


def floor_of(alone: PluginAlone, measured: WalkedRow, measurements: RowMeasurements) -> FloorTracks:
    """Points of the floor before the plugin's first upright plane, where the pictures tell."""
    located = alone.located(measurements)
    if located is None:
        return FloorTracks()
    floor = alone.floor(measured, located)
    if floor is None:
        return FloorTracks()
    return floor_tracks(floor[0], measured.floor, measured.floor_views, located.path, floor[1])


class SecondLook:
    """Measures what is expected in single frames, in the strips that the drive kept of them."""

    def __init__(self, plugin: LoadedPlugin, expectation: Expectation, walked: WalkedRow) -> None:
        self.plugin, self.expected, self.walked = plugin, expectation, walked
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
        outlines = outlines_in(spec, self.poses[view.frame], self.expected.objects)
        drift = drift_of(segmentation, [(thing, outline) for thing, outline in outlines if not thing.absent])
        outlines = [(thing, outline + drift) for thing, outline in outlines]
        there = [(thing, outline) for thing, outline in outlines if not thing.absent]
        detections = expected_detections(view, segmentation, there)
        return features_of(self.plugin.extract_features(view, detections, panorama), outlines)
