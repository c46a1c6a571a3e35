"""Two faces seen on one drive: what is known of one serves the other, one measurement counts once, contradiction is told."""

from dataclasses import replace

import gtsam
import made_up_rack as made
import numpy as np
import pytest
import two_faces

from savmap.errors import SolveError
from savmap.graph import CameraHeight, Constraints, KeySpace, Problem, Solution, image_measurements, merge, solve_rows
from savmap.graph.factors.scene import square
from savmap.graph.joint import (
    rekey_factor,
    rekey_values,
    row_of,
    shared_frame_factors,
    shared_frames,
    shared_measurements,
    values_of_row,
)
from savmap.graph.keys import frame_key
from savmap.types import Track

pytestmark = pytest.mark.slow

FRAMES = 30
SAME = [range(FRAMES)] * 2
OTHER = [range(FRAMES), range(100, 100 + FRAMES)]


@pytest.fixture(scope="module")
def aisle() -> tuple[made.World, made.World]:
    return two_faces.faces(4, frames=FRAMES)


def length(world: made.World, solution: Solution) -> tuple[float, float]:
    """Error and standard deviation of a row's length, m: of its last upright's right edge, the first one's left being 0."""
    x, _, sigma, _ = made.errors(world, solution)
    return float(x[-1]), float(sigma[-1])


@pytest.fixture(scope="module")
def together(aisle: tuple[made.World, made.World]) -> list[Solution]:
    return solve_rows(two_faces.problems(*aisle, rng=np.random.default_rng(4)), SAME)


def test_the_length_of_one_row_serves_the_other(aisle: tuple[made.World, made.World], together: list[Solution]) -> None:
    alone = solve_rows(two_faces.problems(*aisle, rng=np.random.default_rng(4)), OTHER)
    before, after = (length(aisle[1], solutions[1]) for solutions in (alone, together))
    assert after[1] < before[1] / 4
    assert abs(after[0]) < 3 * after[1]
    assert length(aisle[0], together[0])[1] < 1.02 * length(aisle[0], alone[0])[1]
    assert [solution.report.get("solved_together") for solution in alone] == [None, None]
    assert [solution.report["solved_together"] for solution in together] == ["rows A and B"] * 2


def test_both_rows_have_one_camera_path(aisle: tuple[made.World, made.World], together: list[Solution]) -> None:
    paths = [solution.trajectory for solution in together]
    seen = [path.frames[np.max(path.sigma_m, axis=1) < 0.02] for path in paths if path.sigma_m is not None]
    both = np.intersect1d(*seen)
    assert len(both) > FRAMES / 2
    a, b = (path.world_from_rig[np.searchsorted(path.frames, both)] for path in paths)
    b_from_a = b @ np.linalg.inv(a)
    moved = b_from_a[0] @ a
    np.testing.assert_allclose(moved[:, :3, 3], b[:, :3, 3], atol=5e-3)
    truth = two_faces.b_from_a(float(aisle[1].rack.uprights[-1, 1]))
    np.testing.assert_allclose(b_from_a[:, :3, :3], np.tile(truth[:3, :3], (len(both), 1, 1)), atol=2e-3)


def test_references_that_contradict_across_the_aisle_are_named(aisle: tuple[made.World, made.World]) -> None:
    a, b = two_faces.problems(*aisle, off_m=0.7, camera_of_a=False)
    solutions = solve_rows([a, b], SAME)
    for solution in solutions:
        assert "solved_together" not in solution.report
        assert sum("mapped without the others" in made.said(warning) for warning in solution.warnings) == 1
    apart = next(made.said(warning) for warning in solutions[0].warnings if "mapped without" in made.said(warning))
    assert "standard deviations off what the rows say together" in apart
    assert "row A: length upright 1 / left to upright 4 / right" in apart


def test_an_error_that_nothing_checks_is_told_of_both_rows(aisle: tuple[made.World, made.World]) -> None:
    """A length that is 20 cm too long stretches both rows of the drive, whose sigmas say 3 mm."""
    solutions = solve_rows(two_faces.problems(*aisle, off_m=0.2), SAME)
    for world, solution in zip(aisle, solutions, strict=True):
        assert isinstance(solution, Solution)
        assert solution.warnings == ()
        (error, sigma), covariance = length(world, solution), solution.covariance
        slot = 3 * covariance.keys.index(solution.keys["shelves"]["upright 4 / right / top"])
        hidden = float(np.abs(covariance.hidden[:, slot]).max())
        assert 10 * sigma < error < hidden < 4 * error


def test_a_height_in_feet_is_named_in_one_row_of_the_drive(aisle: tuple[made.World, made.World]) -> None:
    """It is one reference: row B, which cannot tell by itself, was refused, and frames were said to be missing."""
    problems = two_faces.problems(*aisle)
    feet = problems[0].camera.references.camera_heights[0].value_m / 0.3048

    def in_feet(problem: Problem) -> Problem:
        references = replace(problem.camera.references, camera_heights=(CameraHeight(feet, 0.02),))
        return replace(problem, camera=replace(problem.camera, references=references))

    of_a, of_b = solve_rows([in_feet(problem) for problem in problems], SAME)
    assert isinstance(of_a, Solution)
    assert isinstance(of_b, Solution)
    (warning,) = of_a.warnings
    assert len(warning.details) == 1
    assert f"camera height is given as {feet:.3f} m" in warning.details[0]
    assert f"({feet:.3f} feet are {0.3048 * feet:.3f} m)" in warning.details[0]
    assert (of_b.warnings, of_b.notes) == ((), ())
    assert [solution.references[0].state for solution in (of_a, of_b)] == ["left out"] * 2
    assert max(abs(length(world, found)[0]) for world, found in zip(aisle, (of_a, of_b), strict=True)) < 0.02


