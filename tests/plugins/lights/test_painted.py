"""Painted pictures of ceilings: the same from the same numbers, labelled as they are built."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.geometry.pinhole import focal_px, rig_from_view
from savmap.lab.sim.paint.faces import Lighting
from savmap.lab.sim.paint.raster import Camera
from savmap.lab.sim.paint.shade import painted
from savmap.lab.sim.paint.stage import Stage
from savmap.lab.sim.paint.wardrobe import Wardrobe, wardrobe_of
from savmap_lights.lab.painted.hall import TEXTURES
from savmap_lights.lab.painted.lamps import LIGHT, Style, build_lamp, random_style
from savmap_lights.lab.painted.pictures import picture

ABOVE_M = 4.0
STRAIGHT_UP = Camera(np.array([0.0, 2.0, 0.0]), np.diag([1.0, -1.0, -1.0]) @ rig_from_view(0.0, 90.0, 0.0), 70.0)


@pytest.fixture(scope="module")
def clothes() -> Wardrobe:
    return wardrobe_of(np.random.default_rng(1), TEXTURES)


def plain(clothes: Wardrobe, kind: str) -> Style:
    style = random_style(np.random.default_rng(1), clothes)
    return replace(style, kind=kind, long=1.2, wide=0.2, thick=0.05, tubes=False, case=0.0, rods=False)


def mask_of(clothes: Wardrobe, style: Style, label: int = LIGHT) -> np.ndarray:
    stage = Stage(np.random.default_rng(0))
    with stage.frame((0.0, STRAIGHT_UP.origin[1] + ABOVE_M, 0.0), 90.0 if style.across else 0.0):
        build_lamp(stage, style, label, 1.0)
    light = Lighting(np.zeros((0, 3)), np.zeros(0), 1.0, 0.0, 0.0)
    return painted(stage.faces(), clothes.atlas, light, STRAIGHT_UP, (640, 480), 1).mask


@pytest.mark.parametrize(("across", "size"), [(False, (1.2, 0.2)), (True, (0.2, 1.2))])
def test_a_strips_mask_is_as_large_as_the_strip(clothes: Wardrobe, across: bool, size: tuple[float, float]) -> None:
    mask = mask_of(clothes, replace(plain(clothes, "strip"), across=across))
    rows, columns = np.nonzero(mask == LIGHT)
    metre_px = focal_px(70.0, 640) / ABOVE_M
    assert np.ptp(columns) + 1 == pytest.approx(size[0] * metre_px, abs=1.5)
    assert np.ptp(rows) + 1 == pytest.approx(size[1] * metre_px, abs=1.5)


def test_a_discs_mask_is_round(clothes: Wardrobe) -> None:
    mask = mask_of(clothes, replace(plain(clothes, "disc"), wide=1.2))
    radius_px = 0.6 * focal_px(70.0, 640) / ABOVE_M
    assert np.count_nonzero(mask == LIGHT) == pytest.approx(np.pi * radius_px**2, rel=0.06)


def test_a_lamp_that_is_switched_off_is_background(clothes: Wardrobe) -> None:
    assert not mask_of(clothes, plain(clothes, "strip"), label=0).any()


def test_a_picture_follows_from_its_numbers() -> None:
    first, again, other = picture(5, 3), picture(5, 3), picture(5, 4)
    assert all(np.array_equal(one, two) for one, two in zip(first, again, strict=True))
    assert not np.array_equal(first[0], other[0])


@pytest.mark.slow
def test_lamps_are_brighter_than_what_is_about_them() -> None:
    lit, rest = [], []
    for number in range(8):
        image, mask = picture(6, number)
        if np.count_nonzero(mask == LIGHT) > 50:
            lit.append(float(np.median(image[mask == LIGHT])))
            rest.append(float(np.median(image[mask == 0])))
    assert len(lit) >= 4
    assert np.median(np.array(lit) - rest) > 50
