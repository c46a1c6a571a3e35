"""Rays, angles and projections invert one another."""

import numpy as np
import pytest

from savmap.geometry import pinhole, sphere
from savmap.types import ViewSpec


def test_panorama_pixels_and_rays_invert_one_another() -> None:
    pixels = np.random.default_rng(0).uniform([-0.49, 0.0], [511.49, 255.0], (1000, 2))
    rays = sphere.rays_from_panorama_pixels(pixels, 256)
    assert np.allclose(np.linalg.norm(rays, axis=1), 1)
    assert np.allclose(sphere.panorama_pixels_from_rays(3 * rays, 256), pixels)


def test_directions_of_the_rig() -> None:
    centre_right_up = np.array([[0.0, 0, 1], [1, 0, 0], [0, -1, 0]])
    pixels = sphere.panorama_pixels_from_rays(centre_right_up, 256)
    assert np.allclose(pixels[:2], [[255.5, 127.5], [383.5, 127.5]])
    assert pixels[2, 1] == pytest.approx(-0.5)


@pytest.mark.parametrize("seed", range(20))
def test_angles_and_rotations_invert_one_another(seed: int) -> None:
    yaw, pitch, roll = np.random.default_rng(seed).uniform([-180, -89.9, -180], [180, 89.9, 180])
    rotation = pinhole.rig_from_view(yaw, pitch, roll)
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert pinhole.angles_from_rotation(rotation) == pytest.approx((yaw, pitch, roll), abs=1e-6)


@pytest.mark.parametrize("pitch", [90.0, -90.0])
@pytest.mark.parametrize("yaw", [-120.0, 0.0, 35.0])
@pytest.mark.parametrize("roll", [0.0, 50.0])
def test_angles_at_the_poles_give_the_same_rotation(pitch: float, yaw: float, roll: float) -> None:
    rotation = pinhole.rig_from_view(yaw, pitch, roll)
    assert np.allclose(pinhole.rig_from_view(*pinhole.angles_from_rotation(rotation)), rotation, atol=1e-7)


def test_view_pixels_and_rays_invert_one_another() -> None:
    spec = ViewSpec("a", 30, -20, 10, 120)
    pixels = np.random.default_rng(1).uniform([-0.5, -0.5], [639.5, 479.5], (500, 2))
    assert np.allclose(pinhole.project(spec.rig_rays(pixels) @ spec.rig_from_view, spec.camera), pixels)


def test_field_of_view_lies_between_the_outer_borders() -> None:
    spec = ViewSpec("a", 0, hfov_deg=100)
    left, right = spec.rig_rays(np.array([[-0.5, 239.5], [639.5, 239.5]]))
    assert np.degrees(np.arccos(left @ right)) == pytest.approx(100)


def test_points_behind_have_no_pixel() -> None:
    assert np.isnan(pinhole.project(np.array([[0.0, 0, -1], [1, 1, 0]]), np.eye(3))).all()
