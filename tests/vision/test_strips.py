"""Strips of panoramas: what views show is there again, to the bit, also across the seam."""

import numpy as np
import pytest

from savmap.types import FilmedPanorama, Panorama, Planes, ViewSpec
from savmap.vision.strips import PanoramaStrip, region_of
from savmap.vision.subpixel import _grey
from savmap.vision.views import Renderer

HEIGHT = 128
MATRIX = np.array([[1.164, 0, 1.793, -248.1], [1.164, -0.213, -0.533, 76.9], [1.164, 2.112, 0, -289.0]])


def rough(*shape: int) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 255, shape).astype(np.uint8)


def grey_view(panorama: Panorama, spec: ViewSpec) -> np.ndarray:
    """A view of the values that edges are measured in."""
    values, _ = _grey(panorama, (0, HEIGHT), (0, 2 * HEIGHT))
    return Renderer(antialias=False).render(Panorama(0, 0.0, np.repeat(values[..., None], 3, axis=2)), spec).image


@pytest.mark.parametrize("yaw", [0.0, 100.0, 180.0, 260.0])
@pytest.mark.parametrize("filmed", [True, False])
def test_a_view_is_the_same_in_a_strip(yaw: float, filmed: bool) -> None:
    whole: Panorama = Panorama(3, 0.1, rough(HEIGHT, 2 * HEIGHT, 3))
    if filmed:
        colour = rough(HEIGHT // 2, HEIGHT)
        whole = FilmedPanorama(3, 0.1, Planes(rough(HEIGHT, 2 * HEIGHT), colour, colour, MATRIX))
    spec = ViewSpec("face", yaw, 10.0, hfov_deg=90.0, width=64, height=48)
    strip = PanoramaStrip.of(whole, region_of([spec], HEIGHT))
    again = strip.panorama()
    assert (again.frame, again.stamp_s, again.height) == (3, 0.1, HEIGHT)
    assert np.array_equal(grey_view(again, spec), grey_view(whole, spec))
    assert np.array_equal(_grey(again, (0, 1), (0, 1))[1], _grey(whole, (0, 1), (0, 1))[1])


def test_a_strip_is_smaller_than_its_panorama() -> None:
    region = region_of([ViewSpec("face", 90.0, hfov_deg=90.0)], 1024)
    assert 512 <= region.width < 700
    assert region.bottom - region.top < 700


def test_up_is_all_around() -> None:
    region = region_of([ViewSpec("up", 0.0, 90.0)], 1024)
    assert (region.top, region.width) == (0, 2048)