def test_frames_that_do_not_match_are_told(aisle: tuple[made.World, made.World]) -> None:
    solutions = solve_rows(two_faces.problems(*aisle), [range(FRAMES), range(3, 3 + FRAMES)])
    assert "do not fit one camera path" in made.said(solutions[0].warnings[-1])


def test_row_beside_a_refused_one_is_warned_of(aisle: tuple[made.World, made.World]) -> None:
    """What was given for both may be what is wrong: of the camera height of the drive, say, one row alone can tell."""
    a, b = two_faces.problems(*aisle)
    high = replace(a.camera.references, camera_heights=(CameraHeight(5.0, 0.02),), on_contradiction="refuse")
    wrong = replace(a, camera=replace(a.camera, references=high))
    refused, beside = solve_rows([wrong, b], SAME)
    assert isinstance(refused, SolveError)
    assert isinstance(beside, Solution)
    assert (beside.warnings[-1].code, beside.warnings[-1].subjects) == ("reference-conflict", ("row A",))


def test_a_camera_height_counts_once(aisle: tuple[made.World, made.World]) -> None:
    problems = two_faces.problems(*aisle)
    heights = [problem.camera.references.camera_heights[0] for problem in shared_measurements(problems, SAME, ())]
    assert [height.sigma_m for height in heights] == pytest.approx([0.02 * np.sqrt(2)] * 2)
    other = replace(problems[1].camera.references, camera_heights=(CameraHeight(3.0, 0.02),))
    apart = replace(problems[1], camera=replace(problems[1].camera, references=other))
    kept = shared_measurements([problems[0], apart], SAME, ())
    assert [problem.camera.references.camera_heights[0].sigma_m for problem in kept] == [0.02, 0.02]


def test_what_both_rows_see_counts_once(aisle: tuple[made.World, made.World]) -> None:
    problems = [with_lamp(problem, world) for problem, world in zip(two_faces.problems(*aisle), aisle, strict=True)]
    shared = shared_measurements(problems, [range(FRAMES), range(10, 10 + FRAMES)], {"lamps"})
    for before, after, twice in zip(problems, shared, (range(10, FRAMES), range(FRAMES - 10)), strict=True):
        lamp = np.isin(before.measurements.keys, list(before.parts[1].keys.values()))
        ratio = after.measurements.covariances[:, 0, 0] / before.measurements.covariances[:, 0, 0]
        both = lamp & np.isin(before.measurements.frames, twice)
        np.testing.assert_allclose(ratio, np.where(both, 2.0, 1.0))
        assert both.sum() == FRAMES - 10


def with_lamp(problem: Problem, world: made.World) -> Problem:
    """The problem with a part of one point that was seen in every frame."""
    views = (next(iter(world.facts.views)),) * FRAMES
    track = Track(
        "lamp", "lamp", {}, np.arange(FRAMES), views, np.full((FRAMES, 2), 99.0), np.tile(np.eye(2), (FRAMES, 1, 1))
    )
    keys = KeySpace("lamps").keys(["lamp"])
    part = Constraints("lamps", keys, image_measurements([track], keys, world.facts.views), (), {"lamp": np.zeros(3)})
    return merge(problem.camera, problem.parts[0], part)


def test_derivatives_of_the_tie() -> None:
    rng = np.random.default_rng(0)
    tie = shared_frames([np.arange(3)] * 2, [range(3)] * 2)[0]
    factor = shared_frame_factors(tie, gtsam.Pose3())[1]
    values = gtsam.Values()
    for key in factor.keys():  # noqa: SIM118
        values.insert(key, gtsam.Pose3.Expmap(rng.normal(0, 0.3, 6)))
    matrix, _ = factor.linearize(values).jacobian()
    for number, key in enumerate(factor.keys()):
        for axis in range(6):
            moved = [gtsam.Values(values), gtsam.Values(values)]
            for one, step in zip(moved, (1e-6, -1e-6), strict=True):
                one.update(key, values.atPose3(key).retract(step * np.eye(6)[axis]))
            slope = (factor.whitenedError(moved[0]) - factor.whitenedError(moved[1])) / 2e-6
            np.testing.assert_allclose(matrix[:, 6 * number + axis], slope, rtol=1e-4, atol=1e-3)


def test_factors_written_in_python_are_carried_too() -> None:
    corners = KeySpace("markers").keys("abcd")
    values = gtsam.Values()
    for key, place in zip(corners.values(), np.random.default_rng(1).normal(0, 1, (4, 3)), strict=True):
        values.insert(key, place)
    values.insert(frame_key(3), gtsam.Pose3())
    own = square(list(corners.values()), 0.001)
    carried, there = rekey_factor(own, 1), rekey_values(values, 1)
    assert {row_of(key) for key in carried.keys()} == {1}  # noqa: SIM118
    assert carried.error(there) == pytest.approx(own.error(values))
    np.testing.assert_allclose(carried.linearize(there).jacobian()[0], own.linearize(values).jacobian()[0])
    assert values_of_row(there, 1).equals(values, 1e-12)
