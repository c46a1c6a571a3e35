"""Poses between known ones."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.geometry.poses import columns_at, poses_at, rotations_at

KNOWN = np.array([2.0, 4.0, 5.0])


def turned(*degrees: float) -> np.ndarray:
    return Rotation.from_euler("y", np.array(degrees)[:, None], degrees=True).as_matrix()


def test_rotations_are_interpolated_on_the_sphere() -> None:
    found = rotations_at(np.array([0.0, 3.0, 4.5, 9.0]), KNOWN, turned(0, 90, 120))
    np.testing.assert_allclose(found, turned(0, 45, 105, 120), atol=1e-12)


def test_one_known_rotation_is_held_everywhere() -> None:
    found = rotations_at(np.array([1.0, 2.0, 3.0]), np.array([2.0]), turned(30))
    np.testing.assert_array_equal(found, np.repeat(turned(30), 3, axis=0))


def test_columns_are_interpolated_linearly() -> None:
    values = np.array([[0.0, 1.0], [2.0, 3.0], [2.0, -1.0]])
    found = columns_at(np.array([3.0, 4.5, 6.0]), KNOWN, values)
    assert found.tolist() == [[1.0, 2.0], [2.0, 1.0], [2.0, -1.0]]


@pytest.mark.parametrize("wanted", [[], [2.0, 3.0, 5.0]])
def test_poses_have_interpolated_rotations_and_positions(wanted: list[float]) -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = turned(0, 90, 120), np.array([[0, 0, 0], [2.0, 0, 0], [2, 4, 0]])
    found = poses_at(np.array(wanted), KNOWN, poses)
    assert found.shape == (len(wanted), 4, 4)
    if wanted:
        np.testing.assert_allclose(found[1, :3, :3], turned(45)[0], atol=1e-12)
        assert found[:, :3, 3].tolist() == [[0, 0, 0], [1, 0, 0], [2, 4, 0]]
        assert found[:, 3].tolist() == [[0, 0, 0, 1]] * 3
