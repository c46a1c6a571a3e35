"""The motion of a camera from rays, some of which are wrong."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.geometry.motion import AGREES, resected, two_views

SIGMA = 0.002


def unit(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def scattered(count: int, rng: np.random.Generator) -> np.ndarray:
    """Points (count, 3) 2 to 8 m off, all around."""
    return unit(rng.normal(size=(count, 3))) * rng.uniform(2, 8, (count, 1))


def pose(turn: list[float], position: list[float]) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), position
    return result


def rays(points: np.ndarray, camera: np.ndarray, rng: np.random.Generator, sigma: float = SIGMA) -> np.ndarray:
    """Unit rays (n, 3) in the frame of a camera, with noise."""
    towards = unit((points - camera[:3, 3]) @ camera[:3, :3])
    return unit(towards + sigma * rng.normal(size=towards.shape))


def turned_by(a: np.ndarray, b: np.ndarray) -> float:
    """The angle between two poses, radians."""
    return float(Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).magnitude())


@pytest.mark.parametrize("turn", [[0.0, 0.0, 0.0], [0.05, 0.6, -0.1], [0.0, 2.8, 0.3]], ids=["ahead", "turn", "back"])
@pytest.mark.parametrize("position", [[0.0, 0.0, 0.4], [-0.5, 0.1, -0.2]], ids=["ahead", "aside"])
def test_two_views_finds_the_motion_among_outliers(turn: list[float], position: list[float]) -> None:
    rng = np.random.default_rng(5)
    true, points, wrong = pose(turn, position), scattered(200, rng), np.arange(60)
    first, second = rays(points, np.eye(4), rng), rays(points, true, rng)
    second[wrong] = unit(rng.normal(size=(len(wrong), 3)))
    found, agrees = two_views(first, second, SIGMA)
    assert turned_by(found, true) < 2 * SIGMA
    assert np.linalg.norm(found[:3, 3]) == pytest.approx(1)
    assert np.degrees(np.arccos(found[:3, 3] @ unit(true[:3, 3]))) < 2.0
    assert agrees[60:].mean() > 0.97
    assert agrees[wrong].mean() < 0.1


def test_two_views_gives_the_same_for_the_same_seed() -> None:
    rng = np.random.default_rng(6)
    points, true = scattered(50, rng), pose([0.1, 0.2, 0.0], [0.3, 0.0, 0.1])
    first, second = rays(points, np.eye(4), rng), rays(points, true, rng)
    (found, agrees), (again, same) = two_views(first, second, SIGMA, 4), two_views(first, second, SIGMA, 4)
    np.testing.assert_array_equal(found, again)
    np.testing.assert_array_equal(agrees, same)
    assert turned_by(two_views(first, second, SIGMA, 5)[0], true) < SIGMA


def test_resected_finds_the_pose_among_outliers() -> None:
    rng = np.random.default_rng(7)
    true, points = pose([0.1, 1.0, -0.2], [0.4, -0.1, 0.7]), scattered(150, rng)
    seen = rays(points, true, rng)
    seen[:50] = unit(seen[:50] + rng.normal(0, 0.2, (50, 3)))
    start = pose([0.12, 0.97, -0.18], [0.3, -0.1, 0.65])
    before = start.copy()
    found, _, off = resected(points, seen, start, SIGMA)
    assert turned_by(found, true) < 0.5 * SIGMA
    assert np.linalg.norm(found[:3, 3] - true[:3, 3]) < 0.005
    assert (off[50:] < AGREES * SIGMA).mean() > 0.97
    assert (off[:50] < AGREES * SIGMA).mean() < 0.1
    np.testing.assert_array_equal(start, before)


def test_resected_covariance_is_as_large_as_errors_are() -> None:
    rng = np.random.default_rng(8)
    true, points = pose([0.0, 0.5, 0.1], [0.2, 0.0, 0.3]), scattered(60, rng)
    errors, said = [], []
    for _ in range(100):
        found, covariance, _ = resected(points, rays(points, true, rng), true, SIGMA)
        turn = Rotation.from_matrix(true[:3, :3].T @ found[:3, :3]).as_rotvec()
        errors.append(np.append(turn, found[:3, 3] - true[:3, 3]))
        said.append(np.sqrt(np.diag(covariance)))
    ratio = np.std(errors, axis=0) / np.mean(said, axis=0)
    assert (ratio > 0.6).all()
    assert (ratio < 1.3).all(), "errors are larger than the covariance says"
    assert np.abs(np.mean(errors, axis=0) / np.std(errors, axis=0)).max() < 0.3
