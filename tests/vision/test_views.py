"""Views cut from panoramas: against the formula, against py360convert, at the seam, at the poles, without aliasing."""

from functools import lru_cache

import cv2
import numpy as np
import py360convert
import pytest

from savmap.geometry import pinhole, sphere
from savmap.types import FilmedPanorama, Panorama, Planes, View, ViewSpec
from savmap.video.decode import rgb_from_yuv
from savmap.vision.views import DARK, KEPT_TABLES, WHITE, Region, RegionPyramid, Renderer, tones_of

VIEWS = [
    ViewSpec("ahead", 0, hfov_deg=90),
    ViewSpec("seam", 180, -20, 0, 100),
    ViewSpec("seam rolled", -170, 15, 40, 60),
    ViewSpec("up", 70, 90, 0, 110),
    ViewSpec("nearly down", -30, -85, 10, 80),
    ViewSpec("wide", 100, 0, 0, 150, 400, 300),
]


def grid(width: int, height: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(float(width)), np.arange(float(height))), axis=-1)


def colour(rays: np.ndarray) -> np.ndarray:
    """A smooth, detailed colour (..., 3) for every direction (..., 3)."""
    x, y, z = np.moveaxis(rays, -1, 0)
    red = 128 + 100 * np.sin(9 * x + 4 * y) * np.cos(11 * z)
    green = 128 + 60 * np.sin(25 * y + 7 * z) + 50 * np.sin(30 * x)
    return np.stack([red, green, 128 + 110 * np.sin(15 * x * y + 12 * z)], axis=-1)


@lru_cache
def panorama(height: int) -> Panorama:
    rays = sphere.rays_from_panorama_pixels(grid(2 * height, height), height)
    return Panorama(7, 1.5, colour(rays).round().astype(np.uint8))


@pytest.mark.slow
@pytest.mark.parametrize("spec", VIEWS, ids=lambda spec: spec.name)
@pytest.mark.parametrize(("height", "largest"), [(512, 4), (1500, 3)])
def test_view_is_what_the_directions_look_like(spec: ViewSpec, height: int, largest: float) -> None:
    view = Renderer().render(panorama(height), spec)
    error = np.abs(view.image - colour(spec.rig_rays(grid(spec.width, spec.height))))
    assert (view.frame, view.stamp_s, view.spec) == (7, 1.5, spec)
    assert error.max() < largest
    assert error.mean() < 0.4


