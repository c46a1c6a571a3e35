"""Where the camera is taken to be before anything is solved, and where it was by what was measured of one plugin."""

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from savmap import graph
from savmap.errors import StructureError
from savmap.geometry.poses import middle_rotation, usual_rotation
from savmap.graph import CameraPriors, References, camera_priors, published_start
from savmap.pipeline.records import RowMeasurements, RowRequest
from savmap.plugin.manager import LoadedPlugin
from savmap.types import Floats, FrameTable, Trajectory
from savmap.vision.attitude import attitudes

SPEED_MPS = 1.0
HEIGHT_M = 2.5
DISTANCE_M = 1.5
NEXT, LEAST_PLACED = 3, 3


def first_poses(row: RowRequest, measurements: RowMeasurements) -> tuple[Trajectory, CameraPriors]:
    """The first poses of a row's frames, and the frames as the graph takes them. Raises StructureError."""
    start = initial_path(row, measurements)
    walked = measurements.walked if row.sees_in_part and row.path is None else None
    priors = camera_priors(
        measurements.facts, start, row.gauge_references, fixed=row.path, calibration=row.calibration, walked=walked
    )
    return start, priors


def initial_path(row: RowRequest, measurements: RowMeasurements) -> Trajectory:
    """First poses: the earlier map's, or attitudes from the pictures and the drive's places, scaled to the approximate
    travel, at the camera's height, before the face; of frames that have no place there, as published (paper,
    "Constrained SfM"): at constant speed along x."""
    if row.path is not None:
        return checked_path(row.name, row.path, len(measurements.facts.frames))
    stamps = measurements.facts.frames.stamps_s
    length_m = row.travel_m or SPEED_MPS * float(np.ptp(stamps))
    height_m = row.references.camera_heights[0].value_m if row.references.camera_heights else HEIGHT_M
    start = published_start(measurements.facts, attitudes_along(row, measurements), length_m, height_m, DISTANCE_M)
    return start if measurements.walked is None else _as_walked(start, measurements.walked, measurements.facts.frames)


def _as_walked(start: Trajectory, walked: Trajectory, frames: FrameTable) -> Trajectory:
    """First poses with the places of the frames that have one in the drive, each pass as long as at first."""
    poses = start.world_from_rig.copy()
    for row_pass in dict.fromkeys(frames.passes):
        of_pass = frames.of_pass(row_pass)
        here = np.isin(walked.frames, of_pass)
        numbers, placed = walked.frames[here], walked.world_from_rig[here]
        if len(numbers) < LEAST_PLACED:
            continue
        turn = middle_rotation(poses[numbers, :3, :3] @ placed[:, :3, :3].transpose(0, 2, 1))
        places = placed[:, :3, 3] @ turn.T
        if (travelled := float(np.ptp(places[:, 0]))) > 0:
            places *= float(np.ptp(poses[numbers, 0, 3])) / travelled
        begin = np.array([places[:, 0].min(), *np.median(places[:, 1:], axis=0)])
        poses[numbers, :3, 3] = (
            places - begin + [poses[numbers, 0, 3].min(), *np.median(poses[numbers, 1:3, 3], axis=0)]
        )
    return replace(start, world_from_rig=poses)


def checked_path(row: str, path: Trajectory, count: int) -> Trajectory:
    """An earlier map's path, if it is one of the same frames."""
    if len(path.frames) != count:
        raise StructureError(
            f"row {row}: the earlier map has poses for {len(path.frames)} frames, these passes have {count}: "
            "map the same passes at the same rate, all frames of which were located"
        )
    return path


def attitudes_along(row: RowRequest, measurements: RowMeasurements) -> Floats:
    """world_from_rig (n, 3, 3) of every frame, from edges of known direction in the pictures; those of a camera that
    sees in part, of which many frames show few edges, turn as the drive's path does, where that does not know how they
    are turned."""
    seen, walked = attitudes_of(measurements), measurements.walked
    if walked is None or not row.sees_in_part:
        return seen
    for name in dict.fromkeys(measurements.facts.frames.passes):
        here = np.isin(walked.frames, measurements.facts.frames.of_pass(name))
        numbers, turns = walked.frames[here], walked.world_from_rig[here, :3, :3]
        if name in measurements.levelled:
            seen[numbers] = turns
        elif len(numbers):
            seen[numbers] = usual_rotation(seen[numbers] @ turns.transpose(0, 2, 1)) @ turns
    return seen


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


def located_by(
    plugin: LoadedPlugin, row: RowRequest, measurements: RowMeasurements, path: Trajectory
) -> graph.LocatedCamera:
    """The camera's path and the landmarks by what was measured of one plugin. The scale of the path may be an assumed
    one: no reference is used, for what is measured does not depend on them. Raises StructureError, SolveError,
    SiteError."""
    plugin = plugin.before_pixels()
    bare = replace(row, references=References(), travel_m=None, calibration=None)
    start, frames = first_poses(bare, measurements)
    with warnings_held_back():
        attitudes = start.world_from_rig[:, :3, :3]
        tracks = plugin.track(measurements.features[plugin.name], measurements.facts, attitudes, path)
        constraints = plugin.constrain(tracks, measurements.facts, row.path or start)
    return graph.locate_camera(graph.merge(frames, constraints, partial=True))


def completed(row: RowRequest, frames: FrameTable) -> RowRequest:
    """A row whose earlier path, if it has one, has the poses of frames next to those that were located, too."""
    return row if row.path is None else replace(row, path=continued(row.path, frames))


def continued(path: Trajectory, frames: FrameTable) -> Trajectory:
    """A path with poses of frames that it lacks, on the line and the turn through the two nearest of their pass,
    where the nearest is at most `NEXT` frames away."""
    missing = set(range(len(frames))) - set(path.frames.tolist())
    if not missing:
        return path
    numbers, poses = path.frames.tolist(), dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    for frame in missing:
        near = [number for number in numbers if frames.passes[number] == frames.passes[frame]]
        near.sort(key=lambda number: abs(number - frame))
        if len(near) > 1 and abs(near[0] - frame) <= NEXT:
            first, second = (poses[number] for number in near[:2])
            times = frames.stamps_s[[near[0], near[1], frame]]
            share = float((times[2] - times[0]) / (times[1] - times[0]))
            turn = Rotation.from_matrix(second[:3, :3] @ first[:3, :3].T).as_rotvec()
            pose = first + share * (second - first)
            pose[:3, :3] = Rotation.from_rotvec(share * turn).as_matrix() @ first[:3, :3]
            poses[frame] = pose
    return Trajectory(np.array(sorted(poses), np.int64), np.stack([poses[frame] for frame in sorted(poses)]))


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
