"""What is off about the camera is found with the map: how the halves of its panorama are turned, how long it is read out."""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import made_up_rack as made
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.geometry import pinhole
from savmap.graph import (
    Calibration,
    LensDistance,
    Shutter,
    Solution,
    Stitching,
    VerticalScale,
    camera_priors,
    merge,
    solve,
    solve_rows,
)
from savmap.graph.calibration import (
    BENDS,
    LENS_DISTANCES,
    Bend,
    Distortion,
    Lenses,
    Scene,
    drive_axes,
    largest_displacement,
    lowered,
    read_out_share,
    rear_share,
    total_baseline,
    turns,
    velocities,
)
from savmap.graph.problem import Problem
from savmap.types import Floats, Track, ViewSpec
from savmap_shelves.constraints import GridSettings, constrain

SEAM_AHEAD = 90.0
BLEND_DEG = 1.0
OFF = np.array([*np.radians([0.8, -0.9, 0.6]), 0.0, 0.0])
READ_OUT_S = 0.03
STRETCHED = 0.01
APART_M = 0.03
Move = Callable[[Floats], Floats]


@pytest.fixture(scope="module")
def small() -> made.World:
    return made.world(5, sections=3, frames=40, bridge=1, noise_px=0.3)


def moved(track: Track, seen: Move) -> Track:
    """The same track, its pixels and what is about them somewhere else."""
    pixels = seen(track.pixels)
    slopes = np.stack([seen(track.pixels + step) - pixels for step in np.eye(2)], axis=2)
    return replace(track, pixels=pixels, covariances=slopes @ track.covariances @ np.swapaxes(slopes, 1, 2))


def stitched(world: made.World) -> made.World:
    """As a camera shows it whose halves are turned against one another; the seam is in the middle of the view."""
    view = world.facts.views["face"]

    def seen(pixels: Floats) -> Floats:
        true = view.rig_rays(pixels)
        rays = true
        for _ in range(4):
            turn = np.einsum("p,npi->ni", OFF, turns(rays, rear_share(rays, SEAM_AHEAD, BLEND_DEG), SEAM_AHEAD))
            rays = Rotation.from_rotvec(-turn).apply(true)
        return pinhole.project(rays @ view.rig_from_view, view.camera)

    return replace(world, tracks=[moved(track, seen) for track in world.tracks])


def stretched(world: made.World) -> made.World:
    """As a panorama shows it that was cropped above and below and stretched to 2:1 again."""
    view = world.facts.views["face"]

    def seen(pixels: Floats) -> Floats:
        rays = view.rig_rays(pixels)
        rays = Rotation.from_rotvec(-STRETCHED * lowered(rays)).apply(rays)
        return pinhole.project(rays @ view.rig_from_view, view.camera)

    return replace(world, tracks=[moved(track, seen) for track in world.tracks])


def bent(world: made.World, plain: Solution, bend: Bend) -> made.World:
    """As a camera shows it whose lenses stand apart, and whose program bends the pictures about the seam."""
    used, poses = plain.trajectory.frames, plain.trajectory.world_from_rig
    speeds = velocities(poses, world.facts.frames.stamps_s[used])[0]
    drive = drive_axes(poses, speeds)
    view = world.facts.views["face"]

    def displaced(track: Track) -> Track:
        at = np.searchsorted(used, track.frames)
        place = plain.landmarks_of("shelves")[track.name].position
        offsets = np.einsum("nji,nj->ni", poses[at, :3, :3], place - poses[at, :3, 3])
        depths = (offsets @ view.rig_from_view)[:, 2:]

        def seen(pixels: Floats) -> Floats:
            rays = view.rig_rays(pixels)
            points = depths / (rays @ view.rig_from_view)[:, 2:] * rays
            points = points - APART_M * bend.points_of_view(rays, drive)
            return pinhole.project(points @ view.rig_from_view, view.camera)

        return moved(track, seen)

    return replace(world, tracks=[displaced(track) for track in world.tracks])


def constrained(world: made.World, calibration: Calibration | None) -> Problem:
    start = made.begin(world)
    own = constrain(world.tracks, world.facts, start, settings=GridSettings(world.rack.lowest, 0.002))
    return merge(camera_priors(world.facts, start, made.references(world), calibration=calibration), own)


def solved(world: made.World, calibration: Calibration | None) -> Solution:
    return solve(constrained(world, calibration))