@pytest.mark.parametrize("second", [Region(8, 56, 100, 48), Region(0, 56, 100, 48), Region(6, 50, 98, 52)], ids=str)
def test_coarser_regions_are_what_the_panorama_gives(second: Region) -> None:
    """Whether they lie inside the last one or not, over the seam."""
    image = np.random.default_rng(3).integers(0, 256, (64, 128), dtype=np.uint8)
    coarser = RegionPyramid(image)
    for region, halvings in ((Region(4, 60, 96, 60), 1), (second, 2)):
        turned = np.roll(image, -region.left, axis=1)[region.top : region.bottom, : region.width]
        for _ in range(halvings):
            turned = cv2.resize(turned, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        assert np.array_equal(coarser.region(region, halvings), turned)


@pytest.mark.parametrize("spec", [view for view in VIEWS if view.roll_deg == 0], ids=lambda spec: spec.name)
def test_agrees_with_py360convert(spec: ViewSpec) -> None:
    """e2p spreads its field of view between the centres of the outer pixels, ours between their outer borders."""
    image = panorama(512).image
    fov = tuple(np.degrees(2 * np.arctan((n - 1) / 2 / spec.camera[0, 0])) for n in (spec.width, spec.height))
    theirs = py360convert.e2p(image, fov, spec.yaw_deg, spec.pitch_deg, (spec.height, spec.width))
    difference = np.abs(Renderer().render(panorama(512), spec).image.astype(int) - theirs)
    assert difference.max() <= 3
    assert difference.mean() < 0.1


@lru_cache
def noise(height: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (height, 2 * height, 3), np.uint8)


@pytest.mark.parametrize("height", [256, 1024])
@pytest.mark.parametrize("pitch", [0.0, 88.0])
def test_turning_the_panorama_turns_the_view(height: int, pitch: float) -> None:
    """Nothing happens at the seam that does not happen elsewhere, even in noise."""
    image = noise(height)
    turned = np.roll(image, height, axis=1)
    ahead = Renderer().render(Panorama(0, 0.0, image), ViewSpec("a", 0, pitch)).image.astype(int)
    behind = Renderer().render(Panorama(0, 0.0, turned), ViewSpec("a", 180, pitch)).image
    assert np.abs(ahead - behind).max() <= 16


def test_the_poles_do_not_leak_into_one_another() -> None:
    image = np.zeros((64, 128, 3), np.uint8)
    image[32:] = 255
    renderer = Renderer()
    assert renderer.render(Panorama(0, 0.0, image), ViewSpec("up", 0, 90)).image.max() == 0
    assert renderer.render(Panorama(0, 0.0, image), ViewSpec("down", 0, -90)).image.min() == 255


def test_fine_panoramas_are_averaged() -> None:
    """Noise far finer than the view's pixels turns grey, and a straight edge stays where it is."""
    spec = ViewSpec("a", 20, 0, 0, 120, 80, 60)
    flat = Renderer().render(Panorama(0, 0.0, noise(1024)), spec).image.astype(float)
    harsh = Renderer(antialias=False).render(Panorama(0, 0.0, noise(1024)), spec).image.astype(float)
    assert flat[25:35, 35:45].std() < 0.35 * harsh[25:35, 35:45].std()
    rays = sphere.rays_from_panorama_pixels(grid(2048, 1024), 1024) @ spec.rig_from_view
    half = np.where((rays[..., 0] < 0.1 * rays[..., 2])[..., None], 255, 0).astype(np.uint8).repeat(3, axis=-1)
    row = Renderer().render(Panorama(0, 0.0, half), spec).image[30, :, 0] / 255
    edge = pinhole.project(np.array([0.1, 0.0, 1.0]), spec.camera)[0]
    assert row.sum() - 0.5 == pytest.approx(edge, abs=0.1)


def test_tables_are_kept_but_not_for_ever() -> None:
    renderer = Renderer()
    picture = panorama(64)
    for index in range(2 * KEPT_TABLES):
        renderer.render(picture, ViewSpec("a", index, width=8, height=6))
    assert len(renderer._tables) == KEPT_TABLES
    again = ViewSpec("another name", 2 * KEPT_TABLES - 1, width=8, height=6)
    first = next(reversed(renderer._tables.values()))
    renderer.render(picture, again)
    assert next(reversed(renderer._tables.values())) is first


@lru_cache
def planes(height: int) -> Planes:
    """Planes of brightness and colour that all stand for colours, over a panorama."""
    rays = sphere.rays_from_panorama_pixels(grid(2 * height, height), height)
    luma = 60 + 0.5 * colour(rays)[..., 1]
    blue, red = (108 + 0.16 * colour(rays[::2, ::2])[..., channel] for channel in (0, 2))
    whole = (np.asarray(plane.round(), np.uint8) for plane in (luma, blue, red))
    return Planes(*whole, rgb_from_yuv(0.299, 0.114, full=False))


@pytest.mark.slow
@pytest.mark.parametrize("spec", VIEWS, ids=lambda spec: spec.name)
@pytest.mark.parametrize("height", [512, 1504])
def test_planes_give_the_view_that_their_rgb_gives(spec: ViewSpec, height: int) -> None:
    filmed = FilmedPanorama(7, 1.5, planes(height))
    theirs = Renderer().render(Panorama(7, 1.5, planes(height).rgb), spec).image.astype(int)
    view = Renderer().render(filmed, spec)
    assert (view.frame, view.stamp_s) == (7, 1.5)
    assert np.abs(view.image - theirs).max() <= 4
    assert (np.abs(view.image - theirs) > 1).mean() < 0.06
    assert abs((view.image - theirs).mean()) < 0.2
    assert "image" not in vars(filmed)


def test_tones_are_what_is_dark_in_all_colours_and_white_in_all() -> None:
    spec = ViewSpec("ahead", 0, hfov_deg=90, width=8, height=5)
    image = np.full((5, 8, 3), 100, np.uint8)
    image[0] = (DARK, 3, 0)
    image[1] = (DARK + 1, 3, 0)
    image[2:4] = (WHITE, 255, 252)
    image[4] = (WHITE - 1, 255, 255)
    assert tones_of([View(spec, 0, 0.0, image)]) == (0.2, 0.4)
    assert tones_of([View(spec, 0, 0.0, image), View(spec, 0, 0.0, np.zeros_like(image))]) == (0.6, 0.2)
