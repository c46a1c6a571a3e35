"""Points of no structure bind neighbouring frames to one another, and lie in vain."""

from dataclasses import replace

import gtsam
import made_up_rack as made
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from savmap.graph import frame_key, locate_camera, merge, solve
from savmap.graph.factors.appearance import (
    ERROR_PX,
    SIGMA_PX,
    motion,
    motion_constraints,
    motion_factor,
    seen_from,
    weighed_points,
)
from savmap.types import Floats, Flow, Trajectory, ViewSpec

SPEC = ViewSpec("face", 20.0, -5.0, 2.0, 150.0)
SPEC_AHEAD = ViewSpec("face", 0.0, 0.0, 0.0, 140.0)
STEPS_M = (0.0, 0.22, 0.47, 0.66)
SIGMA_M = np.full(4, 0.003)
CARTON_PX = 25.0


def path() -> Floats:
    """Four uneven steps along a face, turning a little; the rig looks at it."""
    poses = np.tile(np.eye(4), (4, 1, 1))
    facing = np.diag([1.0, -1.0, -1.0])
    poses[:, :3, :3] = facing @ Rotation.from_rotvec([[0.01 * k, -0.02 * k, 0.005] for k in range(4)]).as_matrix()
    poses[:, :3, 3] = [(x, 2.4 + 0.01 * k, 1.5 - 0.02 * k) for k, x in enumerate(STEPS_M)]
    return poses


def points(count: int = 60) -> Floats:
    rng = np.random.default_rng(1)
    return rng.uniform((-0.8, 0.6, -0.9), (1.4, 4.0, 0.1), (count, 3))


def flow(noise_px: float = 0.0) -> Flow:
    """The points as the path sees them."""
    blank = Flow(np.arange(4), SPEC, np.zeros((len(points()), 4, 2)))
    noise = np.random.default_rng(2).normal(0.0, noise_px, blank.pixels.shape)
    return Flow(blank.frames, SPEC, seen_from(blank, path(), points()).errors + noise)


def agreeing(one: Flow, poses: Floats, sigma_m: Floats = SIGMA_M) -> NDArray[np.bool_]:
    return weighed_points(one, poses, sigma_m)[1] > 0


def said(one: Flow, poses: Floats) -> tuple[Floats, Floats]:
    points, weights = weighed_points(one, poses, np.full(4, 0.05))
    assert (weights > 0).all()
    return motion(one, poses, points, weights / SIGMA_PX)


def slipping(one: Flow, points: slice) -> Flow:
    """The flow with these points taken for their neighbours from the third frame on."""
    pixels = one.pixels.copy()
    pixels[points, 2:, 0] += CARTON_PX
    return replace(one, pixels=pixels)


def test_true_points_agree_and_those_that_slip_by_a_carton_do_not() -> None:
    slipped = slipping(flow(ERROR_PX / 2), slice(20))
    kept = agreeing(slipped, path())
    assert not kept[:20].any()
    assert kept[20:].mean() > 0.9


def test_points_that_all_slip_together_are_all_left_out() -> None:
    slipped = slipping(flow(), slice(None))
    assert not agreeing(slipped, path()).any()
    constraints, counts = motion_constraints([slipped], Trajectory(np.arange(4), path()), np.arange(4))
    assert counts == {"points followed": 60, "points used": 0}
    assert constraints.factors is not None
    assert constraints.factors.size() == 0


def test_where_the_path_is_uncertain_points_may_say_otherwise() -> None:
    wrong = path()
    wrong[3, 0, 3] += 0.2
    assert agreeing(flow(), wrong).mean() < 0.2
    assert agreeing(flow(), wrong, np.array([0.003, 0.003, 0.003, 0.2])).mean() > 0.8


