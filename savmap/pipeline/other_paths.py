"""The path of a drive for a row that cannot be located by itself, from another row that is seen in the same frames.

The camera went along both faces at once. A pose before one face is that before the other, moved by one rigid transform.
Both faces are upright, and parallel to about a degree; the attitudes of both rows' frames tell whether they face each
other. How far the camera is from the face is unknown: it is where the evidence of all frames is sharpest on the face's
plane, for at any other distance parallax smears it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.errors import SavmapError, StructureError
from savmap.pipeline.finding import find_structures
from savmap.pipeline.path import first_poses
from savmap.pipeline.records import MeasuredRow, WalkedRow
from savmap.types import Floats, Trajectory
from savmap.types.progress import Monitor
from savmap.vision.evidence import gather, upright_patch

LEAST_SHARED, MOST_FRAMES = 8, 24
"""Frames that two rows must have in common, and how many of them tell the distance."""
RATIOS, FINE = np.geomspace(0.3, 3.0, 58), np.geomspace(0.97, 1.03, 7)
"""Distances that are tried, as shares of that from the other face, and then of the best of these."""
TURNS_DEG = np.linspace(-1.0, 1.0, 9)
CELL = 0.025
"""The side of a cell, as a share of the distance."""


def with_paths_of_others(
    walked: Sequence[WalkedRow | SavmapError], measured: Sequence[MeasuredRow | SavmapError], monitor: Monitor
) -> list[MeasuredRow | SavmapError]:
    """Measured rows; those whose pictures did not tell where the camera was are measured along the path of a row that
    was seen in the same frames, where there is one."""
    results = list(measured)
    for number, (row, result) in enumerate(zip(walked, measured, strict=True)):
        if isinstance(row, WalkedRow) and isinstance(result, StructureError) and row.request.path is None:
            for other in (item for item in measured if isinstance(item, MeasuredRow)):
                try:
                    start = path_beside(row, other)
                    if start is not None:
                        results[number] = find_structures(row, monitor, start)
                        monitor.note(
                            f"row {row.request.name}: its face does not tell the camera's path; "
                            f"that of row {other.request.name} is used"
                        )
                        break
                except StructureError:
                    continue
    return results


def path_beside(row: WalkedRow, other: MeasuredRow) -> Trajectory | None:
    """The path of another row's frames before the face of this one, up to scale; None where they share too few frames,
    or no plugin that locates the camera has a plane to look at. Raises StructureError where the attitudes of the row's
    frames are not known."""
    path, locators = other.measurements.path, row.measurements.locators
    if path is None or not locators & row.packed_views.keys():
        return None
    number = {moment: frame for frame, moment in enumerate(row.moments)}
    shared = [(k, number[other.moments[f]]) for k, f in enumerate(path.frames.tolist()) if other.moments[f] in number]
    if len(shared) < LEAST_SHARED:
        return None
    poses = path.world_from_rig[[k for k, _ in shared]]
    start, _ = first_poses(row.request, row.measurements)
    attitudes = start.world_from_rig[[frame for _, frame in shared], :3, :3]
    ahead = np.einsum("nij,nkj->ik", attitudes, poses[:, :3, :3])
    turn = Rotation.from_euler("y", 0.0 if ahead[0, 0] > 0 else np.pi)
    along = Trajectory(np.array([frame for _, frame in shared], np.int64), poses)
    unit = float(np.median(poses[:, 2, 3]))
    distance = max((unit * RATIOS).tolist(), key=lambda distance: _sharpness(row, _moved(along, turn, distance)))
    tried = [
        (distance * factor, Rotation.from_euler("y", angle, degrees=True) * turn)
        for factor in FINE.tolist()
        for angle in TURNS_DEG.tolist()
    ]
    best = max(tried, key=lambda way: _sharpness(row, _moved(along, way[1], way[0])))
    return _moved(along, best[1], best[0])


def _moved(path: Trajectory, turn: Rotation, distance: float) -> Trajectory:
    """A path that is turned, so far before z = 0 in its middle."""
    poses = path.world_from_rig.copy()
    poses[:, :3, :3] = turn.as_matrix() @ poses[:, :3, :3]
    places: Floats = turn.apply(poses[:, :3, 3])
    poses[:, :3, 3] = places - [0.0, 0.0, float(np.median(places[:, 2])) - distance]
    return replace(path, world_from_rig=poses)


def _sharpness(row: WalkedRow, path: Trajectory) -> float:
    """How sharp the evidence of a few frames is on the plane z = 0: the mean of the scores, weighted by themselves."""
    few = np.unique(np.linspace(0, len(path.frames) - 1, MOST_FRAMES).astype(int))
    path = Trajectory(path.frames[few], path.world_from_rig[few])
    facts, locators = row.measurements.facts, row.measurements.locators
    locator = next(plugin for plugin in row.plugins if plugin.name in locators and plugin.name in row.packed_views)
    patch = upright_patch(path, facts, CELL)
    evidence = gather(patch, locator.classes, row.packed_views[locator.name], facts.views, path)
    return float(np.square(evidence.mean).sum() / max(float(evidence.mean.sum()), 1e-9))
