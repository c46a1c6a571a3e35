"""The solve on made-up racks: truth is found, from poor starts and among outliers, and sigmas are honest."""

import gtsam
import made_up_rack as made
import numpy as np
import pytest

from savmap.graph import Problem, SolveOptions, camera_priors, locate_camera, merge, solve
from savmap.graph.covariance import covariance
from savmap.graph.factors.problem_factors import values_of, whole_graph
from savmap.graph.initial.start import starts
from savmap.graph.keys import frame_key
from savmap.graph.measurements import ImageMeasurements
from savmap.graph.problem import first_poses
from savmap_shelves.constraints import GridSettings, constrain


@pytest.fixture(scope="module")
def small() -> made.World:
    return made.world(5, sections=3, frames=40, bridge=1)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.slow
def test_recovers_truth() -> None:
    world = made.world(0)
    solution = made.solved(world)
    x, y, _, _ = made.errors(world, solution)
    assert np.abs(x).mean() < 0.003
    assert np.abs(y).mean() < 0.003
    camera = solution.trajectory.world_from_rig[:, :3, 3] - world.poses[solution.trajectory.frames, :3, 3]
    assert solution.trajectory.sigma_m is not None
    assert 0.7 < rms(camera / solution.trajectory.sigma_m) < 1.3
    assert solution.notes == ()
    assert solution.warnings == ()


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "height", "distance"), [(1.3, 0.3, 1.3), (0.7, -0.3, 0.7)])
def test_poor_start(small: made.World, speed: float, height: float, distance: float) -> None:
    best = made.errors(small, made.solved(small))
    begin = made.begin(small, speed, height, distance, attitude_deg=1.0)
    found = made.errors(small, made.solved(small, begin))
    np.testing.assert_allclose(found[0], best[0], atol=3e-3)
    np.testing.assert_allclose(found[1], best[1], atol=3e-3)


def test_linear_start_is_the_better_one(small: made.World) -> None:
    problem = made.problem(small, made.begin(small, 1.3, 0.3, 1.3))
    truth = small.poses[problem.used, :3, 3]
    linear, given = (
        np.abs(poses[:, :3, 3] - truth).mean() for poses in (starts(problem)[0].estimate.poses, first_poses(problem))
    )
    assert linear < 0.1 < given


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.05, 0.1])
def test_outliers_are_found(share: float) -> None:
    world = made.world(7, frames=60, outliers=share)
    solution = made.solved(world)
    x, y, _, _ = made.errors(world, solution)
    assert np.abs(x).mean() < 0.004
    assert np.abs(y).mean() < 0.003
    assert solution.report["rejected_share"] == pytest.approx(share, abs=0.015)


@pytest.mark.slow
def test_sigmas_are_honest() -> None:
    """Normalised errors over several racks, the references being off by their own sigmas too."""
    off: dict[int, list[np.ndarray]] = {0: [], 1: []}
    for seed in range(6):
        world = made.world(20 + seed, sections=3, frames=30)
        given = made.references(world, rng=np.random.default_rng(seed))
        x, y, sigma_x, sigma_y = made.errors(world, made.solved(world, given=given))
        off[0].append(x[1:] / sigma_x[1:])
        off[1].append(y / sigma_y)
    assert 0.7 < rms(np.concatenate(off[0])) < 1.3
    assert 0.7 < rms(np.concatenate(off[1])) < 1.3


def _inflated(problem: Problem) -> ImageMeasurements:
    return problem.measurements.inflated(np.full(len(problem.measurements), 1.5))


def test_covariance_is_that_of_gtsam(small: made.World) -> None:
    problem = made.problem(small, made.begin(small))
    estimate = starts(problem)[0].estimate
    graph, values = whole_graph(problem, estimate, _inflated(problem), None), values_of(problem, estimate)
    ours = covariance(graph, values)
    theirs = gtsam.Marginals(graph, values)
    for key in problem.keys.tolist()[::17]:
        np.testing.assert_allclose(ours.of([key]), theirs.marginalCovariance(key), rtol=1e-3, atol=1e-10)
    used = problem.used.tolist()
    for index in (0, 7, len(used) - 1):
        turn = estimate.poses[index, :3, :3]
        place = turn @ theirs.marginalCovariance(frame_key(used[index]))[3:, 3:] @ turn.T
        np.testing.assert_allclose(ours.cameras[index], np.diag(place), rtol=1e-3)


def test_a_part_of_the_covariance_is_that_of_the_whole(small: made.World) -> None:
    problem = made.problem(small, made.begin(small))
    estimate = starts(problem)[0].estimate
    graph, values = whole_graph(problem, estimate, _inflated(problem), None), values_of(problem, estimate)
    asked = problem.keys[[3, 40, 7]].tolist()
    whole, part = covariance(graph, values), covariance(graph, values, only=asked)
    assert set(part.keys) == set(asked)
    np.testing.assert_allclose(part.of(asked), whole.of(asked), rtol=1e-6, atol=1e-12)


def test_the_path_alone_is_that_of_the_solution(small: made.World) -> None:
    problem = made.problem(small, made.begin(small))
    whole, path = solve(problem, SolveOptions(rounds=1, judge=False)).trajectory, locate_camera(problem).path
    assert np.array_equal(path.world_from_rig, whole.world_from_rig)
    assert path.sigma_m is None


@pytest.mark.slow
def test_the_same_twice(small: made.World) -> None:
    first, second = made.solved(small), made.solved(small)
    assert np.array_equal(first.trajectory.world_from_rig, second.trajectory.world_from_rig)
    assert np.array_equal(first.covariance.points, second.covariance.points)
    for name, landmark in first.landmarks_of("shelves").items():
        assert np.array_equal(landmark.position, second.landmarks_of("shelves")[name].position)


def test_frames_that_saw_nothing_are_filled_in(small: made.World) -> None:
    blind = made.without_frames(small, {0, 10, 11, 12})
    path = made.solved(blind).trajectory
    assert path.frames.tolist() == list(range(1, 40))
    assert path.sigma_m is not None
    assert np.isfinite(path.world_from_rig).all()
    assert np.abs(path.world_from_rig[10, :3, 3] - small.poses[11, :3, 3]).max() < 0.3
    assert path.sigma_m[10].min() > np.median(path.sigma_m)


def test_landmarks_alone_from_a_known_path(small: made.World) -> None:
    path = made.solved(small).trajectory
    own = constrain(small.tracks, small.facts, path, settings=GridSettings())
    solution = solve(merge(camera_priors(small.facts, path, fixed=path), own))
    x, y, _, _ = made.errors(small, solution)
    assert np.abs(x).mean() < 0.006
    assert np.abs(y).mean() < 0.005
    np.testing.assert_allclose(solution.trajectory.world_from_rig[:, :3, 3], path.world_from_rig[:, :3, 3], atol=2e-3)