def error(world: made.World, solution: Solution) -> float:
    x, y, _, _ = made.errors(world, solution)
    return float(np.abs(np.concatenate([x, y])).mean())


@pytest.mark.slow
def test_halves_turned_against_one_another_are_found(small: made.World) -> None:
    spoilt = stitched(small)
    plain = solved(spoilt, None)
    found = solved(spoilt, Calibration(Stitching(blend_deg=BLEND_DEG), front_deg=SEAM_AHEAD))
    for name, value in zip(("pitch", "yaw", "roll"), np.degrees(OFF), strict=False):
        sigma = float(found.report[f"calibration rear {name}, sigma deg"])
        assert sigma < 0.05
        assert float(found.report[f"calibration rear {name}, deg"]) == pytest.approx(value, abs=max(3 * sigma, 0.02))
    assert error(small, found) < 0.7 * error(small, plain)
    assert float(found.report["residual_scale_uncalibrated"]) > 1.5 * float(found.report["residual_scale"])
    assert found.notes[0].startswith("calibration: rear pitch +0.")


def test_what_the_footage_does_not_tell_stays_at_zero_and_is_named(small: made.World) -> None:
    """The view looks along the front lens's axis and sees nothing of the rear half."""
    found = solved(small, Calibration(Stitching(1.0, 0.003)))
    assert abs(float(found.report["calibration rear scale, percent"])) < 1e-6
    assert float(found.report["calibration rear scale, sigma percent"]) == pytest.approx(0.3, rel=0.01)
    assert float(found.report["calibration rear yaw, sigma deg"]) == pytest.approx(1.0, rel=0.05)
    assert any("hardly tells" in warning and "rear yaw" in warning for warning in found.notes)
    assert error(small, found) < 1.2 * error(small, solved(small, None))


@pytest.mark.slow
def test_a_read_out_time_is_found(small: made.World) -> None:
    plain = solved(small, None)
    used, poses = plain.trajectory.frames, plain.trajectory.world_from_rig
    speeds, rates = velocities(poses, small.facts.frames.stamps_s[used])
    view = small.facts.views["face"]

    def late(track: Track) -> Track:
        at = np.searchsorted(used, track.frames)
        own = np.swapaxes(poses[at, :3, :3], 1, 2)
        place = plain.landmarks_of("shelves")[track.name].position
        depths = (np.einsum("nij,nj->ni", own, place - poses[at, :3, 3]) @ view.rig_from_view)[:, 2:]
        ahead = np.einsum("nij,nj->ni", own, speeds[at])

        def seen(pixels: Floats) -> Floats:
            rays = view.rig_rays(pixels)
            points = depths / (rays @ view.rig_from_view)[:, 2:] * rays
            share = read_out_share(rays, 0.0, "rows")[:, None]
            points = points - READ_OUT_S * share * (np.cross(rates[at], points) + ahead)
            return pinhole.project(points @ view.rig_from_view, view.camera)

        return moved(track, seen)

    found = solved(replace(small, tracks=[late(track) for track in small.tracks]), Calibration(None, Shutter()))
    sigma = float(found.report["calibration read-out, sigma ms"])
    assert sigma < 5.0
    assert float(found.report["calibration read-out, ms"]) == pytest.approx(1e3 * READ_OUT_S, abs=3 * sigma)


@pytest.mark.slow
def test_stretched_elevations_are_found(small: made.World) -> None:
    spoilt = stretched(small)
    plain, found = solved(spoilt, None), solved(spoilt, Calibration(vertical=VerticalScale()))
    sigma = float(found.report["calibration vertical scale, sigma percent"])
    assert sigma < 10 * STRETCHED
    assert float(found.report["calibration vertical scale, percent"]) == pytest.approx(100 * STRETCHED, abs=3 * sigma)
    assert error(small, found) < 0.5 * error(small, plain)


