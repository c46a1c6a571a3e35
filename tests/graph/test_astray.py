"""Frames that are solved far from those beside them are left out, and only these."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.geometry.pinhole import project
from savmap.graph import Constraints, KnownLength, Problem, camera_priors, merge, solve
from savmap.graph.solver.optimise import frames_astray, without_frames
from savmap.types import Floats, Ints, Track

from . import made_up_wall as made

LENGTH = KnownLength("post 0", "post 12", 4.0, 0.002, axis="x")


def seen_from(track: Track, point: Floats, places: dict[int, Floats]) -> Track:
    """The track as it would be if some frames had been taken elsewhere (3,) m."""
    pixels = track.pixels.copy()
    for row, frame in enumerate(track.frames.tolist()):
        if frame in places:
            pixels[row] = project((point - places[frame])[None] @ made.LEVEL, made.SPEC.camera)[0]
    return replace(track, pixels=pixels)


def problem(places: dict[int, Floats] | None = None) -> Problem:
    """The wall's, some frames of which show it as from elsewhere."""
    wall = made.Wall(made.Config())
    tracks = [seen_from(track, point, places or {}) for track, point in zip(wall.tracks(), made.WALL, strict=True)]
    start = made.path()
    constraints = wall.constrain(tracks, made.FACTS, start)
    assert isinstance(constraints, Constraints)
    return merge(camera_priors(made.FACTS, start, made.references(LENGTH)), constraints)


def moved(frames: list[int], by: Floats) -> Floats:
    poses = made.path().world_from_rig.copy()
    poses[frames, :3, 3] += by
    return poses


def astray(poses: Floats) -> Ints:
    return frames_astray(problem(), poses, made.WALL)


def test_a_camera_that_stands_still_is_not_astray() -> None:
    poses = moved([], np.zeros(3))
    poses[:9, :3, 3] = poses[8, :3, 3]
    assert not len(astray(poses))


@pytest.mark.parametrize("frames", [[0], [11], [5], [5, 6], []])
def test_frames_a_leap_away_are_astray(frames: list[int]) -> None:
    assert astray(moved(frames, np.array([0.0, -3.0, 15.0]))).tolist() == frames


def test_a_step_to_the_side_is_no_leap() -> None:
    assert not len(astray(moved([5], np.array([0.0, 0.2, 1.0]))))


def test_a_path_in_two_parts_is_not_astray() -> None:
    assert not len(astray(moved([0, 1, 2, 3], np.array([-30.0, 0.0, 0.0]))))


def test_a_frame_that_alone_shows_a_landmark_stays() -> None:
    whole, last = problem(), int(problem().used[-1])
    shown = whole.measurements.keys[whole.measurements.frames == last][0]
    lone = replace(
        whole,
        measurements=whole.measurements.take((whole.measurements.keys != shown) | (whole.measurements.frames == last)),
    )
    assert without_frames(lone, np.array([last])) is lone
    assert last not in without_frames(whole, np.array([last])).used


def test_a_frame_solved_far_away_is_left_out_and_told() -> None:
    solution = solve(problem({11: np.array([4.0, 1.5, 40.0])}))
    assert solution.trajectory.frames.tolist() == list(range(11))
    assert any(warning.startswith("frame 11 is left out") for warning in solution.warnings)
    assert solve(problem()).trajectory.frames.tolist() == list(range(12))
