"""Straight edges to a small part of a pixel, measured in the panorama at its own resolution (no view is rendered).

A mask gives an object and roughly its place. Each edge of the mask is cut into short pieces; each is averaged along its
length and sampled across, along short normals only. This profile of radiance gives the places where radiance changes
most. The edge is the straight line that most pieces agree on; its variance is how well they agree. Pieces hidden by
something else agree with no line and are left out.

Where a side face of the object may be visible beyond its edge ("flank"), two lines run side by side: front against side
face, and side face against the background. The inner one is the edge of the front. A change between two faces of the
same paint may be faint, but it has one sign all along.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry import sphere
from savmap.geometry.lines import Lines, weighted_lines, where
from savmap.types import Bools, FilmedPanorama, Floats, Ints, Panorama, ViewSpec, array_record

Singles = NDArray[np.float32]

ACROSS_STEP = 0.5
ALONG_STEP = 1.5
FEWEST_ALONG, MOST_ALONG = 3, 12
SHOULDER = 1.0
RADIANCE_UNIT = 65535
LEBESGUE = 1.25**2
LEAST_REACH = 4.5
SHIFTS = np.linspace(-1.2, 1.2, 9)
BIN = 0.35
RIVAL = 2.0
ALOOF = 3.0
ROUNDS = 4
BIWEIGHT = 4.7
LEAST_SIGMA, MOST_SIGMA = 0.06, 0.4
NODES = np.array(list(product((-1.0, 0.0, 1.0), repeat=2))).T
"""Where the nodes of a patch are along and across the edge (2, 9)."""


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
    length (n,). `stands`: u is the row and v the column, else u is the column. `wanted`: the numbers of those (k,) that
    are to be measured."""

    edge: Ints
    u: Floats
    v: Floats
    slope: Floats
    half: Floats
    stands: bool
    wanted: Ints