def test_biases_are_moved_with_the_picture(small: made.World) -> None:
    """Along an edge its place is loose: a bias along it moves nothing, and must lie along it where the picture is moved to, or it would blow up all sigmas."""
    term = Calibration(vertical=VerticalScale())
    measured = constrained(small, term).measurements
    loose = np.array([np.cos(0.6), np.sin(0.6)])
    covariances = np.tile(1e6 * np.outer(loose, loose) + np.eye(2), (len(measured), 1, 1))
    along = np.tile(800 * loose, (len(measured), 1))[:, :, None]
    slopes = np.concatenate([along, measured.biases.slopes], axis=2)
    spoilt = replace(measured, covariances=covariances, biases=replace(measured.biases, slopes=slopes))
    points = np.tile([0.0, 0.0, 3.0], (len(measured), 1))
    moved = term.corrected(
        spoilt, np.array([0.02]), Scene(points, np.zeros_like(points), np.zeros_like(points), np.eye(3))
    )
    bias = moved.biases.slopes[:, :, 0]
    whitened = np.einsum("ni,nij,nj->n", bias, np.linalg.inv(moved.covariances), bias)
    np.testing.assert_allclose(whitened, 0.8**2, rtol=0.01)


@pytest.mark.slow
def test_a_row_says_by_how_much_its_panoramas_are_stretched(small: made.World) -> None:
    for world, share in ((small, 0.0), (stretched(small), STRETCHED)):
        [result] = solve_rows([constrained(world, None)], [list(range(len(world.facts.frames)))])
        assert isinstance(result, Solution)
        assert result.vertical_scale is not None
        assert result.vertical_scale.sigma < 0.2 * STRETCHED
        assert result.vertical_scale.share == pytest.approx(share, abs=4 * result.vertical_scale.sigma)
        assert result.report["elevations, percent"] == pytest.approx(100 * result.vertical_scale.share)
    [asked] = solve_rows(
        [constrained(small, Calibration(vertical=VerticalScale()))], [list(range(len(small.facts.frames)))]
    )
    assert isinstance(asked, Solution)
    assert asked.vertical_scale is None


@pytest.mark.slow
@pytest.mark.parametrize(("turn", "bent_deg"), [(0.0, 20.0), (60.0, 5.0), (-40.0, 20.0)])
def test_lenses_that_stand_apart_are_found(small: made.World, turn: float, bent_deg: float) -> None:
    good = solved(small, None)
    spoilt = bent(small, good, Bend("", turn, bent_deg))
    [plain] = solve_rows([constrained(spoilt, None)], [list(range(len(small.facts.frames)))])
    assert isinstance(plain, Solution)
    assert plain.lens_distance is not None
    assert plain.lens_distance.significant
    assert plain.report["lens distance, cm"] == pytest.approx(100 * plain.lens_distance.distance_m)
    found = solved(spoilt, Calibration(lens_distance=LensDistance()))
    assert error(small, found) < max(0.6 * error(small, plain), 1.5 * error(small, good))
    if turn == 0:
        assert plain.lens_distance.distance_m == pytest.approx(APART_M, abs=4 * plain.lens_distance.sigma_m)
        parts = [float(found.report[f"calibration {name}, cm"]) for name in LENS_DISTANCES]
        assert BENDS[int(np.argmax(parts))].half_width_deg == bent_deg
        total = float(found.report["calibration lens distance, cm"])
        assert total == pytest.approx(100 * APART_M, abs=4 * float(found.report["calibration lens distance, sigma cm"]))


@pytest.mark.slow
def test_a_corrected_baseline_is_not_taken_for_a_stretch(small: made.World) -> None:
    """The test of what the calibration leaves open begins with what it corrected, not with its usual values on top."""
    spoilt = bent(small, solved(small, None), Bend("", 0.0, 20.0))
    problem = constrained(spoilt, Calibration(lens_distance=LensDistance()))
    [asked] = solve_rows([problem], [list(range(len(small.facts.frames)))])
    assert isinstance(asked, Solution)
    assert asked.vertical_scale is not None
    assert abs(asked.vertical_scale.share) < max(4 * asked.vertical_scale.sigma, 0.1 * STRETCHED)


def test_where_rays_are_seen_from() -> None:
    """The camera goes along the rig's x; its front lens looks there, and the seam is across."""
    drive = drive_axes(np.tile(np.diag([1.0, 1.0, 1.0, 1.0]), (3, 1, 1)), np.tile([2.0, 0.0, 0.0], (3, 1)))
    np.testing.assert_allclose(drive, [[1, 0, 0], [0, 0, 1], [0, 1, 0]], atol=1e-12)
    rays = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 0, 1], [np.sin(np.radians(5)), 0, np.cos(np.radians(5))]])
    along = Bend("", 0.0, 10.0).points_of_view(rays, drive)
    np.testing.assert_allclose(along, [[0.5, 0, 0], [-0.5, 0, 0], [0, 0, 0], [0.25, 0, 0]], atol=1e-12)
    upwards = Bend("", 0.0, 10.0, upwards=True).points_of_view(rays, drive)
    np.testing.assert_allclose(upwards[:, 1], along[:, 0], atol=1e-12)
    np.testing.assert_allclose(Bend("", 90.0, 10.0).baseline(drive), [0, 0, 1], atol=1e-12)


