"""All faces of a scene's boxes as arrays, for looking up what a ray has hit: its place on the face and its paint.

Paints are procedural patterns, as tiles that span one period in both directions and repeat without a seam, and prints:
pictures that cover a face, such as a text on a plate. Both are looked up at the degree of blur that a pixel sees.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.lab.scenes import FACES, Box, Face, Material
from savmap.lab.sim.render.raycast import corners
from savmap.types import Floats

Singles = NDArray[np.float32]
Indices = NDArray[np.int64]

SIZE = 256
_BLURS = 8
_HOLES = ("holes", "holes-slot", "holes-double")
KINDS = ("plain", "noise", "wood", "carton", "stripes", "wire", "scratches", *_HOLES)
_FIRST_HOLES = KINDS.index("holes")

_ACROSS: dict[Face, int] = {"-x": 2, "+x": 2, "-z": 0, "+z": 0}
_PRINT_LEVELS = 7


@dataclass(frozen=True, eq=False)
class Print:
    """A picture on a face: `levels`, each half as fine as the one before, linear RGB (h, w, 3); `size` (2,) m, across
    and up.

    `swapped`: its places are given as up and across, not as across and up."""

    levels: tuple[Singles, ...]
    size: tuple[float, float]
    swapped: bool

    def colors(self, place: Singles, footprint: Singles) -> Singles:
        """Linear RGB (n, 3) at `place` (n, 2) m from the face's lower left corner, blurred to pixels `footprint` (n,) m
        wide."""
        right, up = (place[:, ::-1] if self.swapped else place).T
        level = np.round(np.log2(np.maximum(footprint * (self.levels[0].shape[1] / self.size[0]), 1.0)))
        level = np.minimum(level.astype(np.int64), len(self.levels) - 1)
        colors = np.empty((len(place), 3), np.float32)
        for index in np.unique(level):
            chosen, picture = level == index, self.levels[index]
            u = (right[chosen] / self.size[0] * picture.shape[1] - 0.5).astype(np.float32)
            v = ((1 - up[chosen] / self.size[1]) * picture.shape[0] - 0.5).astype(np.float32)
            for part in range(0, len(u), 30000):
                at = slice(part, part + 30000)
                seen = cv2.remap(picture, u[at, None], v[at, None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
                colors[np.flatnonzero(chosen)[at]] = seen[:, 0]
        return colors


@dataclass(frozen=True, eq=False)
class Prints:
    """The printed faces of a scene, by face number (6 box + face), and the numbers in order (k,)."""

    by_face: dict[int, Print]
    numbers: Indices

    def paint(self, color: Singles, face: Indices, place: Singles, footprint: Singles) -> None:
        """Put the prints' colours into `color` (n, 3) where faces (n,) carry one."""
        if not len(self.numbers):
            return
        printed = np.flatnonzero(np.isin(face, self.numbers))
        for number in np.unique(face[printed]).tolist():
            chosen = printed[face[printed] == number]
            color[chosen] = self.by_face[number].colors(place[chosen], footprint[chosen])


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Faces f = 6 box + face: `corner`, unit `along` (the longer side), `across`, `normal` (f, 3), `lengths` (f, 2) m.

    Paint of box b: `color`, `second` (b, 3), `kind`, `period` m, `contrast`, `emission`, `gloss` (b,), `offset` (b, 2).
    `prints`: pictures that cover faces.
    """

    corner: Singles
    along: Singles
    across: Singles
    normal: Singles
    lengths: Singles
    color: Singles
    second: Singles
    kind: Indices
    period: Singles
    contrast: Singles
    offset: Singles
    emission: Singles
    gloss: Singles
    prints: Prints

    def place(self, face: Indices, point: Singles) -> Singles:
        """Where points (n, 3) lie on their faces (n,): metres (n, 2) along and aside of the face's corner."""
        relative = point - self.corner.take(face, axis=0)
        along = np.einsum("ij,ij->i", relative, self.along.take(face, axis=0))
        return np.stack([along, np.einsum("ij,ij->i", relative, self.across.take(face, axis=0))], axis=1)

    def albedo(self, face: Indices, place: Singles, footprint: Singles) -> Singles:
        """The colour (n, 3) at `place` (n, 2) of faces (n,), blurred to the pixel's `footprint` (n,) on it, m."""
        box = face // 6
        kind, period = self.kind.take(box), self.period.take(box)
        width = np.where(kind >= _FIRST_HOLES, self.lengths[:, 1].take(face), period)
        scaled = place / np.stack([period, width], axis=1) + self.offset.take(box, axis=0)
        cells = np.floor(scaled * SIZE).astype(np.int64) & (SIZE - 1)
        level = np.log2(np.maximum(footprint * (SIZE / np.minimum(period, width)), 1.0))
        blur = np.clip(np.round(level), 0, _BLURS - 1).astype(np.int64)
        texel = ((blur * len(KINDS) + kind) * SIZE + cells[:, 1]) * SIZE + cells[:, 0]
        share = tiles().reshape(-1).take(texel) * (self.contrast.take(box) / np.float32(255))
        color: Singles = self.color.take(box, axis=0)
        color += share[:, None] * (self.second.take(box, axis=0) - color)
        self.prints.paint(color, face, place, footprint)
        return color

    def mean_albedo(self) -> Singles:
        """The colour (b, 3) of every box as seen from far away."""
        share = tiles()[-1].mean((1, 2))[self.kind] * (self.contrast / 255)
        mean: Singles = (self.color + share[:, None] * (self.second - self.color)).astype(np.float32)
        return mean