@dataclass(frozen=True, eq=False)
@array_record
class Profiles:
    """Radiance (k, 2 reach + 1), 0..1, across the k wanted of n pieces, from smaller to larger v, `ACROSS_STEP`
    panorama pixels apart,
    the edge in the middle; and how many panorama pixels one view pixel across is (n,).

    Lenses and pixels mix radiance, not grey values: across a blurred edge, grey values are not symmetric, radiance is.
    """

    radiance: Singles
    scale: Floats

    @property
    def grey(self) -> Singles:
        """The grey values (k, 2 reach + 1), 0..255, that show this radiance."""
        return np.interp(self.radiance, RADIANCE, np.arange(256)).astype(np.float32)

    @property
    def reach(self) -> int:
        """Samples on either side of the middle."""
        return int(self.radiance.shape[1] // 2)


def pieces_of(
    lines: Lines, first: Floats, last: Floats, stands: bool, length_px: tuple[float, float], wanted: Bools
) -> Pieces:
    """Pieces of lines (g,) between `first` and `last` (g,): twelve or more each, `length_px` at least and at most."""
    span = np.maximum(last - first, 0.0)
    count = np.maximum(span // np.clip(span / 12, *length_px), 0).astype(np.int64)
    edge = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    half = span / np.maximum(count, 1) / 2
    u = first[edge] + (2 * number + 1) * half[edge]
    return Pieces(edge, u, lines[edge].at(u), lines.slope[edge], half[edge], stands, np.flatnonzero(wanted[edge]))


def profiles_of(
    panorama: Panorama, spec: ViewSpec, groups: Sequence[Pieces], reach_px: float, least: float
) -> list[Profiles]:
    """Profiles across each group's wanted pieces (k >= 1), `reach_px` view pixels to either side but
    `least` panorama pixels
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
    """Where k of n pieces are sampled: panorama pixels (2, k, 9) of each patch's nodes, and what each of its
    samples, `rows`
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
    nodes = _nodes(spec, pieces, reach * ACROSS_STEP / scale, height)
    return _Patches(nodes.astype(np.float32), _basis(rows, 2 * reach + 1), rows, scale)


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
    middles = patches.nodes[:, :, 4:5]
    x, y = (patches.nodes - middles) @ patches.basis  # small numbers, so that all processors sample the same places
    x += middles[0] - np.float32(window.left)
    y += middles[1] - np.float32(window.top)
    np.clip(y, -window.top, window.last_row - window.top, out=y)
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
    """Panorama pixels (2, n, ...), columns and rows, of view pixels (n, ...), moved by whole turns to lie next to those
    in the middle of n."""
    camera = spec.camera
    x, y = (v, u) if stands else (u, v)
    x, y = (x - camera[0, 2]) / camera[0, 0], (y - camera[1, 2]) / camera[1, 1]
    rig_x, rig_y, rig_z = (right * x + down * y + forward for right, down, forward in spec.rig_from_view.tolist())
    pixels = np.array(sphere.columns_and_rows(rig_x, rig_y, rig_z, height))
    pixels[0] -= 2 * height * np.round((pixels[0] - pixels[0, len(u) // 2]) / (2 * height))
    return pixels


def _scales(spec: ViewSpec, pieces: Pieces, height: int) -> tuple[Floats, Floats]:
    """Panorama pixels a view pixel (n,), across and along the edge."""
    u, v = np.array([pieces.u, pieces.u, pieces.u + 1]), np.array([pieces.v + 1, pieces.v, pieces.v + pieces.slope])
    pixels = _panorama_pixels(spec, u, v, pieces.stands, height)
    across, _, along = np.hypot(*(pixels - pixels[:, 1:2]))
    return across, along


def _nodes(spec: ViewSpec, pieces: Pieces, reach_px: Floats, height: int) -> Floats:
    """Exact panorama pixels (2, k, 9) of the corners, middles of the sides, and middle of each patch."""
    at = pieces.wanted
    along, across = NODES[:, :, None] * np.array([pieces.half[at], reach_px[at]])[:, None]
    u, v = pieces.u[at] + along, pieces.v[at] + pieces.slope[at] * along + across
    return _panorama_pixels(spec, u, v, pieces.stands, height).transpose(0, 2, 1)


@cache
def _basis(rows: int, columns: int) -> Singles:
    """What samples all over a patch take of its nodes (9, rows columns): interpolation to second order."""
    along = _second_order((np.arange(rows) + 0.5) / rows * 2 - 1)
    across = _second_order(np.linspace(-1, 1, columns))
    return np.asarray(np.einsum("ra,cb->abrc", along, across).reshape(9, -1), np.float32)


def _second_order(x: Floats) -> Floats:
    """Lagrange's polynomials (m, 3) for nodes at -1, 0, 1."""
    return np.stack([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2], axis=-1)


@dataclass(frozen=True)
class Subpixel:
    """Settings; pixels of the view unless they say panorama.

    - `reach_px`: how far from the mask's edge to look; `prior_px`: how far off the mask's edge usually is (sigma),
      and `flanked_bias_px`: how far too far outside if it is flanked.
    - `piece_px`: least and greatest length of a piece; `end_trim_px`: what is left out at either end.
    - `least_contrast`: changes of less grey levels a panorama pixel are none; `full_contrast`: stronger ones count
      alike.
    - `least_support`: support that the chosen line must have, of 1, and `clear`: how many times that of any other line.
    - `least_share`, `least_pieces`: share and number of the pieces that must agree with it.
    - `inner`: share of the best line's support that a line further inside needs to be taken for the front's edge, and
      how far inside it may be, as a share of the object's thickness; `patterned_inner`: of objects with a pattern.
    - `depth`: how deep objects are, as a multiple of their thickness; flanks that appear wider than `resolved` panorama
      pixels are told from the front; narrow ones blur the edge by `unresolved` of their width.
    - `common_sigma`: what all pieces of an edge may be off together, panorama pixels; `patterned_sigma_px`: the same of
      flanked edges of objects with a pattern, which may have lines beside their edges.
    - `mask_sigma_px`, `flanked_sigma_px`: the same of edges that are left as masks have them.
    """

    reach_px: float = 3.0
    prior_px: float = 1.2
    flanked_bias_px: float = 0.5
    piece_px: tuple[float, float] = (2.0, 6.0)
    end_trim_px: float = 3.0
    least_contrast: float = 1.5
    full_contrast: float = 12.0
    least_support: float = 0.15
    clear: float = 1.6
    least_share: float = 0.3
    least_pieces: int = 4
    inner: tuple[float, float] = (0.3, 0.4)
    patterned_inner: tuple[float, float] = (0.5, 0.2)
    depth: float = 1.0
    resolved: float = 0.6
    unresolved: float = 0.8
    common_sigma: float = 0.1
    patterned_sigma_px: float = 0.7
    mask_sigma_px: float = 0.4
    flanked_sigma_px: float = 1.2


@dataclass(frozen=True, eq=False)
@array_record
class Edges:
    """g edges of masks: lines v(u) in view pixels; `first` and `last` u (g,) of the mask; `inside` (g,): +1 where the
    object lies at larger v, -1 at smaller; its `thickness` (g,) in pixels; `flank` (g,), the tangent of the angle at
    which its side face is visible beyond the edge, 0 where it is not; `stands`: u is the row and v the column;
    `patterned`: objects have a pattern along them, such as rows of holes; `wanted` (g,): those to be measured, where
    not all are.
    """

    lines: Lines
    first: Floats
    last: Floats
    inside: Floats
    thickness: Floats
    flank: Floats
    stands: bool
    patterned: bool = False
    wanted: Bools | None = None

    @property
    def middle(self) -> Floats:
        """u (g,) half way between the ends."""
        return (self.first + self.last) / 2

    @property
    def half(self) -> Floats:
        """Half the length along u (g,)."""
        return (self.last - self.first) / 2


@dataclass(frozen=True, eq=False)
@array_record
class Changes:
    """Where radiance changes most across pieces (m,): the edge, how far along it (-1..1 from end to end), how far
    inwards of the mask's edge, view pixels; the change going inwards, grey levels a panorama pixel; panorama pixels a
    view pixel."""

    edge: Ints
    along: Floats
    inwards: Floats
    change: Floats
    scale: Floats


def measured(
    panorama: Panorama, spec: ViewSpec, groups: Sequence[Edges], settings: Subpixel | None = None
) -> list[tuple[Lines, Bools]]:
    """For each group of edges: the lines measured in the panorama, and which (g,) could be measured.

    The others keep the mask's line, with the standard deviation of masks. Variances are px^2 of the view.
    """
    settings = settings or Subpixel()
    cut = [_pieces(edges, settings) for edges in groups]
    with_pieces = [pieces for pieces in cut if len(pieces.wanted)]
    profiles = iter(profiles_of(panorama, spec, with_pieces, settings.reach_px, LEAST_REACH))
    return [
        _measured(edges, pieces, next(profiles), settings)
        if len(pieces.wanted)
        else (_as_masked(edges, settings), np.zeros(len(edges.first), dtype=np.bool_))
        for edges, pieces in zip(groups, cut, strict=True)
    ]


def _pieces(edges: Edges, settings: Subpixel) -> Pieces:
    trim = np.minimum(settings.end_trim_px, edges.half / 4)
    wanted = np.ones(len(trim), np.bool_) if edges.wanted is None else edges.wanted
    return pieces_of(edges.lines, edges.first + trim, edges.last - trim, edges.stands, settings.piece_px, wanted)


def _measured(edges: Edges, pieces: Pieces, profiles: Profiles, settings: Subpixel) -> tuple[Lines, Bools]:
    scale = np.maximum(_mean(pieces.edge, profiles.scale, len(edges.first)), 1e-9)
    numbers = np.bincount(pieces.edge, minlength=len(edges.first))
    changes = _changes(profiles, pieces, edges, settings)
    offset, shift, clear = _chosen(changes, edges, scale, numbers, settings)
    lines = _fitted(changes, edges, offset, shift, scale, settings)
    agree = (lines.inliers >= settings.least_pieces) & (lines.inliers >= settings.least_share * numbers)
    measured = clear & agree & np.isfinite(lines.offset) & np.isfinite(lines.slope_var)
    return where(measured, lines, _as_masked(edges, settings)), measured


def _as_masked(edges: Edges, settings: Subpixel) -> Lines:
    """The masks' lines, with the variance of a mask's common error along an edge."""
    common = np.where(edges.flank > 0, settings.flanked_sigma_px, settings.mask_sigma_px)
    return replace(edges.lines, offset_var=edges.lines.offset_var + common**2)


def _mean(group: Ints, values: Floats, count: int) -> Floats:
    total = np.bincount(group, values, count) / np.maximum(np.bincount(group, minlength=count), 1)
    return np.asarray(total, np.float64)


def _changes(profiles: Profiles, pieces: Pieces, edges: Edges, settings: Subpixel) -> Changes:
    """Extrema of the smoothed derivative of radiance, by parabolas through three samples."""
    slope = _derivative(profiles.grey)
    size = np.abs(_derivative(profiles.radiance))
    before, here, after = size[:, :-2], size[:, 1:-1], size[:, 2:]
    peak = (here > before) & (here >= after) & (np.abs(slope[:, 1:-1]) > settings.least_contrast)
    row, sample = np.nonzero(peak)
    before, here, after = before[row, sample], here[row, sample], after[row, sample]
    vertex = (before - after) / np.minimum(2 * (before - 2 * here + after), -1e-12)
    piece = pieces.wanted[row]
    away = (sample + 1 + np.clip(vertex, -0.5, 0.5) - profiles.reach) * ACROSS_STEP / profiles.scale[piece]
    near = np.abs(away) <= np.maximum(settings.reach_px, LEAST_REACH / profiles.scale[piece])
    piece, row, sample = piece[near], row[near], sample[near]
    edge = pieces.edge[piece]
    along = (pieces.u[piece] - edges.middle[edge]) / edges.half[edge]
    inside = edges.inside[edge]
    return Changes(edge, along, away[near] * inside, slope[row, sample + 1] * inside, profiles.scale[piece])


def _derivative(values: Singles) -> Singles:
    """Smoothed first derivative along the rows (n, k), per panorama pixel; 0 at the ends."""
    slope = np.zeros_like(values)
    slope[:, 1:-1] = (values[:, 2:] - values[:, :-2]) / (2 * ACROSS_STEP)
    slope[:, 1:-1] = 0.25 * slope[:, :-2] + 0.5 * slope[:, 1:-1] + 0.25 * slope[:, 2:]
    return slope


def _chosen(
    changes: Changes, edges: Edges, scale: Floats, numbers: Ints, settings: Subpixel
) -> tuple[Floats, Floats, Bools]:
    """How far inwards (g,) of the mask's edge the best line is, its shift (g,) at the end, whether it stands out."""
    size = BIN / float(np.median(scale))
    half = int(np.ceil((settings.reach_px + SHIFTS[-1]) / size))
    inwards = np.asarray((np.arange(2 * half + 1) - half) * size, np.float64)
    flanked = settings.depth * edges.thickness * edges.flank * scale > settings.resolved
    size_of = np.clip(changes.change / settings.full_contrast, -1.0, 1.0).astype(np.float64)
    weight = np.where(flanked[changes.edge], size_of, np.abs(size_of))
    votes = np.abs(_votes(changes, weight, len(scale), (size, half))) / np.maximum(numbers, 1)[:, None, None]
    support = votes.max(axis=1)
    usual = np.where(flanked, settings.flanked_bias_px, 0.0)[:, None]
    likely = support * np.exp(-0.5 * np.square((inwards - usual) / settings.prior_px))
    inner, within = settings.patterned_inner if edges.patterned else settings.inner
    best = _front(likely, flanked, inwards < within * edges.thickness[:, None], inner)
    rows = np.arange(len(scale))
    further = inwards - inwards[best][:, None]
    distinct = np.where(flanked[:, None], further, np.abs(further)) * scale[:, None] > RIVAL
    rival = np.where(distinct, likely, 0.0).max(axis=1)
    clear = (support[rows, best] > settings.least_support) & (likely[rows, best] > settings.clear * rival)
    return inwards[best], SHIFTS[votes[rows, :, best].argmax(axis=1)], clear


def _votes(changes: Changes, weight: Floats, count: int, bins: tuple[float, int]) -> Floats:
    """Support (g, shifts, bins) of lines that are so far inwards in the middle and shifted by so much at the end."""
    size, half = bins
    width = 2 * half + 1
    place = (changes.inwards - SHIFTS[:, None] * changes.along) / size + half
    np.clip(place, 0, width - 1 - 1e-6, out=place)
    cell = place.astype(np.int64)
    part = (place - cell) * weight
    flat = cell + width * (len(SHIFTS) * changes.edge + np.arange(len(SHIFTS))[:, None])
    most = count * len(SHIFTS) * width
    below, above = (np.bincount(flat.ravel(), share.ravel(), most) for share in (weight - part, part))
    votes: Floats = np.asarray(below + np.roll(above, 1), np.float64).reshape(count, len(SHIFTS), width)
    votes[..., 1:-1] += (votes[..., :-2] + votes[..., 2:]) / 2
    return votes


def _front(likely: Floats, flanked: Bools, allowed: Bools, inner: float) -> Ints:
    """The bin (g,) of the likeliest line; of flanked edges the innermost peak that is at least `inner` as likely."""
    peak = np.zeros(likely.shape, dtype=np.bool_)
    peak[:, 1:-1] = (likely[:, 1:-1] > likely[:, :-2]) & (likely[:, 1:-1] >= likely[:, 2:])
    peak &= (likely >= inner * likely.max(axis=1, keepdims=True)) & allowed
    innermost = likely.shape[1] - 1 - peak[:, ::-1].argmax(axis=1)
    front: Ints = np.where(flanked & peak.any(axis=1), innermost, likely.argmax(axis=1)).astype(np.int64)
    return front


def _fitted(changes: Changes, edges: Edges, offset: Floats, shift: Floats, scale: Floats, settings: Subpixel) -> Lines:
    """Robust lines (Tukey's biweight) through the changes near the chosen ones; their inliers are pieces that agree."""
    count = len(offset)
    distance = changes.inwards - offset[changes.edge] - shift[changes.edge] * changes.along
    near = np.abs(distance) * changes.scale < 3 * MOST_SIGMA
    edge, fine, v = changes.edge[near], changes.scale[near], changes.inwards[near]
    u = changes.along[near] * edges.half[edge]
    clarity = np.minimum(np.abs(changes.change[near]), settings.full_contrast) * fine**2
    weight, sigma = np.ones(len(u)), np.full(count, MOST_SIGMA)
    for _ in range(ROUNDS):
        centre, slope, middle = weighted_lines(edge, u, v, weight * clarity, count)
        residual = (v - middle[edge] - slope[edge] * (u - centre[edge])) * fine
        weight = np.square(np.maximum(0.0, 1 - np.square(residual / (BIWEIGHT * sigma[edge]))))
        total = np.maximum(np.bincount(edge, weight, count), 1e-9)
        sigma = np.clip(1.2 * np.sqrt(np.bincount(edge, weight * residual**2, count) / total), LEAST_SIGMA, MOST_SIGMA)
    spread = np.maximum(np.bincount(edge, weight * np.square(u - centre[edge]), count), 1e-9)
    at = edges.middle + centre
    return replace(
        edges.lines,
        centre=at,
        slope=edges.lines.slope + edges.inside * slope,
        offset=edges.lines.at(at) + edges.inside * middle,
        slope_var=np.square(sigma / scale) / spread,
        offset_var=np.square(sigma / scale) / total + _common_variance(edges, scale, settings),
        inliers=np.bincount(edge[weight > 0.1], minlength=count).astype(np.float64),
    )


def _common_variance(edges: Edges, scale: Floats, settings: Subpixel) -> Floats:
    """What the pieces of an edge (g,) may all be off together, px^2: blur, and flanks too narrow to be told apart."""
    flank = settings.depth * edges.thickness * edges.flank * scale
    blurred = settings.unresolved * np.minimum(
        flank, np.interp(flank, (settings.resolved, ALOOF), (settings.resolved, 0))
    )
    pattern = np.where(edges.patterned & (flank > 0), settings.patterned_sigma_px, 0.0)
    variance: Floats = (settings.common_sigma**2 + np.square(blurred)) / np.square(scale) + np.square(pattern)
    return variance
