"""Building axes and frame orientation out of straight edges made from known directions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.geometry import pinhole
from savmap.geometry.vanishing import facing, manhattan_from_segments, orientation_from_edges, rotation_from_vector

LEVEL = np.diag([1.0, -1.0, -1.0])


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(Rotation.from_matrix(a @ b.T).magnitude()))


def segments(rig_from_world: np.ndarray, counts: tuple[int, int, int], clutter: int, sigma: float, seed: int):
    """Ends (n, 3) each of segments along the axes and of clutter, with noise across, and the axes (n,), -1 for clutter."""
    rng = np.random.default_rng(seed)
    axes = np.repeat([0, 1, 2, -1], [*counts, clutter])
    directions = np.where(axes[:, None] >= 0, np.eye(3)[axes], unit(rng.normal(size=(len(axes), 3))))
    middle = unit(rng.normal(size=(len(axes), 3))) * rng.uniform(2, 8, (len(axes), 1))
    half = directions * rng.uniform(0.3, 1.5, (len(axes), 1))
    noisy = [unit(unit(end) + rng.normal(size=end.shape) * sigma) for end in (middle - half, middle + half)]
    return noisy[0] @ rig_from_world.T, noisy[1] @ rig_from_world.T, axes


def rotation(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """rig_from_world of a camera turned so, which faces the row when not turned."""
    return pinhole.rig_from_view(yaw, pitch, roll).T @ LEVEL


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("tilt", [0.0, 10.0, 35.0])
def test_manhattan_is_found_whichever_way_the_camera_is_turned(seed: int, tilt: float) -> None:
    rng = np.random.default_rng(100 + seed)
    away = rng.uniform(-np.pi, np.pi)
    true = rotation(rng.uniform(-180, 180), tilt * np.cos(away), tilt * np.sin(away))
    rays_a, rays_b, _ = segments(true, (60, 40, 8), 60, np.radians(0.1), seed)
    found = manhattan_from_segments(rays_a, rays_b)
    assert found is not None
    assert degrees_between(found.rig_from_manhattan, facing(true, true[:, 1], np.array([0.0, 0, -1]))) < 0.3
    assert 0.4 < found.support < 0.95
    assert found.rig_from_manhattan[1, 1] < 0
    assert np.linalg.det(found.rig_from_manhattan) == pytest.approx(1)


def test_manhattan_refines_from_a_start_and_keeps_its_names() -> None:
    true = rotation(140, 20, -5)
    rays_a, rays_b, _ = segments(true, (30, 30, 0), 20, np.radians(0.1), 3)
    start = rotation_from_vector(np.radians([2.0, -1.5, 2.0])) @ true
    found = manhattan_from_segments(rays_a, rays_b, start)
    assert found is not None
    assert degrees_between(found.rig_from_manhattan, true) < 0.3
    assert manhattan_from_segments(rays_a[:5], rays_b[:5]) is None, "too few segments"


def test_facing_names_axes() -> None:
    shuffled = LEVEL[:, [2, 0, 1]] * [1, -1, 1]
    assert np.allclose(facing(shuffled, np.array([0.0, -1, 0]), np.array([0.1, 0, -1])), LEVEL)


@pytest.mark.parametrize("seed", range(5))
def test_orientation_survives_outliers_and_a_poor_start(seed: int) -> None:
    true = rotation(3, -2, 1)
    rays_a, rays_b, axes = segments(true, (25, 12, 0), 0, np.radians(0.05), seed)
    wrong = np.random.default_rng(seed).random(len(axes)) < 0.15
    axes = np.where(wrong, 1 - axes, axes)
    start = (rotation_from_vector(np.radians([4.0, -3.0, 5.0])) @ true).T
    found = orientation_from_edges(rays_a, rays_b, axes, np.full(len(axes), np.radians(0.05)), start)
    assert degrees_between(found.world_from_rig, true.T) < 0.35


def test_orientation_information_is_honest() -> None:
    """Errors over many draws are as large as the information says."""
    true, squares = rotation(10, 5, 0), []
    for seed in range(200):
        rays_a, rays_b, axes = segments(true, (12, 8, 0), 0, np.radians(0.1), seed)
        found = orientation_from_edges(rays_a, rays_b, axes, np.full(len(axes), np.radians(0.1)), true.T)
        error = Rotation.from_matrix(found.world_from_rig.T @ true.T).as_rotvec()
        squares.append(error @ found.information @ error / 3)
    assert 0.5 < np.mean(squares) < 2.0


def test_orientation_about_an_axis_nobody_shows_stays() -> None:
    true = rotation(0, 0, 0)
    rays_a, rays_b, axes = segments(true, (0, 20, 0), 0, np.radians(0.05), 1)
    found = orientation_from_edges(rays_a, rays_b, axes, np.full(20, np.radians(0.05)), rotation(0, 3, 0).T)
    assert degrees_between(found.world_from_rig, true.T) < 0.3
    assert np.linalg.eigvalsh(found.information)[0] < 1
