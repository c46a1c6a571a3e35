"""Frames that see too little, or something else, are left out or outvoted; either half of the frames shows every view."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from savmap.geometry.pinhole import project
from savmap.graph import KnownLength, Problem, fixed_coordinate, solve
from savmap.graph.initial.linear import linear_positions
from savmap.graph.problem import first_poses
from savmap.graph.solver.optimise import frames_astray, without_frames
from savmap.types import Floats, Ints, Track

from . import made_up_wall as made

LAST = made.FRAMES - 1
LENGTH = KnownLength("post 0", "post 12", 4.0, 0.002, axis="x")
MIDDLE = np.array([made.SPEC.width, made.SPEC.height]) / 2


def problem(change: Callable[[int, Track], Track] = lambda number, track: track, plane: bool = True) -> Problem:
    """The wall's, with changed tracks."""
    tracks = [change(number, track) for number, track in enumerate(made.Wall(made.Config()).tracks())]
    plan = (fixed_coordinate("x", made.KEYS["post 0"]), *(fixed_coordinate("z", key) for key in made.KEYS.values()))
    return made.problem_of(tracks, made.WALL, plan if plane else (), made.references(LENGTH))


@pytest.mark.parametrize(
    ("points", "along_px", "is_used"), [(3, 0.1, True), (2, 0.1, False), (6, 200.0, True), (5, 200.0, False)]
)
def test_a_pose_needs_six_equations(points: int, along_px: float, is_used: bool) -> None:
    """A point gives two, a point anywhere on a line one; the last frame sees so many."""

    def thinned(number: int, track: Track) -> Track:
        kept = track.frames < LAST
        rows = [*np.flatnonzero(kept), *([0] if number < points else [])]
        frames = np.append(track.frames[kept], [LAST] * (number < points)).astype(np.int64)
        spread = np.tile(np.diag([0.01, along_px**2]), (len(rows), 1, 1))
        return replace(
            track, frames=frames, views=track.views[:1] * len(rows), pixels=track.pixels[rows], covariances=spread
        )

    assert (LAST in problem(thinned, plane=False).used) == is_used


@pytest.mark.parametrize(("astray", "shrunk"), [(0, 1.0), (1, 0.1), (1, 0.0), (2, 0.03)])
def test_frames_that_fly_off_shrink_nothing(astray: int, shrunk: float) -> None:
    """What looks small in the last frames is taken for far away: all others shrank to a point for it, and the row had no scale."""
    rng = np.random.default_rng(0)

    def drawn_together(number: int, track: Track) -> Track:
        pixels = track.pixels + rng.normal(0, 3, track.pixels.shape)
        last = track.frames >= made.FRAMES - astray
        pixels[last] = MIDDLE + shrunk * (pixels[last] - MIDDLE)
        return replace(track, pixels=pixels)

    wall = problem(drawn_together)
    cameras, points = linear_positions(wall, first_poses(wall), made.WALL)
    assert np.ptp(points[:, 0]) == pytest.approx(np.ptp(made.WALL[:, 0]), rel=0.1)
    assert cameras[: made.FRAMES - astray, 2] == pytest.approx(2.5, rel=0.1)


def astray(frames: list[int], by: tuple[float, float, float], still: int = 0) -> Ints:
    """Which frames are astray where some are moved, and the first ones stand still."""
    poses = made.path().world_from_rig.copy()
    poses[frames, :3, 3] += by
    poses[:still, :3, 3] = poses[still - 1, :3, 3]
    return frames_astray(problem(), poses, made.WALL)


@pytest.mark.parametrize("frames", [[0], [11], [5], [5, 6], []])
def test_frames_a_leap_away_are_astray(frames: list[int]) -> None:
    assert astray(frames, (0.0, -3.0, 15.0)).tolist() == frames


def test_a_stand_a_step_aside_and_a_path_in_two_parts_are_not() -> None:
    assert not len(astray([], (0.0, 0.0, 0.0), still=9))
    assert not len(astray([5], (0.0, 0.2, 1.0)))
    assert not len(astray([0, 1, 2, 3], (-30.0, 0.0, 0.0)))


def test_a_frame_that_alone_shows_a_landmark_stays() -> None:
    whole = problem()
    keys, last = whole.measurements.keys, whole.measurements.frames == LAST
    lone = replace(whole, measurements=whole.measurements.take((keys != keys[last][0]) | last))
    assert without_frames(lone, np.array([LAST])) is lone
    assert LAST not in without_frames(whole, np.array([LAST])).used


def test_a_frame_solved_far_away_is_left_out_and_told() -> None:
    def seen_from_afar(number: int, track: Track) -> Track:
        pixels = track.pixels.copy()
        away: Floats = (made.WALL[number] - [4.0, 1.5, 40.0])[None] @ made.LEVEL
        pixels[track.frames == LAST] = project(away, made.SPEC.camera)
        return replace(track, pixels=pixels)

    solution = solve(problem(seen_from_afar))
    assert solution.trajectory.frames.tolist() == list(range(LAST))
    assert any(warning.startswith(f"frame {LAST} is left out") for warning in solution.notes)
    assert solve(problem()).trajectory.frames.tolist() == list(range(made.FRAMES))
