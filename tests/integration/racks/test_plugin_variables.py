"""Variables of a plugin's own: a pose on the floor and three numbers, bound by a plugin's own factors, in the joint solve."""

from collections.abc import Sequence

import gtsam
import made_up_rack as made
import numpy as np
import pytest
import two_faces

from savmap.errors import SolveError, StructureError
from savmap.graph import (
    Constraints,
    KeySpace,
    Solution,
    camera_priors,
    frame_key,
    image_measurements,
    merge,
    solve,
    solve_rows,
)
from savmap.graph.keys import Variable
from savmap.types import Floats, Trajectory

SPACE = KeySpace("things")
THING, SIZE = SPACE.pose2(0), SPACE.vector3(1)
PLACE, TURN = np.array([1.5, -0.8]), 0.7
SIZES = np.array([1.2, 0.144, 0.8])
SIGMA_M = 0.01


def seen_from(frame: int, pose: Floats) -> gtsam.CustomFactor:
    """A mark on the thing, a metre along its own x axis, was seen just so from the rig: its place there, m."""

    def place(values: gtsam.Values) -> Floats:
        mark = values.atPose2(THING).transformFrom(np.array([1.0, 0.0]))
        return np.asarray(values.atPose3(frame_key(frame)).transformTo(np.array([mark[0], 0.0, -mark[1]])))

    truth = gtsam.Values()
    truth.insert(THING, gtsam.Pose2(*PLACE.tolist(), TURN))
    truth.insert(frame_key(frame), gtsam.Pose3(pose))
    wanted = place(truth)

    def error(own: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        if jacobians is not None:
            for number, key in enumerate(own.keys()):
                jacobians[number] = np.asfortranarray(slopes(place, values, key))
        return place(values) - wanted

    return gtsam.CustomFactor(gtsam.noiseModel.Isotropic.Sigma(3, SIGMA_M), [frame_key(frame), THING], error)


def slopes(place, values: gtsam.Values, key: int) -> Floats:  # type: ignore[no-untyped-def]
    """Numerical derivatives (3, width)."""
    width = 3 if key == THING else 6
    columns = []
    for step in 1e-6 * np.eye(width):
        moved = [gtsam.Values(values), gtsam.Values(values)]
        for copy, sign in zip(moved, (1, -1), strict=True):
            at = values.atPose2(key) if key == THING else values.atPose3(key)
            copy.update(key, at.retract(sign * step))
        columns.append((place(moved[0]) - place(moved[1])) / 2e-6)
    return np.stack(columns, axis=1)


def things(world: made.World, frames: Sequence[int], start: Variable) -> Constraints:
    graph = gtsam.NonlinearFactorGraph()
    for frame in frames:
        graph.add(seen_from(frame, world.poses[frame % len(world.poses)]))
    graph.add(gtsam.PriorFactorPose2(THING, start, gtsam.noiseModel.Isotropic.Sigma(3, 1.0)))
    graph.add(gtsam.PriorFactorPoint3(SIZE, SIZES, gtsam.noiseModel.Isotropic.Sigma(3, 0.005)))
    return Constraints(
        "things", {}, image_measurements((), {}, {}), (), {}, factors=graph, variables={THING: start, SIZE: SIZES + 0.1}
    )


@pytest.fixture(scope="module")
def world() -> made.World:
    return made.world(4, sections=2, frames=16)


def solved(world: made.World, frames: Sequence[int]) -> Solution:
    plain = made.problem(world, made.begin(world), made.references(world))
    return solve(merge(plain.camera, *plain.parts, things(world, frames, gtsam.Pose2(1.2, -0.5, 0.4))))


def test_a_pose_on_the_floor_and_numbers_are_solved_for(world: made.World) -> None:
    solution = solved(world, range(4, 10))
    found = solution.variables[THING]
    mark = found.transformFrom(np.array([1.0, 0.0]))
    true = PLACE + np.array([np.cos(TURN), np.sin(TURN)])
    np.testing.assert_allclose(mark, true, atol=0.03)
    np.testing.assert_allclose(solution.variables[SIZE], SIZES, atol=1e-6)
    np.testing.assert_allclose(np.sqrt(np.diag(solution.variable_covariance(SIZE))), 0.005, rtol=0.01)
    assert np.linalg.eigvalsh(solution.variable_covariance(THING)).min() > 0


def test_factors_of_frames_that_are_not_solved_for_are_left_out(world: made.World) -> None:
    plain = made.problem(world, made.begin(world), made.references(world))
    merged = merge(plain.camera, *plain.parts, things(world, [2, 3, 900], gtsam.Pose2()))
    part = merged.parts[-1]
    assert part.factors is not None
    assert part.factors.size() == 4
    assert set(part.variables) == {THING, SIZE}


def test_a_variable_that_nothing_binds_is_refused() -> None:
    with pytest.raises(ValueError, match="no factor binds 1 of its own variables"):
        Constraints("things", {}, image_measurements((), {}, {}), (), {}, variables={THING: gtsam.Pose2()})


@pytest.mark.slow
def test_rows_solved_together_keep_their_own_variables() -> None:
    a, b = two_faces.faces(4)
    of_a, of_b = two_faces.problems(a, b)
    of_a = merge(of_a.camera, *of_a.parts, things(a, range(10, 18), gtsam.Pose2(1.3, -0.6, 0.5)))
    of_b = merge(of_b.camera, *of_b.parts, things(b, range(10, 18), gtsam.Pose2(1.3, -0.6, 0.5)))
    first, second = solve_rows([of_a, of_b], [range(30)] * 2)
    assert isinstance(first, Solution)
    assert isinstance(second, Solution)
    assert first.report["solved_together"] == "rows A and B"
    for solution in (first, second):
        mark = solution.variables[THING].transformFrom(np.array([1.0, 0.0]))
        np.testing.assert_allclose(mark, PLACE + np.array([np.cos(TURN), np.sin(TURN)]), atol=0.05)
        np.testing.assert_allclose(np.sqrt(np.diag(solution.variable_covariance(SIZE))), 0.005, rtol=0.01)


def test_factors_alone_solve_on_a_known_path(world: made.World) -> None:
    """As with `--trajectory`: no landmark is measured, and frames are held where an earlier map has them."""
    known = Trajectory(np.arange(len(world.poses)), world.poses)
    camera = camera_priors(world.facts, known, fixed=known)
    problem = merge(camera, things(world, range(4, 10), gtsam.Pose2(1.2, -0.5, 0.4)))
    assert problem.used.tolist() == list(range(4, 10))
    solution = solve(problem)
    mark = solution.variables[THING].transformFrom(np.array([1.0, 0.0]))
    np.testing.assert_allclose(mark, PLACE + np.array([np.cos(TURN), np.sin(TURN)]), atol=0.01)
    np.testing.assert_allclose(np.sqrt(np.diag(solution.variable_covariance(SIZE))), 0.005, rtol=0.01)
    assert solution.trajectory.frames.tolist() == list(range(4, 10))


def test_factors_alone_do_not_locate_the_camera(world: made.World) -> None:
    camera = camera_priors(world.facts, made.begin(world))
    with pytest.raises(StructureError, match="nothing was tracked in any frame"):
        merge(camera, things(world, range(4, 10), gtsam.Pose2()))
    known = Trajectory(np.arange(3), world.poses[:3])
    with pytest.raises(StructureError, match="no frame with a known pose saw anything"):
        merge(camera_priors(world.facts, known, fixed=known), things(world, range(4, 10), gtsam.Pose2()))


def test_a_factor_that_fails_in_the_solve_is_one_line(world: made.World) -> None:
    """It passed the check of its first values, and raises at later ones."""
    first = SIZES + 0.1

    def error(_: object, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        if not np.array_equal(values.atPoint3(SIZE), first):
            raise KeyError("no such size")
        if jacobians is not None:
            jacobians[0] = np.eye(3)
        return np.ones(3)

    plain = made.problem(world, made.begin(world), made.references(world))
    part = things(world, range(4, 10), gtsam.Pose2(1.2, -0.5, 0.4))
    part.factors.add(gtsam.CustomFactor(gtsam.noiseModel.Isotropic.Sigma(3, 1.0), [SIZE], error))
    with pytest.raises(SolveError, match=r"row A: the graph cannot be solved \('no such size'\)"):
        solve(merge(plain.camera, *plain.parts, part))
