"""From where and in which direction a track was seen, for where its landmark is at first."""

import numpy as np

from savmap.types import Floats, RowFacts, Track, Trajectory


def sight_lines(track: Track, facts: RowFacts, start: Trajectory) -> tuple[Floats, Floats]:
    """Origins (n, 3) m and unit rays (n, 3) in the row's frame, from the camera's first path, of a track of points; frames whose
    camera is not known are left out. `savmap.geometry.triangulate` has the points nearest to them."""
    poses = dict(zip(start.frames.tolist(), start.world_from_rig, strict=True))
    seen = [
        (poses[frame], facts.views[view].rig_rays(pixel))
        for frame, view, pixel in zip(track.frames.tolist(), track.views, track.pixels, strict=True)
        if frame in poses
    ]
    return np.array([pose[:3, 3] for pose, _ in seen]), np.array([pose[:3, :3] @ ray for pose, ray in seen])
