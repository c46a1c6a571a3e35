"""Rectilinear views, sampled straight from panoramas (paper, section III-B).

For each view, a table says where its pixels lie in the panorama. Where the panorama is much finer than the view, the
table's level samples a region of the panorama that was halved by averaging, so that fine texture does not alias.
"""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from threading import Lock

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry import sphere
from savmap.types import FilmedPanorama, Panorama, Planes, View, ViewSpec, array_record

Image = NDArray[np.uint8]
Singles = NDArray[np.float32]
PACKED = 512
"""Entries in a row of a table: the pixels of a level are packed into rows for OpenCV's remap."""
LAST_ROW = 1 + 1 / 16
FRACTIONS = 32
"""OpenCV's remap interpolates in steps of 1/32 pixel."""
KEPT_TABLES = 32
PIXEL = np.dtype((np.void, 3))

DARK, WHITE, LEGIBLE = 28, 250, 0.1
"""Grey levels: up to the first, and, of the darkest colour, from the second on, which noise makes white, nothing is
told apart; so in a picture of which less than this share lies between."""

Key = tuple[int, float, float, float, float, int, int]
"""What a table depends on: the panorama's height, and the view's angles and size."""


@dataclass(frozen=True)
class Region:
    """Part of a panorama: rows [top, bottom) and `width` columns from `left` on, which may cross the seam."""

    top: int
    bottom: int
    left: int
    width: int

    @property
    def halved(self) -> "Region":
        """The same part of a panorama of half the resolution."""
        return Region(self.top // 2, self.bottom // 2, self.left // 2, self.width // 2)


@dataclass(frozen=True, eq=False)
@array_record
class Level:
    """The table of the pixels of a view that are sampled at one resolution, those where `mask` (h, w) is set.

    They are sampled from `region` of the panorama, halved `halvings` times; None: from the panorama itself. The table
    `cells` (m, PACKED, 2) and `fractions` (m, PACKED), in OpenCV's fixed-point form, has an entry for each of these
    pixels, row by row; the last one is repeated to fill the table.
    """

    mask: NDArray[np.bool_]
    halvings: int
    region: Region | None
    cells: NDArray[np.int16]
    fractions: NDArray[np.uint16]

    @cached_property
    def half_as_fine(self) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
        """The table for colour at half the resolution: it gives what this one gives of the same picture with every
        pixel doubled."""
        odd = (self.cells & 1).astype(np.uint16)
        across, down = self.fractions % FRACTIONS, self.fractions // FRACTIONS
        return self.cells >> 1, across * odd[..., 0] + FRACTIONS * down * odd[..., 1]


class Renderer:
    """Renders views of panoramas and keeps the tables of the last views.

    Bilinear, at pixel centres, over the seam and the poles. With `antialias`, the panorama is first averaged down where
    it is two or more times finer than the view. Panoramas in planes of luma and colour are sampled as such, and only
    the view is converted to RGB. Threads may share a renderer.
    """

    def __init__(self, antialias: bool = True) -> None:
        self._antialias = antialias
        self._tables: OrderedDict[Key, tuple[Level, ...]] = OrderedDict()
        self._lock = Lock()

    def render(self, panorama: Panorama, spec: ViewSpec) -> View:
        """The view of `panorama` that `spec` describes."""
        image = np.empty((spec.height, spec.width, 3), np.uint8)
        levels = self._table(spec, panorama.height)
        if isinstance(panorama, FilmedPanorama):
            _sample_planes(panorama.planes, levels, image)
            image = panorama.planes.coloured(image)
        else:
            _sample(panorama.image, levels, image)
        return View(spec, panorama.frame, panorama.stamp_s, image)

    def _table(self, spec: ViewSpec, height: int) -> tuple[Level, ...]:
        key = (height, spec.yaw_deg, spec.pitch_deg, spec.roll_deg, spec.hfov_deg, spec.width, spec.height)
        with self._lock:
            if key not in self._tables:
                self._tables[key] = table(spec, height, self._antialias)
                if len(self._tables) > KEPT_TABLES:
                    self._tables.popitem(last=False)
            self._tables.move_to_end(key)
            return self._tables[key]


def table(spec: ViewSpec, height: int, antialias: bool) -> tuple[Level, ...]:
    """The levels of a view of a (height, 2 height) panorama: each pixel of the view is in one of them."""
    pixels = panorama_pixels(spec, height)
    halvings = _halvings(spec, height) if antialias else np.zeros((spec.height, spec.width), np.int64)
    numbers = np.flatnonzero(np.bincount(halvings.ravel()))
    return tuple(_level(pixels, halvings, int(number), height) for number in numbers)


def panorama_pixels(spec: ViewSpec, height: int) -> Singles:
    """(h, w, 2) panorama pixels of a view's pixel centres; rows beyond the poles' last rows are put on them."""
    x, y = _normalised(spec)
    turn = spec.rig_from_view.astype(np.float32)
    rig_x, rig_y, rig_z = (x * right + (y * down + forward)[:, None] for right, down, forward in turn)
    columns, rows = sphere.columns_and_rows(rig_x, rig_y, rig_z, height)
    return np.asarray(np.stack([columns, np.clip(rows, 0, height - 1)], axis=-1), np.float32)


def _normalised(spec: ViewSpec) -> tuple[Singles, Singles]:
    """Columns (w,) and rows (h,) of a view's pixels at depth 1."""
    focal = spec.camera[0, 0]
    columns, rows = np.arange(spec.width) - spec.camera[0, 2], np.arange(spec.height) - spec.camera[1, 2]
    return (columns / focal).astype(np.float32), (rows / focal).astype(np.float32)


def _halvings(spec: ViewSpec, height: int) -> NDArray[np.int64]:
    """How often to halve the panorama for each pixel (h, w): neighbours must lie less than two of its pixels apart."""
    x, y = _normalised(spec)
    cosine = 1 / np.sqrt(1 + x**2 + y[:, None] ** 2)
    panorama_per_view = height / np.pi * cosine**1.5 / spec.camera[0, 0]
    divisible = (height & -height).bit_length() - 1
    return np.asarray(np.clip(np.log2(panorama_per_view), 0, divisible), np.int64)


def _level(pixels: Singles, halvings: NDArray[np.int64], number: int, height: int) -> Level:
    mask = halvings == number
    pixels = pixels[mask]
    if number == 0:
        return Level(mask, 0, None, *_fixed(pixels))
    cell = 2**number
    region = region_around(pixels, height, cell)
    column = pixels[..., 0] + (0.5 - region.left - cell)
    column[column < 0] += 2 * height
    row = np.clip(
        (pixels[..., 1] + (0.5 - region.top)) / cell - 0.5, 0, (region.bottom - region.top) // cell - LAST_ROW
    )
    return Level(mask, number, region, *_fixed(np.stack([column / cell + 0.5, row], axis=-1)))


def region_around(pixels: Singles, height: int, cell: int) -> Region:
    """Smallest region that holds pixels (n, 2) and the cells beside them, in whole cells."""
    top = max(0, int(pixels[:, 1].min() // cell - 2) * cell)
    bottom = min(height, int(pixels[:, 1].max() // cell + 3) * cell)
    used = np.flatnonzero(np.bincount((pixels[:, 0].astype(np.int64) // cell).clip(0, 2 * height // cell - 1)))
    gaps = np.diff(used, append=used[0] + 2 * height // cell)
    widest = int(gaps.argmax())
    left = (int(used[(widest + 1) % len(used)]) - 2) * cell
    width = (2 * height // cell - int(gaps[widest]) + 5) * cell
    return Region(top, bottom, left % (2 * height), width)


def _fixed(pixels: Singles) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    """Whole parts and 1/32 fractions of panorama pixels (n, 2), as OpenCV takes them: in rows of PACKED."""
    pixels = np.pad(pixels, ((0, -len(pixels) % PACKED), (0, 0)), mode="edge").reshape(-1, PACKED, 2)
    cells, fractions = cv2.convertMaps(
        np.ascontiguousarray(pixels[..., 0]), np.ascontiguousarray(pixels[..., 1]), cv2.CV_16SC2
    )
    return np.asarray(cells, np.int16), np.asarray(fractions, np.uint16)


class RegionPyramid:
    """Halved regions of a panorama, asked for finest first: each is made from the last one where that contains it."""

    def __init__(self, panorama: Image) -> None:
        self._panorama = panorama
        self._region, self._halvings, self._image = Region(0, 0, 0, 0), 0, panorama

    def region(self, region: Region, halvings: int) -> Image:
        """A region, halved so many times by averaging."""
        part, done = self._inside(region), self._halvings
        if part is None:
            part, done = _cut(self._panorama, region, halvings > 0), min(halvings, 1)
        for _ in range(halvings - done):
            part = _halved(part)
        self._region, self._halvings, self._image = region, halvings, part
        return part

    def _inside(self, region: Region) -> Image | None:
        """A region cut from the last one, at its resolution; None beyond it or between its pixels."""
        last = self._region
        left, top = (region.left - last.left) % self._panorama.shape[1], region.top - last.top
        right, bottom = left + region.width, region.bottom - last.top
        if (
            top < 0
            or region.bottom > last.bottom
            or right > last.width
            or (left | top | right | bottom) % 2**self._halvings
        ):
            return None
        rows, columns = (
            (slice(first >> self._halvings, end >> self._halvings)) for first, end in ((top, bottom), (left, right))
        )
        return self._image[rows, columns]


def _cut(image: Image, region: Region, halve: bool) -> Image:
    """A region of a panorama, halved or as it is."""
    pieces, left, rest = [], region.left, region.width
    while rest > 0:
        columns = min(rest, image.shape[1] - left)
        piece = image[region.top : region.bottom, left : left + columns]
        pieces.append(_halved(piece) if halve else piece)
        left, rest = 0, rest - columns
    return pieces[0] if len(pieces) == 1 else np.hstack(pieces)


def _halved(image: Image) -> Image:
    half = (image.shape[1] // 2, image.shape[0] // 2)
    return np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA), np.uint8)


def _sample(panorama: Image, levels: Sequence[Level], view: Image) -> None:
    """Write the pixels of all levels, finest first, into the view."""
    pyramid = RegionPyramid(panorama)
    for level in levels:
        source = panorama if level.region is None else pyramid.region(level.region, level.halvings)
        _put(_remapped(source, level.cells, level.fractions), level, view)


def _sample_planes(planes: Planes, levels: Sequence[Level], view: Image) -> None:
    """The same with luma, blue and red difference. One halving makes luma as coarse as colour is."""
    luma, blue, red = RegionPyramid(planes.luma), RegionPyramid(planes.blue), RegionPyramid(planes.red)
    for level in levels:
        if level.region is None:
            sampled = [_remapped(planes.luma, level.cells, level.fractions)]
            sampled += [_remapped(plane, *level.half_as_fine) for plane in (planes.blue, planes.red)]
        else:
            half, fewer = level.region.halved, level.halvings - 1
            sources = luma.region(level.region, level.halvings), blue.region(half, fewer), red.region(half, fewer)
            sampled = [_remapped(source, level.cells, level.fractions) for source in sources]
        _put(np.asarray(cv2.merge(sampled), np.uint8), level, view)


def _remapped(source: Image, cells: NDArray[np.int16], fractions: NDArray[np.uint16]) -> Image:
    return np.asarray(cv2.remap(source, cells, fractions, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.uint8)


def _put(sampled: Image, level: Level, view: Image) -> None:
    """Write the samples of a level's pixels into the view."""
    if level.mask.all():
        view.reshape(-1, 3)[:] = sampled.reshape(-1, 3)[: level.mask.size]
        return
    view.view(PIXEL)[..., 0][level.mask] = sampled.view(PIXEL).ravel()[: np.count_nonzero(level.mask)]


def tones_of(views: Sequence[View]) -> tuple[float, float]:
    """Which shares of views are dark, and overexposed."""
    pixels = np.concatenate([view.image.reshape(-1, 1, 3) for view in views])
    limits = ((0, DARK), (WHITE, 255))
    dark, white = (cv2.countNonZero(cv2.inRange(pixels, (low,) * 3, (high,) * 3)) for low, high in limits)
    return dark / len(pixels), white / len(pixels)