def test_parts_of_a_baseline_that_cancel_still_bend() -> None:
    parts = np.array([0.02, -0.02, 0.0, 0.0, 0.0])
    assert total_baseline(parts, np.eye(5))[0] == pytest.approx(0.0)
    assert largest_displacement(parts) == pytest.approx(0.0075)


@pytest.mark.slow
def test_what_the_calibration_estimates_is_not_tested_again(small: made.World) -> None:
    frames = [list(range(len(small.facts.frames)))]
    [plain] = solve_rows([constrained(small, None)], frames)
    [asked] = solve_rows([constrained(small, Calibration(lens_distance=LensDistance(), shutter=Shutter()))], frames)
    assert isinstance(plain, Solution)
    assert isinstance(asked, Solution)
    assert plain.lens_distance is not None
    assert not plain.lens_distance.significant
    assert asked.lens_distance is None
    assert asked.vertical_scale is not None


def test_without_a_term_nothing_changes(small: made.World) -> None:
    plain, empty = solved(small, None), solved(small, Calibration())
    assert np.array_equal(plain.covariance.points, empty.covariance.points)
    for name, landmark in plain.landmarks_of("shelves").items():
        assert np.array_equal(landmark.position, empty.landmarks_of("shelves")[name].position)
    assert plain.report == empty.report
    assert not any("calibrat" in name for name in plain.report)


@pytest.mark.parametrize("axis", ["rows", "columns"])
def test_moves_are_the_derivatives_of_pixels(small: made.World, axis: Literal["rows", "columns"]) -> None:
    view = small.facts.views["face"]
    rng = np.random.default_rng(3)
    pixels = rng.uniform([0, 0], [639, 479], (200, 2))
    lenses = Lenses(*(np.tile(part, (200, *np.ones(np.ndim(part), int))) for part in lens(view)))
    points = rng.uniform(1, 3, (200, 1)) * view.rig_rays(pixels)
    drive = np.array([[0.6, 0.0, 0.8], [0.8, 0.0, -0.6], [0.0, -1.0, 0.0]])
    scene = Scene(points, rng.normal(size=(200, 3)), rng.normal(size=(200, 3)), drive)

    shutter, stitching = Shutter(axis=axis), Stitching(blend_deg=BLEND_DEG)
    term = Calibration(stitching, shutter, SEAM_AHEAD, VerticalScale(), LensDistance())

    def at(values: Floats) -> tuple[Floats, Floats]:
        return Distortion(lenses, pixels, values, scene, term)(pixels)

    values = 1e-3 * np.array([1.0, -1.0, 0.5, 0.2, -0.2, 2.0, 3.0, -2.0, 1.0, 2.0, -1.0, 1.0])
    _, moves = at(values)
    for number, step in enumerate(1e-6 * np.eye(12)):
        slope = (at(values - step)[0] - at(values + step)[0]) / 2e-6
        np.testing.assert_allclose(slope, moves[:, :, number], rtol=0.01, atol=0.5)


def lens(view: ViewSpec) -> tuple[Floats, Floats, Floats]:
    return view.rig_from_view, np.diag(view.camera)[:2], view.camera[:2, 2]


def test_velocities_of_a_camera_that_turns_as_it_goes() -> None:
    stamps = np.array([0.0, 0.1, 0.2, 0.4])
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = 1.5 * stamps
    poses[:, :3, :3] = Rotation.from_rotvec(np.outer(stamps, [0.0, 0.3, 0.0])).as_matrix()
    speeds, rates = velocities(poses, stamps)
    np.testing.assert_allclose(speeds, np.tile([1.5, 0, 0], (4, 1)), atol=1e-9)
    np.testing.assert_allclose(rates, np.tile([0, 0.3, 0], (4, 1)), atol=1e-9)
    assert not velocities(poses, np.zeros(4))[0].any()
