"""Rays, angles, projections, poses and matches: there and back, lengths kept, for all cameras, rays and poses."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from savmap.geometry import pinhole, sphere
from savmap.geometry.matching import matched
from savmap.geometry.poses import poses_at
from savmap.geometry.triangulate import midway, nearest_point, nearest_points
from savmap.types import Floats, ViewSpec

SHARES = arrays(np.float64, (5, 2), elements=st.floats(0.001, 0.999))
DEGREES = st.floats(-180, 180)
POINTS = arrays(np.float64, (4, 3), elements=st.floats(-100, 100))
TURNS = st.tuples(*(4 * [st.floats(-1, 1)])).filter(lambda turn: np.linalg.norm(turn) > 0.1)


def difference(a: Floats, b: Floats) -> float:
    """The largest difference between two arrays."""
    return float(np.abs(a - b).max())


def test_directions_of_the_rig() -> None:
    centre_right_up = np.array([[0.0, 0, 1], [1, 0, 0], [0, -1, 0]])
    pixels = sphere.panorama_pixels_from_rays(centre_right_up, 256)
    assert np.allclose(pixels[:2], [[255.5, 127.5], [383.5, 127.5]])
    assert pixels[2, 1] == pytest.approx(-0.5)


def test_field_of_view_lies_between_the_outer_borders() -> None:
    spec = ViewSpec("a", 0, hfov_deg=100)
    left, right = spec.rig_rays(np.array([[-0.5, 239.5], [639.5, 239.5]]))
    assert np.degrees(np.arccos(left @ right)) == pytest.approx(100)


def test_points_behind_have_no_pixel() -> None:
    assert np.isnan(pinhole.project(np.array([[0.0, 0, -1], [1, 1, 0]]), np.eye(3))).all()


@given(SHARES, st.integers(2, 8192))
def test_panorama_pixels_come_back_from_their_rays(shares: Floats, height: int) -> None:
    pixels = shares * [2 * height, height] - 0.5
    rays = sphere.rays_from_panorama_pixels(pixels, height)
    assert difference(np.linalg.norm(rays, axis=1), np.ones(5)) < 1e-12
    assert difference(sphere.panorama_pixels_from_rays(7.5 * rays, height), pixels) < 1e-6


@given(SHARES, st.floats(20.1, 169.9), st.integers(64, 4096), st.integers(64, 4096))
def test_view_pixels_come_back_from_their_rays(shares: Floats, hfov: float, width: int, height: int) -> None:
    camera, pixels = pinhole.intrinsics(hfov, width, height), shares * [width, height] - 0.5
    assert difference(pinhole.project(3.0 * pinhole.rays_from_pixels(pixels, camera), camera), pixels) < 1e-5


@given(DEGREES, st.one_of(st.floats(-89, 89), st.sampled_from([90.0, -90.0])), DEGREES)
def test_angles_come_back_from_rotations(yaw: float, pitch: float, roll: float) -> None:
    turn = pinhole.rig_from_view(yaw, pitch, roll)
    assert difference(turn @ turn.T, np.eye(3)) < 1e-12
    assert np.linalg.det(turn) > 0
    angles = pinhole.angles_from_rotation(turn)
    assert difference(pinhole.rig_from_view(*angles), turn) < (1e-9 if abs(pitch) < 90 else 1e-6)


@given(POINTS, st.tuples(*(3 * [st.floats(-50, 50)])))
def test_rays_from_anywhere_meet_in_their_point(origins: Floats, point: tuple[float, float, float]) -> None:
    directions = np.array(point) - origins
    assume((np.linalg.norm(directions, axis=1) > 0.5).all())
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    assume(np.linalg.cond((np.eye(3) - unit[:, :, None] * unit[:, None, :]).sum(axis=0)) < 1e4)
    assert difference(nearest_point(origins, directions), np.array(point)) < 1e-4
    assume(np.linalg.norm(np.cross(unit[0], unit[1])) > 0.1)
    assert difference(midway(origins[0], unit[0], origins[1], unit[1]), np.array(point)) < 1e-6


def test_midway_between_two_lines_is_nearest_to_both() -> None:
    origins, rays = np.random.default_rng(3).normal(size=(2, 2, 5, 3))
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    expected = [nearest_points(origins[:, pair], rays[None, :, pair])[0] for pair in range(5)]
    assert difference(midway(origins[0], rays[0], origins[1], rays[1]), np.array(expected)) < 1e-6


def poses(turns: Floats, positions: Floats) -> Floats:
    matrices = np.tile(np.eye(4), (len(turns), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = turns, positions
    return matrices


def test_rotations_are_interpolated_on_the_sphere_and_positions_linearly() -> None:
    """Before the first and after the last they are held."""

    def turned(*degrees: float) -> Floats:
        return Rotation.from_euler("y", np.array(degrees)[:, None], degrees=True).as_matrix()

    given_poses = poses(turned(0, 90, 120), np.array([[0, 0, 0], [2.0, 0, 0], [2, 4, 0]]))
    between = poses_at(np.array([0.0, 3.0, 4.5, 9.0]), np.array([2.0, 4.0, 5.0]), given_poses)
    expected = poses(turned(0, 45, 105, 120), np.array([[0, 0, 0], [1.0, 0, 0], [2, 2, 0], [2, 4, 0]]))
    np.testing.assert_allclose(between, expected, atol=1e-12)
    held = poses_at(np.array([1.0, 2.0, 3.0]), np.array([2.0]), given_poses[:1])
    np.testing.assert_array_equal(held, np.repeat(given_poses[:1], 3, axis=0))
    assert poses_at(np.zeros(0), np.array([2.0]), given_poses[:1]).shape == (0, 4, 4)


@given(TURNS, TURNS, POINTS, st.lists(st.floats(-5, 15), min_size=1, max_size=6))
def test_poses_between_poses_are_poses(
    first: tuple[float, ...], second: tuple[float, ...], at: Floats, wanted: list[float]
) -> None:
    ends = poses(Rotation.from_quat([first, second]).as_matrix(), at[:2])
    between = poses_at(np.array(wanted), np.array([0.0, 10.0]), ends)
    turns = between[:, :3, :3]
    assert difference(turns @ turns.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turns.shape)) < 1e-9
    low, high = at[:2].min(axis=0) - 1e-9, at[:2].max(axis=0) + 1e-9
    assert ((between[:, :3, 3] >= low) & (between[:, :3, 3] <= high)).all()
    assert difference(poses_at(np.array([0.0, 10.0]), np.array([0.0, 10.0]), ends), ends) < 1e-9


@given(
    arrays(np.float64, st.tuples(st.integers(0, 5), st.integers(0, 5)), elements=st.floats(0, 10)), st.floats(0.1, 10)
)
def test_matches_are_one_to_one_and_cheap(costs: Floats, limit: float) -> None:
    pairs = matched(costs, limit)
    assert len(set(pairs.values())) == len(pairs)
    assert all(costs[row, column] < limit for row, column in pairs.items())


@pytest.mark.parametrize(
    ("costs", "limit", "pairs"),
    [
        ([[0.1, 0.9], [5.0, 0.2]], 1.0, {0: 0, 1: 1}),
        ([[0.1, 0.9], [0.2, 5.0]], 1.0, {0: 1, 1: 0}),  # more pairs count more than a smaller sum
        ([[1.0, 0.5], [0.6, 2.0], [0.7, 0.8]], 1.0, {0: 1, 1: 0}),
        ([[1.0]], 1.0, {}),  # the limit itself is too much
        ([[-2.0, -1.5], [-1.8, 0.5]], 0.0, {0: 1, 1: 0}),  # gains are negative costs
    ],
)
def test_as_many_pairs_as_there_can_be_then_the_least_sum(
    costs: list[list[float]], limit: float, pairs: dict[int, int]
) -> None:
    assert matched(np.array(costs), limit) == pairs
