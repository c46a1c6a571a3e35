"""What pictures are that are twice as wide as high: panoramas of all sorts pass, other packings are named."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from savmap.types import Panorama
from savmap.video.camera_kind import kind_of

HEIGHT, WIDTH = 256, 512
Image = np.ndarray


def corridor(seed: int = 0) -> Image:
    """A panorama (HEIGHT, WIDTH) of a place with a smooth floor and ceiling and detailed walls, that closes around."""
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(np.tile(rng.normal(0, 1, (HEIGHT, WIDTH)), (1, 3)), (0, 0), 3)[:, WIDTH : 2 * WIDTH]
    latitude = np.linspace(np.pi / 2, -np.pi / 2, HEIGHT)[:, None]
    detail = noise / noise.std() * 45 * np.cos(latitude) ** 2
    return np.clip(120 + 50 * np.sin(latitude) + detail, 0, 255)


def look(panorama: Image, longitude: Image, latitude: Image) -> Image:
    """The panorama's values in directions, radians."""
    columns = (longitude / (2 * np.pi) + 0.5) * WIDTH % WIDTH
    rows = (0.5 - latitude / np.pi) * HEIGHT
    wide = np.hstack([panorama, panorama[:, :8]]).astype(np.float32)
    return cv2.remap(
        wide, columns.astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )


def angles(width: int, height: int, wide: float) -> tuple[Image, Image]:
    return np.meshgrid(
        wide * ((np.arange(width) + 0.5) / width - 0.5), np.pi * (0.5 - (np.arange(height) + 0.5) / height)
    )


def vr180(panorama: Image) -> Image:
    longitude, latitude = angles(WIDTH // 2, HEIGHT, np.pi)
    return np.hstack([look(panorama, longitude + eye * np.cos(latitude), latitude) for eye in (0, 0.04)])


def beside(panorama: Image) -> Image:
    longitude, latitude = angles(WIDTH // 2, HEIGHT, 2 * np.pi)
    return np.hstack([look(panorama, longitude + eye * np.cos(latitude), latitude) for eye in (0, 0.04)])


def above(panorama: Image) -> Image:
    longitude, latitude = angles(WIDTH, HEIGHT // 2, 2 * np.pi)
    return np.vstack([look(panorama, longitude + eye * np.cos(latitude), latitude) for eye in (0, 0.04)])


def circles(panorama: Image) -> Image:
    x, y = np.meshgrid(*2 * [(np.arange(HEIGHT) + 0.5) / HEIGHT * 2 - 1])
    radius = np.hypot(x, y)
    angle = radius * np.radians(100)
    rays = np.stack([np.sin(angle) * x / radius, -np.sin(angle) * y / radius, np.cos(angle)])
    lenses = [look(panorama, np.arctan2(rays[0], rays[2]) + turn, np.arcsin(rays[1])) for turn in (0, np.pi)]
    return np.hstack([np.where(radius < 1, lens, 2) for lens in lenses])


def flat(panorama: Image) -> Image:
    x, y = np.meshgrid((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1, 0.5 - (np.arange(HEIGHT) + 0.5) / HEIGHT)
    return look(panorama, np.arctan(1.2 * x), np.arctan(1.2 * y))


def kind(change: Callable[[Image], Image]) -> tuple[str, list[str]]:
    pictures = [change(corridor(seed)).clip(0, 255).astype(np.uint8) for seed in range(5)]
    found, warnings = kind_of([Panorama(0, 0.0, np.dstack([picture] * 3)) for picture in pictures])
    assert {warning.code for warning in warnings} <= {"bad-panorama"}
    return found, [line for warning in warnings for line in warning.details]


@pytest.mark.parametrize(
    ("packing", "words"),
    [
        (vr180, "stereo or VR180, side by side"),
        (beside, "stereo or VR180, side by side"),
        (above, "one eye above the other"),
        (circles, "two fisheye pictures"),
        (flat, "edges do not meet, nor"),
    ],
)
def test_other_packings_are_named(packing: Callable[[Image], Image], words: str) -> None:
    assert words in kind(packing)[0]


def dark(panorama: Image) -> Image:
    return 0.12 * panorama + np.random.default_rng(5).normal(0, 3, panorama.shape)


def tripod(panorama: Image) -> Image:
    patched = panorama.astype(np.uint8)
    patched[int(0.85 * HEIGHT) :] = 0
    cv2.putText(patched, "LOGO", (180, int(0.96 * HEIGHT)), 0, 1.0, 255, 3)
    return patched


def lenses(panorama: Image) -> Image:
    return panorama * np.where(np.arange(WIDTH) < WIDTH // 2, 0.7, 1.2)


def night(panorama: Image) -> Image:
    return np.where(np.abs(np.linspace(-90, 90, HEIGHT))[:, None] > 50, 0, panorama)


@pytest.mark.parametrize(
    "change", [np.copy, dark, tripod, lenses, night, np.zeros_like], ids=lambda change: change.__name__
)
def test_panoramas_of_all_sorts_pass(change: Callable[[Image], Image]) -> None:
    assert kind(change) == ("", [])


def part(panorama: Image) -> Image:
    """A part of a panorama, stretched to the whole width: its top and bottom rows are even."""
    return cv2.resize(panorama[:, :300], (WIDTH, HEIGHT))


def test_a_part_of_a_panorama_is_refused() -> None:
    assert "edges do not meet: it seems to be a part of a panorama" in kind(part)[0]


def test_edges_that_hardly_meet_are_warned_of() -> None:
    found, warnings = kind(lambda panorama: 0.7 * part(panorama) + 0.3 * panorama)
    assert not found
    assert warnings == ["the pictures' side edges do not meet"]
