"""Lamps in the factor graph: their points, and, where it is so, one height and one line along the aisle."""

from collections.abc import Sequence

import numpy as np

from savmap.geometry.triangulate import nearest_point
from savmap.graph import Constraints, KeySpace, observe, tie
from savmap.types import Floats, RowFacts, Track, Trajectory


def constrain(tracks: Sequence[Track], facts: RowFacts, start: Trajectory, room: str, line: bool) -> Constraints:
    """Projection factors of all lamps; with `line`, all points share y and z. Paper, last paragraph of section III.E."""
    keys = KeySpace(room).keys([track.name for track in tracks])
    ordered = [keys[track.name] for track in tracks]
    relations = [tie(axis, ordered[0], other) for other in ordered[1:] for axis in ("y", "z")] if line else []
    return Constraints(
        room=room,
        keys=keys,
        observations=observe(tracks, keys, facts.views),
        relations=tuple(relations),
        initial={track.name: first_position(track, facts, start) for track in tracks},
    )


def first_position(track: Track, facts: RowFacts, start: Trajectory) -> Floats:
    """The point (3,) nearest to the rays of a track from the camera's first path."""
    world_from_rig = dict(zip(start.frames.tolist(), start.world_from_rig, strict=True))
    seen = [
        (world_from_rig[frame], facts.views[view].rig_rays(pixel))
        for frame, view, pixel in zip(track.frames.tolist(), track.views, track.pixels, strict=True)
        if frame in world_from_rig
    ]
    origins = np.array([pose[:3, 3] for pose, _ in seen])
    rays = np.array([pose[:3, :3] @ ray for pose, ray in seen])
    return nearest_point(origins, rays)
