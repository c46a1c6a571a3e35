"""Grey profiles across straight edges, sampled from a panorama at its own resolution.

An edge is cut into short pieces; each is averaged along its length and sampled across, along short normals only. No
view is rendered for this.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry import sphere
from savmap.geometry.lines import Lines
from savmap.types import FilmedPanorama, Floats, Ints, Panorama, ViewSpec, array_record

Singles = NDArray[np.float32]

ACROSS_STEP = 0.5
ALONG_STEP = 1.5
FEWEST_ALONG, MOST_ALONG = 3, 12
SHOULDER = 1.0
RADIANCE_UNIT = 65535
LEBESGUE = 1.25**2


def _radiance() -> Floats:
    """Radiance (256,), 0..1, of each grey value of a camera: the inverse of the sRGB curve and a film-like shoulder."""
    shown = np.arange(256) / 255
    decoded = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    radiance: Floats = decoded * SHOULDER / (1 + SHOULDER - decoded)
    return radiance


RADIANCE = _radiance()


@dataclass(frozen=True, eq=False)
@array_record
class Pieces:
    """Short pieces of edges, in view pixels: the number of its edge (n,), from 0; middle u and v (n,), slope (n,), half
    length (n,). `stands`: u is the row and v the column, else u is the column."""

    edge: Ints
    u: Floats
    v: Floats
    slope: Floats
    half: Floats
    stands: bool


@dataclass(frozen=True, eq=False)
@array_record
class Profiles:
    """Radiance (n, 2 reach + 1), 0..1, across n pieces, from smaller to larger v, `ACROSS_STEP` panorama pixels apart,
    the edge in the middle; and how many panorama pixels one view pixel across is (n,).

    Lenses and pixels mix radiance, not grey values: across a blurred edge, grey values are not symmetric, radiance is.
    """

    radiance: Singles
    scale: Floats

    @property
    def grey(self) -> Singles:
        """The grey values (n, 2 reach + 1), 0..255, that show this radiance."""
        return np.interp(self.radiance, RADIANCE, np.arange(256)).astype(np.float32)

    @property
    def reach(self) -> int:
        """Samples on either side of the middle."""
        return int(self.radiance.shape[1] // 2)


def pieces_of(lines: Lines, first: Floats, last: Floats, stands: bool, length_px: tuple[float, float]) -> Pieces:
    """Pieces of lines (g,) between `first` and `last` (g,): twelve or more each, `length_px` at least and at most."""
    span = np.maximum(last - first, 0.0)
    count = np.maximum(span // np.clip(span / 12, *length_px), 0).astype(np.int64)
    edge = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    half = span / np.maximum(count, 1) / 2
    u = first[edge] + (2 * number + 1) * half[edge]
    return Pieces(edge, u, lines[edge].at(u), lines.slope[edge], half[edge], stands)


def profiles_of(
    panorama: Panorama, spec: ViewSpec, groups: Sequence[Pieces], reach_px: float, least: float
) -> list[Profiles]:
    """Profiles across each group's pieces (n >= 1), `reach_px` view pixels to either side but `least` panorama pixels
    anyhow.

    The part of the panorama that they all lie in is decoded once.
    """
    patches = [_patches(spec, pieces, panorama.height, reach_px, least) for pieces in groups]
    if not patches:
        return []
    patches = _side_by_side(patches, panorama.height)
    window = _window(panorama, patches)
    return [Profiles(_across(window, patch), patch.scale) for patch in patches]


@dataclass(frozen=True, eq=False)
@array_record
class _Patches:
    """Where n pieces are sampled: panorama pixels (2, n, 9) of each patch's nodes, and what each of its samples, `rows`
    along the edge, takes of them (9, m); panorama pixels a view pixel (n,)."""

    nodes: Singles
    basis: Singles
    rows: int
    scale: Floats

    @property
    def extent(self) -> tuple[Singles, Singles]:
        """Least and largest pixels (2,), no less than samples reach: parabolas through three nodes each way leave half
        the nodes' range by a quarter of it at most (Lebesgue's constant is 5/4)."""
        low, high = self.nodes.min(axis=-1), self.nodes.max(axis=-1)
        beyond = (high - low) * (LEBESGUE - 1) / 2
        return (low - beyond).min(axis=-1), (high + beyond).max(axis=-1)


def _patches(spec: ViewSpec, pieces: Pieces, height: int, reach_px: float, least: float) -> _Patches:
    scale, along = _scales(spec, pieces, height)
    reach = int(np.ceil(max(least, reach_px * float(np.median(scale))) / ACROSS_STEP))
    rows = int(np.clip(np.ceil(np.median(2 * pieces.half * along) / ALONG_STEP), FEWEST_ALONG, MOST_ALONG))
    nodes = _nodes(spec, pieces, reach * ACROSS_STEP / scale, height).reshape(-1, 9, 2)
    return _Patches(
        np.ascontiguousarray(nodes.transpose(2, 0, 1), np.float32), _basis(rows, 2 * reach + 1), rows, scale
    )


@dataclass(frozen=True, eq=False)
@array_record
class _Window:
    """Radiance (h, w), 0..65535, of part of a panorama; its first column and row; the panorama's last row."""

    radiance: NDArray[np.uint16]
    left: int
    top: int
    last_row: int


