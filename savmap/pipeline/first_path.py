"""The camera's first path before a face, up to scale: the drive's own, laid before the face.

The drive is known up to a similarity. Straight segments that frames show near the directions of the row's axes tell how
its frame is turned: all together, for the path knows how each frame is. How far the face is from it, and to a degree
which way it runs, is where the evidence of all frames is sharpest on the face's plane: at any other distance parallax
smears it.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from savmap.errors import StructureError
from savmap.geometry.poses import middle_rotation
from savmap.geometry.vanishing import orientation_from_edges
from savmap.pipeline.path import attitudes_along
from savmap.pipeline.records import WalkedRow
from savmap.plugin.manager import LoadedPlugin
from savmap.types import Floats, Ints, Trajectory, ViewSpec
from savmap.vision.evidence import PackedView, sharpness, upright_patch
from savmap.vision.networks.segmenter import Probabilities
from savmap.vision.view_planning import segments_in

LEAST_TRAVEL, LEAST_FRAMES = 0.2, 3
"""Along the face, in distances from it."""
MOST_FRAMES, FEWER = 24, 12
"""That tell the distance, and roughly: neighbours, for what single frames show is sharp at any distance."""
RATIOS = np.geomspace(0.3, 2.2, 52)
"""Distances that are tried, as shares of that of the points before the face."""
SIMPLEX, LEAST_GAIN = np.array([[0.02, 0.5], [-0.03, 0.5], [0.0, -1.0]]), 3e-4
"""From the best of these: a share of the distance, and a turn in degrees; how much sharper better ones are."""
MOST_SEGMENTED, LEAST_SEGMENTS, REACHES, SEGMENT_SIGMA = 16, 20, (5.0, 1.5), 0.2
"""Views whose segments tell how the row's frame is turned, how many of these are needed, how far from an axis they may
be, at first and then, and their standard deviation, degrees."""
CELL = 0.025
"""The side of a cell, as a share of the distance."""
Way = tuple[float, float]
"""A distance from the face, and a turn about the vertical, degrees."""


def paths_before_face(row: WalkedRow, plugin: LoadedPlugin) -> list[Trajectory]:
    """The path of each pass before the face z = 0 that a plugin sees, in the unit of the camera's distance from it, its
    places on the face each in a frame of its own. Raises StructureError where a pass has no path, or hardly moves, or
    the attitudes are not known."""
    name, frames, walked = row.request.name, row.measurements.facts.frames, row.measurements.walked
    attitudes = attitudes_along(row.request, row.measurements)
    level = row.measurements.levelled
    paths = list[Trajectory]()
    for row_pass in dict.fromkeys(frames.passes):
        here = np.isin(walked.frames, frames.of_pass(row_pass)) if walked is not None else np.zeros(0, np.bool_)
        looked_at = [item.frame for item in row.packed_views[plugin.name]]
        if walked is None or np.isin(walked.frames[here], looked_at).sum() < LEAST_FRAMES:
            raise StructureError(
                f"row {name}, {row_pass}: the camera's path is not known: it hardly moves, or too few points could be "
                f"followed from frame to frame; film more slowly, where it is brighter, or give more frames a second"
            )
        path = Trajectory(walked.frames[here], walked.world_from_rig[here])
        turn = middle_rotation(attitudes[path.frames] @ path.world_from_rig[:, :3, :3].transpose(0, 2, 1))
        turn = turn if row_pass in level else _levelled(row, plugin, path, turn)
        paths.append(_before_face(row, plugin, path, Rotation.from_matrix(turn)))
        travelled = float(np.ptp(paths[-1].world_from_rig[:, 0, 3]) / np.median(paths[-1].world_from_rig[:, 2, 3]))
        if travelled < LEAST_TRAVEL:
            raise StructureError(
                f"row {name}, {row_pass}: too little motion: the camera moved {travelled:.2f} of its distance from the "
                f"face ({LEAST_TRAVEL} are needed)"
            )
    return paths


def _levelled(row: WalkedRow, plugin: LoadedPlugin, path: Trajectory, turn: Floats) -> Floats:
    """The turn (3, 3) of a path by straight segments that some frames show; `turn`: to some degrees."""
    poses = dict(zip(path.frames.tolist(), path.world_from_rig[:, :3, :3], strict=True))
    packed = [item for item in row.packed_views[plugin.name] if item.frame in poses]
    chosen = np.unique(np.linspace(0, len(packed) - 1, MOST_SEGMENTED).astype(int)).tolist() if packed else []
    ends = [_segments(packed[k], row.measurements.facts.views[packed[k].view], poses) for k in chosen]
    rays = np.concatenate([np.zeros((0, 2, 3)), *ends])
    for reach in REACHES:
        normals = np.cross(rays[:, 0], rays[:, 1]) @ turn.T
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        near = np.abs(normals) < np.sin(np.radians(reach))
        kept = near[:, :2].sum(axis=1) == 1
        if kept.sum() < LEAST_SEGMENTS:
            return turn
        axes, sigmas = near[kept].argmax(axis=1), np.full(int(kept.sum()), np.radians(SEGMENT_SIGMA))
        turn = orientation_from_edges(rays[kept, 0], rays[kept, 1], axes, sigmas, turn).world_from_rig
    return turn


def _segments(packed: PackedView, spec: ViewSpec, poses: Mapping[int, Floats]) -> Floats:
    """Unit rays (n, 2, 3), in the path's frame, of the ends of a view's straight segments."""
    pixels = segments_in(packed.grey())
    return np.asarray(spec.rig_rays(pixels) @ poses[packed.frame].T)


def _before_face(row: WalkedRow, plugin: LoadedPlugin, path: Trajectory, turn: Rotation) -> Trajectory:
    """A path that is turned so, at the distance at which the evidence is sharpest."""
    facts, packed = row.measurements.facts, row.packed_views[plugin.name]
    looked_at = np.flatnonzero(np.isin(path.frames, [item.frame for item in packed]))
    few = _middle(looked_at, MOST_FRAMES)
    some = Trajectory(path.frames[few], path.world_from_rig[few])
    maps = {(item.frame, item.view): item.probabilities() for item in packed if item.frame in some.frames}
    fewer = {key: shown for key, shown in maps.items() if key[0] in _middle(some.frames, FEWER)}

    def laid(walked: Trajectory, way: Way) -> Trajectory:
        return _moved(walked, Rotation.from_euler("y", way[1], degrees=True) * turn, way[0])

    def sharp(way: Way, shown: Mapping[tuple[int, str], Probabilities]) -> float:
        moved = laid(some, way)
        return sharpness(upright_patch(moved, facts, CELL), shown, facts.views, moved)

    distance = max(RATIOS.tolist(), key=lambda ratio: sharp((ratio, 0.0), fewer))

    def smeared(moved: Floats) -> float:
        return -sharp((distance * (1 + moved[0]), moved[1]), maps)

    options: Any = {"initial_simplex": SIMPLEX, "xatol": np.inf, "fatol": LEAST_GAIN}
    nearer, turned = minimize(smeared, np.zeros(2), method="Nelder-Mead", options=options).x
    return laid(path, (distance * (1 + nearer), turned))


def _middle(frames: Ints, most: int) -> Ints:
    """At most so many of the frames (n,), amid the others."""
    first = max(len(frames) - most, 0) // 2
    return frames[first : first + most]


def _moved(path: Trajectory, turn: Rotation, distance: float) -> Trajectory:
    """A path that is turned, so far before z = 0 in its middle."""
    poses = path.world_from_rig.copy()
    poses[:, :3, :3] = turn.as_matrix() @ poses[:, :3, :3]
    places: Floats = turn.apply(poses[:, :3, 3])
    poses[:, :3, 3] = places - [0.0, 0.0, float(np.median(places[:, 2])) - distance]
    return replace(path, world_from_rig=poses)
