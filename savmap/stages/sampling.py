"""Which panorama pixels a rectilinear view samples: fixed-point tables for `cv2.remap`, at several levels of detail."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry import pinhole, sphere
from savmap.types import ViewSpec

Image = NDArray[np.uint8]
OUTSIDE = -16.0
LAST_ROW = 1 / 16


@dataclass(frozen=True)
class Region:
    """Part of a panorama: rows [top, bottom) and `width` columns from `left` on, over the seam where need be."""

    top: int
    bottom: int
    left: int
    width: int


@dataclass(frozen=True)
class Level:
    """Table (h, w) for the panorama's region shrunk `halvings` times; region None: the panorama itself."""

    halvings: int
    region: Region | None
    cells: NDArray[np.int16]
    fractions: NDArray[np.uint16]


def table(spec: ViewSpec, height: int, antialias: bool) -> tuple[Level, ...]:
    """Levels that together cover a view of a (height, 2 height) panorama, each pixel from one of them."""
    pixels = _panorama_pixels(spec, height)
    halvings = _halvings(spec, height) if antialias else np.zeros((spec.height, spec.width), np.int64)
    return tuple(_level(pixels, halvings, int(number), height) for number in np.unique(halvings))


def _panorama_pixels(spec: ViewSpec, height: int) -> NDArray[np.float64]:
    """(h, w, 2) panorama pixels of a view's pixel centres; rows beyond the poles' last rows are put on them."""
    columns, rows = np.arange(spec.width, dtype=np.float64), np.arange(spec.height, dtype=np.float64)
    rays = spec.rig_rays(np.stack(np.meshgrid(columns, rows), axis=-1))
    pixels = sphere.panorama_pixels_from_rays(rays.astype(np.float32), height)
    pixels[..., 1] = np.clip(pixels[..., 1], 0, height - 1)
    return pixels


def _halvings(spec: ViewSpec, height: int) -> NDArray[np.int64]:
    """How often to halve the panorama for each pixel (h, w): neighbours must lie less than two of its pixels apart."""
    focal = pinhole.focal_px(spec.hfov_deg, spec.width)
    x = (np.arange(spec.width) - (spec.width - 1) / 2) / focal
    y = (np.arange(spec.height) - (spec.height - 1) / 2) / focal
    cosine = 1 / np.sqrt(1 + x**2 + y[:, None] ** 2)
    panorama_per_view = height / np.pi * cosine**1.5 / focal
    divisible = (height & -height).bit_length() - 1
    return np.clip(np.floor(np.log2(panorama_per_view)), 0, divisible).astype(np.int64)


def _level(pixels: NDArray[np.float64], halvings: NDArray[np.int64], number: int, height: int) -> Level:
    own = halvings == number
    if number == 0:
        return Level(0, None, *_fixed(np.where(own[..., None], pixels, 0.0)))
    cell = 2**number
    region = _region(pixels[own], height, cell)
    column = ((pixels[..., 0] + 0.5 - region.left - cell) % (2 * height) + cell) / cell - 0.5
    row = (pixels[..., 1] + 0.5 - region.top) / cell - 0.5
    row = np.clip(row, 0, (region.bottom - region.top) // cell - 1 - LAST_ROW)
    return Level(number, region, *_fixed(np.where(own[..., None], np.stack([column, row], axis=-1), OUTSIDE)))


def _region(pixels: NDArray[np.float64], height: int, cell: int) -> Region:
    """Smallest region that holds pixels (n, 2) and the cells beside them, in whole cells."""
    top = max(0, int(pixels[:, 1].min() // cell - 2) * cell)
    bottom = min(height, int(pixels[:, 1].max() // cell + 3) * cell)
    used = np.unique((pixels[:, 0] // cell).astype(np.int64) % (2 * height // cell))
    gaps = np.diff(used, append=used[0] + 2 * height // cell)
    widest = int(gaps.argmax())
    left = (int(used[(widest + 1) % len(used)]) - 2) * cell
    width = (2 * height // cell - int(gaps[widest]) + 5) * cell
    return Region(top, bottom, left % (2 * height), width)


def _fixed(pixels: NDArray[np.float64]) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    """Whole parts and 1/32 fractions of panorama pixels, as OpenCV takes them."""
    cells, fractions = cv2.convertMaps(
        pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32), cv2.CV_16SC2
    )
    return np.asarray(cells, np.int16), np.asarray(fractions, np.uint16)


def shrunk(image: Image, region: Region, halvings: int) -> Image:
    """A region of a panorama, halved so many times by averaging."""
    pieces, left, rest = [], region.left, region.width
    while rest > 0:
        columns = min(rest, image.shape[1] - left)
        pieces.append(_halved(image[region.top : region.bottom, left : left + columns]))
        left, rest = 0, rest - columns
    part = pieces[0] if len(pieces) == 1 else np.hstack(pieces)
    for _ in range(halvings - 1):
        part = _halved(part)
    return part


def _halved(image: Image) -> Image:
    half = (image.shape[1] // 2, image.shape[0] // 2)
    return np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA), np.uint8)
