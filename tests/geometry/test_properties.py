"""Geometry that holds for all cameras, rays and poses: there and back, lengths kept, what is on a line stays on it."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from savmap.geometry.matching import matched
from savmap.geometry.pinhole import angles_from_rotation, intrinsics, project, rays_from_pixels, rig_from_view
from savmap.geometry.poses import poses_at
from savmap.geometry.sphere import panorama_pixels_from_rays, rays_from_panorama_pixels
from savmap.geometry.triangulate import midway, nearest_point
from savmap.types import Floats

HEIGHTS = st.integers(2, 8192)
SHARES = arrays(np.float64, (5, 2), elements=st.floats(0.001, 0.999))
DEGREES = st.floats(-180, 180)
POINTS = arrays(np.float64, (4, 3), elements=st.floats(-100, 100))
TURNS = st.tuples(*(4 * [st.floats(-1, 1)])).filter(lambda turn: np.linalg.norm(turn) > 0.1)


def apart(one: Floats, other: Floats) -> float:
    """The largest difference between two arrays."""
    return float(np.abs(one - other).max())


@given(SHARES, HEIGHTS)
def test_panorama_pixels_come_back_from_their_rays(shares: Floats, height: int) -> None:
    pixels = shares * [2 * height, height] - 0.5
    rays = rays_from_panorama_pixels(pixels, height)
    assert apart(np.linalg.norm(rays, axis=1), np.ones(5)) < 1e-12
    assert apart(panorama_pixels_from_rays(7.5 * rays, height), pixels) < 1e-6


@given(SHARES, st.floats(20.1, 169.9), st.integers(64, 4096), st.integers(64, 4096))
def test_view_pixels_come_back_from_their_rays(shares: Floats, hfov: float, width: int, height: int) -> None:
    camera, pixels = intrinsics(hfov, width, height), shares * [width, height] - 0.5
    assert apart(project(3.0 * rays_from_pixels(pixels, camera), camera), pixels) < 1e-5


@given(DEGREES, st.floats(-89, 89), DEGREES)
def test_angles_come_back_from_rotations(yaw: float, pitch: float, roll: float) -> None:
    turn = rig_from_view(yaw, pitch, roll)
    assert apart(turn @ turn.T, np.eye(3)) < 1e-12
    assert np.linalg.det(turn) > 0
    assert apart(rig_from_view(*angles_from_rotation(turn)), turn) < 1e-9


@given(DEGREES, st.sampled_from([90.0, -90.0]), DEGREES)
def test_views_straight_up_come_back_as_rotations(yaw: float, pitch: float, roll: float) -> None:
    turn = rig_from_view(yaw, pitch, roll)
    assert apart(rig_from_view(*angles_from_rotation(turn)), turn) < 1e-6


@given(POINTS, st.tuples(*(3 * [st.floats(-50, 50)])))
def test_rays_from_anywhere_meet_in_their_point(origins: Floats, point: tuple[float, float, float]) -> None:
    directions = np.array(point) - origins
    assume((np.linalg.norm(directions, axis=1) > 0.5).all())
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    assume(np.linalg.cond((np.eye(3) - unit[:, :, None] * unit[:, None, :]).sum(axis=0)) < 1e4)
    assert apart(nearest_point(origins, directions), np.array(point)) < 1e-4
    assume(np.linalg.norm(np.cross(unit[0], unit[1])) > 0.1)
    assert apart(midway(origins[0], unit[0], origins[1], unit[1]), np.array(point)) < 1e-6


@given(TURNS, TURNS, POINTS, st.lists(st.floats(-5, 15), min_size=1, max_size=6))
def test_poses_between_poses_are_poses(
    one: tuple[float, ...], two: tuple[float, ...], at: Floats, wanted: list[float]
) -> None:
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, :3] = Rotation.from_quat([one, two]).as_matrix()
    poses[:, :3, 3] = at[:2]
    between = poses_at(np.array(wanted), np.array([0.0, 10.0]), poses)
    turns = between[:, :3, :3]
    assert apart(turns @ turns.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turns.shape)) < 1e-9
    low, high = at[:2].min(axis=0) - 1e-9, at[:2].max(axis=0) + 1e-9
    assert ((between[:, :3, 3] >= low) & (between[:, :3, 3] <= high)).all()
    assert apart(poses_at(np.array([0.0, 10.0]), np.array([0.0, 10.0]), poses), poses) < 1e-9


@given(
    arrays(np.float64, st.tuples(st.integers(0, 5), st.integers(0, 5)), elements=st.floats(0, 10)), st.floats(0.1, 10)
)
def test_matches_are_one_to_one_and_cheap(costs: Floats, limit: float) -> None:
    pairs = matched(costs, limit)
    assert len(set(pairs.values())) == len(pairs)
    assert all(costs[row, column] < limit for row, column in pairs.items())