def surfaces_of(boxes: Sequence[Box]) -> Surfaces:
    """The faces and paints of boxes."""
    quads = np.array([corners(box) for box in boxes]).reshape(-1, 4, 3)
    first, second = quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0]
    lengths = np.stack([np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)], axis=1)
    swap = lengths[:, 1] > lengths[:, 0]
    along, across = np.where(swap[:, None], second, first), np.where(swap[:, None], first, second)
    lengths = np.sort(lengths, axis=1)[:, ::-1]
    normal = np.cross(first, second)
    paints = [box.material for box in boxes]
    kinds = np.array([kind_of(paint) for paint in paints])
    shift = np.array([_offset(paint.seed) for paint in paints])
    return Surfaces(
        corner=_single(quads[:, 0]),
        along=_single(along / lengths[:, :1]),
        across=_single(across / lengths[:, 1:]),
        normal=_single(normal / np.linalg.norm(normal, axis=1, keepdims=True)),
        lengths=_single(lengths),
        color=_single([paint.color for paint in paints]),
        second=_single([paint.second_color for paint in paints]),
        kind=kinds,
        period=_single([paint.scale_m for paint in paints]),
        contrast=_single([paint.contrast for paint in paints]),
        offset=_single(np.where(kinds[:, None] >= _FIRST_HOLES, 0.0, shift)),
        emission=_single([paint.emission for paint in paints]),
        gloss=_single([0.04 + 0.5 * paint.metallic if paint.roughness < 0.45 else 0.0 for paint in paints]),
        prints=prints_of(boxes, swap),
    )


def _single(values: object) -> Singles:
    return np.ascontiguousarray(values, dtype=np.float32)


def _offset(seed: int) -> tuple[float, float]:
    return (seed % 9973) / 9973, (seed % 7919) / 7919


def prints_of(boxes: Sequence[Box], swapped: NDArray[np.bool_]) -> Prints:
    """The printed faces; `swapped` (f,): faces whose place is given along their second side, upwards, first."""
    by_face: dict[int, Print] = {}
    for index, box in enumerate(boxes):
        for face, picture in box.prints.items():
            number = 6 * index + FACES.index(face)
            size = float(box.size[_ACROSS[face]]), float(box.size[1])
            by_face[number] = Print(_levels(picture), size, bool(swapped[number]))
    return Prints(by_face, np.array(sorted(by_face), np.int64))


