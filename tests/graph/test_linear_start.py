"""The linear start where a frame sees something else: it is set by the other frames."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.graph import Constraints, KeySpace, camera_priors, fixed_coordinate, image_measurements, merge
from savmap.graph.initial.linear import linear_positions
from savmap.graph.problem import Problem, first_poses

from . import made_up_wall as made

MIDDLE = np.array([made.SPEC.width, made.SPEC.height]) / 2
LENGTH_M = float(np.ptp(made.WALL[:, 0]))


def problem(astray: int, shrunk: float) -> Problem:
    """The wall, its points `shrunk` towards the picture's middle in the last `astray` frames, with 3 px of noise in all."""
    rng, tracks = np.random.default_rng(0), []
    for number, point in enumerate(made.WALL):
        track = made.track(f"post {number}", point, "post")
        pixels = track.pixels + rng.normal(0, 3, track.pixels.shape)
        last = track.frames >= made.FRAMES - astray
        pixels[last] = MIDDLE + shrunk * (pixels[last] - MIDDLE)
        tracks.append(replace(track, pixels=pixels))
    keys = KeySpace("wall").keys(track.name for track in tracks)
    known = (fixed_coordinate("x", keys["post 0"]), *(fixed_coordinate("z", key) for key in keys.values()))
    first = {track.name: point for track, point in zip(tracks, made.WALL, strict=True)}
    part = Constraints("wall", keys, image_measurements(tracks, keys, made.FACTS.views), known, first)
    return merge(camera_priors(made.FACTS, made.path()), part)


@pytest.mark.parametrize(("astray", "shrunk"), [(0, 1.0), (1, 0.1), (1, 0.0), (2, 0.03)])
def test_frames_that_fly_off_shrink_nothing(astray: int, shrunk: float) -> None:
    """What looks small in a frame is taken for far away: all others shrank to a point for it, and the row had no scale."""
    wall = problem(astray, shrunk)
    cameras, points = linear_positions(wall, first_poses(wall), made.WALL)
    assert np.ptp(points[:, 0]) == pytest.approx(LENGTH_M, rel=0.1)
    assert cameras[: made.FRAMES - astray, 2] == pytest.approx(2.5, rel=0.1)
