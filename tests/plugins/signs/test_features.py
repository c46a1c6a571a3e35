"""Masks to quadrilaterals, and corners measured in the panorama."""

import cv2
import numpy as np
import pytest

from savmap.geometry.pinhole import project
from savmap.types import Floats, ViewSpec
from savmap_signs.features import quad_of_mask, refine_corners

from .drawn_signs import panorama_of, plate

SPEC = ViewSpec("signs lower", yaw_deg=0.0, hfov_deg=110.0)


def mask_of(quad: Floats) -> np.ndarray:
    mask = np.zeros((SPEC.height, SPEC.width), np.uint8)
    cv2.fillConvexPoly(mask, np.round(quad).astype(np.int32), 1)
    return mask.astype(bool)


def test_quad_of_a_mask_starts_at_the_upper_left() -> None:
    quad = np.array([[200.0, 100], [300, 110], [298, 170], [202, 150]])
    corners = quad_of_mask(mask_of(quad))
    assert corners is not None
    assert np.abs(corners - quad).max() < 1.6


@pytest.mark.parametrize(
    "quads",
    [
        [[[-5, 100], [80, 100], [80, 150], [-5, 150]]],
        [[[300, 200], [303, 200], [303, 203], [300, 203]]],
        [[[200, 100], [300, 100], [300, 106], [200, 106]], [[200, 100], [206, 100], [206, 160], [200, 160]]],
    ],
    ids=["cut", "tiny", "ragged"],
)
def test_masks_that_are_no_quadrilateral_give_none(quads: list[list[list[int]]]) -> None:
    assert quad_of_mask(np.any([mask_of(np.array(quad, float)) for quad in quads], axis=0)) is None


@pytest.mark.parametrize("turn", [0.0, 35.0])
def test_refined_corners_are_exact_to_a_part_of_a_pixel(turn: float) -> None:
    corners = plate((0.2, -0.3, 1.5), (0.3, 0.15), turn)
    panorama = panorama_of(corners, "A21-03", 1024)
    truth = project(corners, SPEC.camera)
    shifted = truth + np.array([[1.0, -0.8], [0.7, 0.5], [-0.9, 0.6], [0.5, -1.0]])
    measured, covariances = refine_corners(panorama, SPEC, shifted)
    assert np.linalg.norm(measured - truth, axis=1).max() < 0.3
    assert (np.sqrt(np.linalg.eigvalsh(covariances)) < 0.6).all()


def test_corners_stay_with_a_larger_sigma_where_no_edge_is() -> None:
    panorama = panorama_of(plate((0.0, -1.0, 1.0), (0.1, 0.1)), "", 512)
    quad = project(plate((0.6, 0.5, 1.5), (0.3, 0.2)), SPEC.camera)
    corners, covariances = refine_corners(panorama, SPEC, quad)
    assert np.abs(corners - quad).max() < 1.0
    assert (np.sqrt(np.linalg.eigvalsh(covariances)) > 1.0).all()
