"""Frames that see too little do not say where the camera was: they are left out, for they would spoil the whole."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.graph import Constraints, KeySpace, camera_priors, image_measurements, merge
from savmap.types import Track

from . import made_up_wall as made

LAST = made.FRAMES - 1


def used(points: int, along_px: float) -> list[int]:
    """The frames that are used where the last one sees so many points, each as sure as so many pixels along a line."""
    tracks = [
        thinned(made.track(f"post {number}", point, "post"), number < points) for number, point in enumerate(made.WALL)
    ]
    spread = np.diag([0.01, along_px**2])
    tracks = [replace(track, covariances=np.tile(spread, (len(track.frames), 1, 1))) for track in tracks]
    keys = KeySpace("wall").keys(track.name for track in tracks)
    first = {track.name: point for track, point in zip(tracks, made.WALL, strict=True)}
    part = Constraints("wall", keys, image_measurements(tracks, keys, made.FACTS.views), (), first)
    return merge(camera_priors(made.FACTS, made.path()), part).used.tolist()


def thinned(track: Track, seen: bool) -> Track:
    """A track that is seen in the last frame, or not."""
    kept = track.frames < LAST
    rows = [*np.flatnonzero(kept), *([0] if seen else [])]
    frames = np.append(track.frames[kept], [LAST] * seen)
    return replace(
        track,
        frames=frames.astype(np.int64),
        views=track.views[:1] * len(rows),
        pixels=track.pixels[rows],
        covariances=track.covariances[rows],
    )


@pytest.mark.parametrize(
    ("points", "along_px", "is_used"), [(3, 0.1, True), (2, 0.1, False), (6, 200.0, True), (5, 200.0, False)]
)
def test_a_pose_needs_six_equations(points: int, along_px: float, is_used: bool) -> None:
    """A point gives two, a point anywhere on a line one."""
    assert (LAST in used(points, along_px)) == is_used