def _levels(picture: NDArray[np.uint8]) -> tuple[Singles, ...]:
    encoded = picture.astype(np.float32) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(np.float32)
    levels = [linear]
    while len(levels) < _PRINT_LEVELS and min(levels[-1].shape[:2]) > 3:
        half = levels[-1].shape[1] // 2, levels[-1].shape[0] // 2
        levels.append(np.asarray(cv2.resize(levels[-1], half, interpolation=cv2.INTER_AREA), np.float32))
    return tuple(levels)


def kind_of(material: Material) -> int:
    """The index in KINDS of a material's pattern; punched holes come in three shapes, by the material's seed."""
    name = _HOLES[material.seed % len(_HOLES)] if material.texture == "holes" else material.texture
    return KINDS.index(name)


@cache
def tiles() -> NDArray[np.uint8]:
    """All patterns (blurs, kinds, SIZE, SIZE): level l is blurred to cells of 2**l, the axes are (v, u)."""
    sharp = np.stack([_pattern(kind) for kind in KINDS])
    return np.stack([_blurred(sharp, 1 << level) for level in range(_BLURS)])


def _blurred(sharp: Floats, step: int) -> NDArray[np.uint8]:
    cells = SIZE // step
    mean = sharp.reshape(len(sharp), cells, step, cells, step).mean((2, 4))
    tile: NDArray[np.uint8] = np.round(255 * mean.repeat(step, 1).repeat(step, 2)).astype(np.uint8)
    return tile


def _pattern(kind: str) -> Floats:
    grid = (np.arange(SIZE) + 0.5) / SIZE
    u, v = np.meshgrid(grid, grid)
    from_middle_u, from_middle_v = abs(u - 0.5), abs(v - 0.5)
    patterns: dict[str, Callable[[], Floats]] = {
        "plain": lambda: np.zeros((SIZE, SIZE)),
        "noise": lambda: _fractal(1.0, 1.3, 1),
        "wood": lambda: _fractal(14.0, 1.0, 2),
        "carton": lambda: np.maximum(0.5 * _fractal(1.0, 0.9, 3), _carton(u, v)),
        "stripes": lambda: ((u + v) % 1 < 0.5).astype(np.float64),
        "wire": lambda: ((from_middle_u < 0.43) & (from_middle_v < 0.43)).astype(np.float64),
        "scratches": lambda: np.clip(_fractal(30.0, 0.8, 4) * 1.4 - 0.3, 0, 1),
        "holes": lambda: (np.hypot(from_middle_u, from_middle_v * 1.6) < 0.26).astype(np.float64),
        "holes-slot": lambda: ((from_middle_u < 0.33) & (from_middle_v < 0.08)).astype(np.float64),
        "holes-double": lambda: ((from_middle_u < 0.24) & (abs(from_middle_v - 0.24) < 0.08)).astype(np.float64),
    }
    return patterns[kind]()


def _carton(u: Floats, v: Floats) -> Floats:
    tape = 0.7 * (abs(v - 0.3) < 0.05)
    flap = 1.0 * (abs(u - 0.62) < 0.006)
    pattern: Floats = np.maximum(tape, flap)
    return pattern


def _fractal(stretch: float, slope: float, seed: int) -> Floats:
    """Noise (SIZE, SIZE) in 0..1 with a falling spectrum, `stretch` times longer along u."""
    frequency = np.fft.fftfreq(SIZE) * SIZE
    fu, fv = np.meshgrid(frequency * stretch, frequency)
    radius = np.hypot(fu, fv)
    amplitude = np.where(radius > 0, np.maximum(radius, 1.0) ** -slope, 0.0)
    spectrum = amplitude * np.fft.fft2(np.random.default_rng(seed).normal(size=(SIZE, SIZE)))
    wave = np.fft.ifft2(spectrum).real
    noise: Floats = np.clip(0.5 + 0.22 * wave / wave.std(), 0, 1)
    return noise
