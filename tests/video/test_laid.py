"""Pictures of any camera laid into panoramas: what they see is where it was."""

import cv2
import numpy as np
import pytest

from savmap.geometry.cameras import Camera, Fisheye, FisheyePair, Pinhole
from savmap.types import Planes
from savmap.video.decode import rgb_from_yuv
from savmap.video.laid import MOST_HEIGHT, Laid

from .made_up_video import seen_by

LENS = Fisheye.of_hfov(512, 512, 190.0)
CAMERAS: dict[str, Camera] = {
    "pinhole": Pinhole.of_hfov(480, 270, 75.0),
    "fisheye": LENS,
    "pair": FisheyePair(LENS, LENS, np.eye(3), np.diag([-1.0, 1.0, -1.0])),
}
HEIGHT = 512


def scene() -> np.ndarray:
    """A smooth panorama (HEIGHT, 2 HEIGHT, 3), at its poles, too."""
    y, x = np.mgrid[0:HEIGHT, 0 : 2 * HEIGHT]
    waves = [np.sin(x * 2 * np.pi / HEIGHT * 4 + shift) * np.cos(y * np.pi / HEIGHT * 5) for shift in (0, 1, 2)]
    level = np.sin(y * np.pi / HEIGHT)[..., None] ** 2
    return (128 + 100 * level * np.stack(waves, axis=-1)).astype(np.uint8)


@pytest.mark.parametrize("name", CAMERAS)
def test_a_picture_is_laid_where_it_was_seen(name: str) -> None:
    camera, panorama = CAMERAS[name], scene()
    laid = Laid(camera)
    whole = laid.panorama(seen_by(camera, panorama))
    assert isinstance(whole, np.ndarray)
    assert whole.shape == (laid.height, 2 * laid.height, 3)
    true = cv2.resize(panorama, whole.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    seen = np.full(whole.shape[:2], 255, np.uint8) if laid.seen is None else laid.seen
    assert (laid.seen is None) == (name == "pair")
    sure = cv2.erode(seen, np.ones((15, 15))) > 0
    share = sure.mean()
    assert share == pytest.approx({"pinhole": 0.065, "fisheye": 0.5, "pair": 1.0}[name], abs=0.1)
    off = np.abs(whole.astype(int) - true)[sure]
    assert np.quantile(off, 0.99) <= 4
    assert not whole[cv2.dilate(seen, np.ones((5, 5))) == 0].any()


def test_planes_are_laid_as_colours_are() -> None:
    camera, matrix = CAMERAS["pinhole"], rgb_from_yuv(0.2126, 0.0722, False)
    rng = np.random.default_rng(1)
    planes = Planes(
        cv2.GaussianBlur(rng.integers(16, 235, (270, 480)).astype(np.uint8), (0, 0), 4),
        np.full((135, 240), 110, np.uint8),
        np.full((135, 240), 150, np.uint8),
        matrix,
    )
    laid = Laid(camera)
    whole = laid.panorama(planes)
    assert isinstance(whole, Planes)
    sure = cv2.erode(laid.seen, np.ones((9, 9))) > 0
    of_colours = laid.panorama(planes.rgb)
    assert isinstance(of_colours, np.ndarray)
    assert np.abs(whole.rgb.astype(int) - of_colours)[sure].max() <= 3
    assert not whole.rgb[cv2.dilate(laid.seen, np.ones((5, 5))) == 0].any()


def test_a_panorama_is_as_fine_as_the_picture_and_not_too_large() -> None:
    assert Laid(Pinhole.of_hfov(1138, 640, 75.0)).height == pytest.approx(1.2 * np.pi * 741.5, abs=64)
    large = Laid(Pinhole.of_hfov(3840, 2160, 65.0))
    assert large.height == MOST_HEIGHT
    picture = np.full((2160, 3840, 3), 90, np.uint8)
    whole = large.panorama(picture)
    assert isinstance(whole, np.ndarray)
    assert (whole[cv2.erode(large.seen, np.ones((9, 9))) > 0] == 90).all()
