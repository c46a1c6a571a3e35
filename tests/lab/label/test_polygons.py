"""Masks to polygons and back."""

import cv2
import numpy as np
import pytest

from savmap.lab.label.polygons import area, filled, outlines

RNG = np.random.default_rng(0)


def drawn(polygons: list[np.ndarray], shape: tuple[int, int]) -> np.ndarray:
    mask = np.zeros(shape, np.bool_)
    for polygon in polygons:
        mask |= filled(polygon, *shape)
    return mask


def blobs() -> np.ndarray:
    return cv2.GaussianBlur(RNG.normal(size=(60, 80)), (0, 0), 3) > 0


def test_every_pixel_comes_back() -> None:
    for _ in range(5):
        mask = blobs()
        assert np.array_equal(drawn(outlines(mask, 0.0, 1), mask.shape), mask)


def test_simpler_polygons_lose_hardly_a_pixel() -> None:
    mask = blobs()
    exact, simple = outlines(mask, 0.0), outlines(mask)
    assert sum(map(len, simple)) < 0.7 * sum(map(len, exact))
    assert (drawn(simple, mask.shape) != mask).mean() < 0.005


def test_corners_are_on_pixels_corners() -> None:
    mask = np.zeros((20, 30), np.bool_)
    mask[5:15, 10:14] = True
    (polygon,) = outlines(mask)
    assert sorted(map(tuple, polygon.tolist())) == [(10, 5), (10, 15), (14, 5), (14, 15)]
    assert area(polygon) == 40


def test_a_hole_is_cut_and_what_is_in_it_stands_alone() -> None:
    mask = np.zeros((30, 40), np.bool_)
    mask[5:25, 5:35], mask[10:20, 10:30], mask[13:16, 15:20] = True, False, True
    polygons = outlines(mask, least_pixels=1)
    assert len(polygons) == 2
    assert np.array_equal(drawn(polygons, mask.shape), mask)
    assert sum(map(area, polygons)) == pytest.approx(mask.sum(), abs=1)


def test_specks_are_left_out() -> None:
    mask = np.zeros((20, 20), np.bool_)
    mask[3:5, 3:5] = True
    assert outlines(mask) == []
    assert outlines(np.zeros((20, 20), np.bool_)) == []


def test_what_is_outside_the_picture_is_cut_off() -> None:
    box = np.array([[-5.0, -5], [4, -5], [4, 3], [-5, 3]])
    inside = filled(box, 10, 12)
    assert inside[:3, :4].all()
    assert inside.sum() == 12
    assert not filled(box + 100, 10, 12).any()
