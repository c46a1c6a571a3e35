"""Camera models: there and back, and what they do not see."""

import cv2
import numpy as np
import pytest

from savmap.geometry.cameras import Camera, Equirectangular, Fisheye, FisheyePair, Pinhole

LENS = Fisheye.of_hfov(400, 400, 190.0)
CAMERAS: dict[str, Camera] = {
    "panorama": Equirectangular(256),
    "pinhole": Pinhole.of_hfov(640, 360, 75.0),
    "distorted": Pinhole(640, 480, (500.0, 510.0), (320.0, 235.0), (-0.25, 0.08, 0.001, -0.0005, 0.0)),
    "fisheye": LENS,
    "bent fisheye": Fisheye(800, 800, (250.0, 252.0), (399.5, 401.0), (0.02, -0.01, 0.003, -0.0005), 200.0),
    "pair": FisheyePair(LENS, LENS, np.eye(3), np.diag([-1.0, 1.0, -1.0])),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_rays_and_pixels_lead_back_to_one_another(name: str) -> None:
    camera, rng = CAMERAS[name], np.random.default_rng(1)
    rays = rng.normal(size=(3000, 3))
    pixels = camera.pixels(rays)
    seen = np.isfinite(pixels[:, 0])
    assert seen.any()
    back = camera.rays(pixels[seen])
    assert np.linalg.norm(back, axis=1) == pytest.approx(1.0)
    np.testing.assert_allclose(back, rays[seen] / np.linalg.norm(rays[seen], axis=1, keepdims=True), atol=1e-6)
    assert ((pixels[seen] >= -0.5) & (pixels[seen] < [camera.width - 0.5, camera.height - 0.5])).all()


def test_distortion_is_that_of_opencv() -> None:
    terms = (-0.25, 0.08, 0.001, -0.0005, 0.02, 0.01, -0.03, 0.005)
    camera, rng = Pinhole(640, 480, (500.0, 510.0), (320.0, 235.0), terms), np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-0.5, 0.5, (200, 2)), np.ones(200)])
    still, matrix = np.zeros(3), np.array([[500.0, 0, 320], [0, 510, 235], [0, 0, 1]])
    true = cv2.projectPoints(points, still, still, matrix, np.array(terms))[0][:, 0]
    np.testing.assert_allclose(camera.pixels(points), true, atol=1e-9)


def test_a_pinhole_camera_sees_as_far_as_it_is_wide() -> None:
    camera = Pinhole.of_hfov(640, 360, 75.0)
    angles = np.radians([-37.6, -37.4, 0.0, 37.4, 37.6, 180.0])
    pixels = camera.pixels(np.stack([np.sin(angles), np.zeros(6), np.cos(angles)], axis=-1))
    assert np.isfinite(pixels[:, 0]).tolist() == [False, True, True, True, False, False]
    assert pixels[2].tolist() == [319.5, 179.5]


def test_a_distorted_camera_is_not_seen_twice() -> None:
    """Barrel distortion would fold far rays back into the picture."""
    camera = Pinhole(640, 480, (500.0, 500.0), (319.5, 239.5), (-0.15,))
    angles = np.radians(np.arange(40, 90, 5))
    pixels = camera.pixels(np.stack([np.sin(angles), np.zeros(len(angles)), np.cos(angles)], axis=-1))
    assert not np.isfinite(pixels).any()


def test_a_fisheyes_pixels_outside_of_its_circle_see_nothing() -> None:
    rays = LENS.rays(np.array([[0.0, 0.0], [199.5, 199.5], [199.5, 1.0]]))
    assert np.isfinite(rays).all(axis=1).tolist() == [False, True, True]
    assert rays[1].tolist() == [0.0, 0.0, 1.0]


def test_a_pair_sees_all_around() -> None:
    pair = CAMERAS["pair"]
    pixels = pair.pixels(np.random.default_rng(2).normal(size=(5000, 3)))
    assert np.isfinite(pixels).all()
    assert pair.pixels(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])).tolist() == [[199.5, 199.5], [599.5, 199.5]]
