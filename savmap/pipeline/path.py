"""Where the camera is taken to be before anything is solved, and where it was by what a plugin alone tracked."""

import logging
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from savmap import graph
from savmap.errors import PluginFailedError, SiteError, SolveError, StructureError
from savmap.graph import CameraPriors, References, camera_priors, published_start
from savmap.pipeline.records import RowMeasurements, RowRequest, WalkedRow
from savmap.plugin.manager import LoadedPlugin
from savmap.types import Feature, Floats, PlanePatch, Trajectory
from savmap.vision.attitude import attitudes
from savmap.vision.evidence import FloorHeight, floor_before

SPEED_MPS = 1.0
UPRIGHT = 0.99
HEIGHT_M = 2.5
DISTANCE_M = 1.5


def first_poses(row: RowRequest, measurements: RowMeasurements) -> tuple[Trajectory, CameraPriors]:
    """The first poses of a row's frames, and the frames as the graph takes them. Raises StructureError."""
    start = initial_path(row, measurements)
    priors = camera_priors(measurements.facts, start, row.gauge_references, fixed=row.path, calibration=row.calibration)
    return start, priors


def initial_path(row: RowRequest, measurements: RowMeasurements) -> Trajectory:
    """First poses: the earlier map's, or attitudes from the pictures with positions as published (paper, "Constrained
    SfM"): constant speed along x over the approximate travel, at the camera's height, before the face."""
    if row.path is not None:
        return checked_path(row.name, row.path, len(measurements.facts.frames))
    stamps = measurements.facts.frames.stamps_s
    return published_start(
        measurements.facts,
        attitudes_of(measurements),
        length_m=row.travel_m or SPEED_MPS * float(np.ptp(stamps)),
        height_m=row.references.camera_heights[0].value_m if row.references.camera_heights else HEIGHT_M,
        distance_m=DISTANCE_M,
    )


def checked_path(row: str, path: Trajectory, count: int) -> Trajectory:
    """An earlier map's path, if it is one of the same frames."""
    if len(path.frames) != count:
        raise StructureError(
            f"row {row}: the earlier map has poses for {len(path.frames)} frames, these passes have {count}: "
            "map the same passes at the same rate, all frames of which were located"
        )
    return path


def attitudes_of(measurements: RowMeasurements) -> Floats:
    """world_from_rig (n, 3, 3) of every frame, from edges of known direction in the pictures."""
    missing = sorted(set(measurements.facts.frames.passes) - set(measurements.attitudes))
    if missing:
        raise StructureError(
            f"row {measurements.facts.name}, {missing[0]}: the face's direction was not found, and no plugin gives it"
        )
    first = np.stack([measurements.attitudes[name] for name in measurements.facts.frames.passes])
    edges = [feature for features in measurements.features.values() for feature in features if feature.axis is not None]
    return attitudes(edges, measurements.facts.views, first)


class PluginAlone:
    """A plugin and where the camera was by what it alone tracked, worked out once for the same features.
    `floor_share`: how high the camera is over the floor, as a share of its distance from the plugin's upright plane,
    where the pictures told."""

    def __init__(self, row: RowRequest, plugin: LoadedPlugin) -> None:
        self.row, self.plugin = row, plugin
        self.floor_share: float | None = None
        self._features: Sequence[Feature] | None = None
        self._located: graph.LocatedCamera | None = None
        self._without_floor: graph.LocatedCamera | None = None

    def located(self, measurements: RowMeasurements) -> graph.LocatedCamera | None:
        """The camera's path and the landmarks; None where the plugin cannot be tracked at all.

        The scale of the path may be an assumed one: no reference is used, for other references are no reason to look
        again.
        """
        features = measurements.features[self.plugin.name]
        if features is not self._features:
            self._features, self._located = features, self._locate(features, measurements)
        return self._located

    def floor(self, walked: WalkedRow, located: graph.LocatedCamera) -> tuple[PlanePatch, FloorHeight] | None:
        """The first upright plane of the plugin's, and the floor before it, where the pictures tell."""
        points = located.points[self.plugin.name]
        face = next((plane for plane in self.plugin.planes(points) if plane.up[1] > UPRIGHT), None)
        if face is None or located is self._without_floor:
            return None
        places = np.array([*points.values()])
        height = floor_before(face, places, walked.floor, walked.floor_views, located.path, self.floor_share)
        if height is None:
            self._without_floor = located
            return None
        self.floor_share = height.share
        return face, height

    def _locate(self, features: Sequence[Feature], measurements: RowMeasurements) -> graph.LocatedCamera | None:
        plugin, path = self.plugin.before_pixels(), self.row.path
        bare = replace(self.row, references=References(), travel_m=None, calibration=None)
        try:
            start, frames = first_poses(bare, measurements)
            with warnings_held_back():
                tracks = plugin.track(features, measurements.facts, start.world_from_rig[:, :3, :3], path)
                constraints = plugin.constrain(tracks, measurements.facts, path or start)
            return graph.locate_camera(graph.merge(frames, constraints, partial=True))
        except (StructureError, SolveError, SiteError, PluginFailedError):
            return None


@contextmanager
def warnings_held_back() -> Iterator[None]:
    """While this lasts, what plugins and libraries warn of in this thread is not told: what is used in the end is
    tracked once more, and that is told."""
    here = threading.get_ident()

    def is_heard(record: logging.LogRecord) -> bool:
        return record.thread != here or record.levelno > logging.WARNING

    handlers = tuple(logging.getLogger().handlers)
    for handler in handlers:
        handler.addFilter(is_heard)
    try:
        yield
    finally:
        for handler in handlers:
            handler.removeFilter(is_heard)