def test_the_slopes_are_those_of_the_errors() -> None:
    """A frame moved along x costs what the factor, linear about where it was, says; no motion of all, no scale costs."""
    slopes, errors = said(flow(), path())
    assert np.abs(errors).max() < 1e-6
    poses = path()
    step = np.array([0.0, 0.0, 0.0, *(poses[2, :3, :3].T @ [0.004, 0.0, 0.0])])
    moved = poses.copy()
    moved[2, 0, 3] += 0.004
    cost = np.linalg.norm(slopes[:, 12:18] @ step)
    assert cost > 0.05
    assert abs(np.linalg.norm(said(flow(), moved)[1]) - cost) < 0.05 * cost
    shift = np.concatenate([[0, 0, 0, *(pose[:3, :3].T @ [1.0, 2.0, 3.0])] for pose in poses])
    growth = np.concatenate([[0, 0, 0, *(pose[:3, :3].T @ pose[:3, 3])] for pose in poses])
    assert np.linalg.norm(slopes @ shift) < 1e-6
    assert np.linalg.norm(slopes @ growth) < 1e-6


def test_a_frame_comes_back_to_where_the_points_saw_it() -> None:
    poses, wrong = path(), path()
    wrong[2, :3, 3] += (0.02, 0.01, -0.01)
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(motion_factor(np.arange(4), wrong, *said(flow(), wrong)))
    values = gtsam.Values()
    for frame in range(4):
        values.insert(frame_key(frame), gtsam.Pose3(wrong[frame]))
        if frame != 2:
            held = gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)
            graph.push_back(gtsam.PriorFactorPose3(frame_key(frame), gtsam.Pose3(poses[frame]), held))
    solved = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    assert np.abs(solved.atPose3(frame_key(2)).translation() - poses[2, :3, 3]).max() < 0.002


def test_frames_that_saw_no_structure_are_not_bound() -> None:
    constraints, counts = motion_constraints([flow()], Trajectory(np.arange(4), path()), np.array([0, 1, 3]))
    assert counts["points followed"] == 0
    assert constraints.factors is not None
    assert constraints.factors.size() == 0


def flows_of(poses: Floats) -> list[Flow]:
    """Points on and behind a face, followed through every second four frames of a path along it."""
    rng = np.random.default_rng(5)
    found = []
    for first in range(0, len(poses) - 3, 2):
        own = poses[first : first + 4]
        places = own[0, :3, 3] + rng.uniform((-1.5, -2.0, -2.5), (1.5, 1.5, -1.4), (80, 3))
        blank = Flow(np.arange(first, first + 4), SPEC_AHEAD, np.zeros((80, 4, 2)))
        pixels = seen_from(blank, own, places).errors + rng.normal(0.0, 0.15, (80, 4, 2))
        found.append(Flow(blank.frames, SPEC_AHEAD, pixels))
    return found


@pytest.mark.slow
def test_points_steady_the_camera_where_structures_say_little() -> None:
    world = made.world(11, sections=3, frames=60, noise_px=1.5, misses=0.2, bridge=None)
    problem = made.problem(world, made.begin(world))
    path = locate_camera(problem, sigmas=True).path
    constraints, counts = motion_constraints(flows_of(world.poses), path, problem.used)
    assert counts["points used"] > 0.9 * counts["points followed"]
    plain, helped = solve(problem), solve(merge(problem.camera, *problem.parts, constraints))
    off = [np.diff((one.trajectory.world_from_rig - world.poses)[:, 0, 3]).std() for one in (plain, helped)]
    assert off[1] < 0.85 * off[0]
    edges = [np.abs(made.errors(world, one)[0]).mean() for one in (plain, helped)]
    assert edges[1] < edges[0] + 1e-4


def test_nothing_is_said_where_the_path_is_not_known() -> None:
    sigma_m = np.full((4, 3), 0.003)
    sigma_m[3, 0] = 0.2
    constraints, counts = motion_constraints([flow()], Trajectory(np.arange(4), path(), sigma_m), np.arange(4))
    assert counts["points followed"] == 0
    assert constraints.factors is not None
    assert constraints.factors.size() == 0
