"""Orientation of a row of frames from edges with a known axis."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.geometry import pinhole
from savmap.types import Feature, ViewSpec
from savmap.vision.attitude import attitudes

FRAMES = 30
LEVEL = np.diag([1.0, -1.0, -1.0])
VIEWS = {"face": ViewSpec("face", 15, 5, 3, 120), "side": ViewSpec("side", -50, 0, 0, 90)}
NOMINAL = (VIEWS["face"].rig_from_view @ LEVEL).T


def sway(frame: int) -> np.ndarray:
    """True world_from_rig of a frame."""
    turn = np.radians([2 * np.sin(frame / 4), 3 * np.sin(frame / 7), 1.5 * np.cos(frame / 5)])
    return Rotation.from_rotvec(turn).as_matrix() @ NOMINAL


def edges(frame: int, rng: np.random.Generator, axes: str = "xy", noise_px: float = 0.4) -> list[Feature]:
    """Edges of a face 1.5 m away in both views, with noise across and a covariance long along them."""
    found = []
    for name, spec in VIEWS.items():
        view_from_world = (sway(frame) @ spec.rig_from_view).T
        for axis in rng.permutation(list(axes * 6)):
            middle = np.array([rng.uniform(-1.5, 1.5), rng.uniform(-1.5, 1.5), -1.5])
            half = 0.8 * np.eye(3)["xyz".index(axis)]
            pixels = pinhole.project(np.stack([middle - half, middle + half]) @ view_from_world.T, spec.camera)
            if not np.isfinite(pixels).all() or np.abs(pixels).max() > 2000:
                continue
            along = (pixels[1] - pixels[0]) / np.linalg.norm(pixels[1] - pixels[0])
            across = np.array([-along[1], along[0]])
            pixels = pixels + rng.normal(0, noise_px, (2, 1)) * across + rng.normal(0, 50, (2, 1)) * along
            covariance = noise_px**2 * np.outer(across, across) + 200**2 * np.outer(along, along)
            found.append(Feature(frame, name, "edge", "", len(found), pixels, np.stack([covariance] * 2), axis))
    return found


def errors_deg(found: np.ndarray) -> np.ndarray:
    return np.array([np.degrees(Rotation.from_matrix(found[i].T @ sway(i)).magnitude()) for i in range(len(found))])


@pytest.fixture
def start() -> np.ndarray:
    return np.tile(Rotation.from_rotvec(np.radians([3, -4, 2])).as_matrix() @ NOMINAL, (FRAMES, 1, 1))


def test_every_frame_is_found(start: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    features = [edge for frame in range(FRAMES) for edge in edges(frame, rng)]
    error = errors_deg(attitudes(features, VIEWS, start))
    assert np.median(error) < 0.15
    assert error.max() < 0.5


def test_outliers_are_borne(start: np.ndarray) -> None:
    rng = np.random.default_rng(1)
    features = [edge for frame in range(FRAMES) for edge in edges(frame, rng)]
    wrong = [
        Feature(f, "face", "edge", "", 99, rng.uniform(0, 400, (2, 2)), np.tile(np.eye(2), (2, 1, 1)), "x")
        for f in range(FRAMES)
        for _ in range(2)
    ]
    assert errors_deg(attitudes(features + wrong, VIEWS, start)).max() < 0.6


def test_frames_without_enough_edges_are_interpolated(start: np.ndarray) -> None:
    rng = np.random.default_rng(2)
    features = []
    for frame in range(FRAMES):
        axes = {11: "y", 12: "y", 13: "x"}.get(frame, "xy")
        features += [] if frame in (0, 5, 29) else edges(frame, rng, axes)
    assert errors_deg(attitudes(features, VIEWS, start)).max() < 1.0


def test_nothing_to_go_by(start: np.ndarray) -> None:
    points = [Feature(0, "face", "a", "", 0, np.zeros((1, 2)), np.eye(2)[None])]
    assert np.allclose(attitudes(points, VIEWS, start), start)