def _side_by_side(patches: Sequence[_Patches], height: int) -> list[_Patches]:
    """The patches, moved by whole turns of the panorama to lie next to one another."""
    width = 2 * height
    directions = np.concatenate([patch.nodes[0, :, 4] for patch in patches]) * np.float32(2 * np.pi / width)
    first = np.arctan2(np.sin(directions).mean(), np.cos(directions).mean()) * width / (2 * np.pi) - width / 2
    moved = []
    for patch in patches:
        nodes = patch.nodes.copy()
        nodes[0] -= np.float32(width) * np.floor((nodes[0, :, 4:5] - np.float32(first)) / width)
        moved.append(replace(patch, nodes=nodes))
    return moved


def _window(panorama: Panorama, patches: Sequence[_Patches]) -> _Window:
    """The part of the panorama that patches, which lie next to one another, are sampled from."""
    height, width = panorama.height, 2 * panorama.height
    extents = np.array([patch.extent for patch in patches])
    (left, top), (right, bottom) = np.floor(extents[:, 0].min(axis=0)), np.ceil(extents[:, 1].max(axis=0)) + 2
    columns, rows = (int(left), int(min(right, left + width))), (int(np.clip(top, 0, height - 1)), int(max(bottom, 1)))
    part, grey = _grey(panorama, rows, columns)
    table = np.round(np.interp(grey, np.arange(256), RADIANCE) * RADIANCE_UNIT).astype(np.uint16)
    return _Window(np.asarray(cv2.LUT(np.ascontiguousarray(part), table), np.uint16), columns[0], rows[0], height - 1)


def _across(window: _Window, patches: _Patches) -> Singles:
    """Mean radiance (n, k), 0..1, along the rows of each patch, by linear interpolation."""
    x, y = patches.nodes @ patches.basis
    np.clip(y, 0, window.last_row, out=y)
    x -= window.left
    y -= window.top
    sampled = np.asarray(cv2.remap(window.radiance, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.uint16)
    total = sampled.reshape(len(sampled), patches.rows, -1).sum(axis=1, dtype=np.float32)
    return np.asarray(total / np.float32(patches.rows * RADIANCE_UNIT), np.float32)


def _grey(panorama: Panorama, rows: tuple[int, int], columns: tuple[int, int]) -> tuple[NDArray[np.uint8], Floats]:
    """Values of part of a panorama, and the grey (256,), 0..255, that each stands for."""
    if isinstance(panorama, FilmedPanorama):
        return _columns(panorama.planes.luma[slice(*rows)], *columns), panorama.planes.grey
    part = _columns(panorama.image[slice(*rows)], *columns)
    return np.asarray(cv2.cvtColor(part, cv2.COLOR_RGB2GRAY), np.uint8), np.arange(256.0)


def _columns(image: NDArray[np.uint8], left: int, right: int) -> NDArray[np.uint8]:
    """Columns [left, right) of a panorama, which may cross the seam."""
    width = image.shape[1]
    turned = left // width * width
    left, right = left - turned, right - turned
    return image[:, left:right] if right <= width else np.hstack([image[:, left:], image[:, : right - width]])


def _panorama_pixels(spec: ViewSpec, u: Floats, v: Floats, stands: bool, height: int) -> Floats:
    pixels = np.stack([v, u] if stands else [u, v], axis=-1)
    return sphere.panorama_pixels_from_rays(spec.rig_rays(pixels), height)


def _scales(spec: ViewSpec, pieces: Pieces, height: int) -> tuple[Floats, Floats]:
    """Panorama pixels a view pixel (n,), across and along the edge."""
    here = _panorama_pixels(spec, pieces.u, pieces.v, pieces.stands, height)
    across = _panorama_pixels(spec, pieces.u, pieces.v + 1, pieces.stands, height)
    along = _panorama_pixels(spec, pieces.u + 1, pieces.v + pieces.slope, pieces.stands, height)
    return _length(_unwrapped(across, here, height) - here), _length(_unwrapped(along, here, height) - here)


def _length(vectors: Floats) -> Floats:
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def _unwrapped(pixels: Floats, near: Floats, height: int) -> Floats:
    """Panorama pixels (..., 2) whose columns are moved by whole turns to lie next to those of `near`."""
    turns = np.round((pixels[..., :1] - near[..., :1]) / (2 * height))
    near_by: Floats = pixels - np.concatenate([2 * height * turns, np.zeros_like(turns)], axis=-1)
    return near_by


def _nodes(spec: ViewSpec, pieces: Pieces, reach_px: Floats, height: int) -> Floats:
    """Exact panorama pixels (n, 3, 3, 2) of the corners, middles of the sides, and middle of each piece's patch."""
    steps = np.array([-1.0, 0.0, 1.0])
    along = (pieces.half[:, None] * steps)[:, :, None] + np.zeros(3)
    across = (reach_px[:, None] * steps)[:, None, :]
    u = pieces.u[:, None, None] + along
    v = pieces.v[:, None, None] + pieces.slope[:, None, None] * along + across
    exact = _panorama_pixels(spec, u, v, pieces.stands, height)
    return _unwrapped(exact, exact[:, 1:2, 1:2], height)


def _basis(rows: int, columns: int) -> Singles:
    """What samples all over a patch take of its nodes (9, rows columns): interpolation to second order."""
    along = _second_order((np.arange(rows) + 0.5) / rows * 2 - 1)
    across = _second_order(np.linspace(-1, 1, columns))
    return np.asarray(np.einsum("ra,cb->abrc", along, across).reshape(9, -1), np.float32)


def _second_order(x: Floats) -> Floats:
    """Lagrange's polynomials (m, 3) for nodes at -1, 0, 1."""
    return np.stack([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2], axis=-1)
