"""All faces of a scene's boxes as arrays, for looking up what a ray has hit: its place on the face and its paint."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.sim.primitives import Box
from savmap.sim.prints import Prints, prints_of
from savmap.sim.raycast import corners
from savmap.sim.textures import KINDS, LEVELS, SIZE, kind_of, tiles

Singles = NDArray[np.float32]
Indices = NDArray[np.int64]

_FIRST_HOLES = KINDS.index("holes")


@dataclass(frozen=True)
class Surfaces:
    """Faces f = 6 box + face: `corner`, unit `along` (the longer side), `aside`, `normal` (f, 3), `lengths` (f, 2) m.

    Paint of box b: `color`, `second` (b, 3), `kind`, `period` m, `contrast`, `emission`, `gloss` (b,), `offset` (b, 2).
    `prints`: pictures that cover faces.
    """

    corner: Singles
    along: Singles
    aside: Singles
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
        return np.stack([along, np.einsum("ij,ij->i", relative, self.aside.take(face, axis=0))], axis=1)

    def albedo(self, face: Indices, place: Singles, footprint: Singles) -> Singles:
        """The colour (n, 3) at `place` (n, 2) of faces (n,), blurred to the pixel's `footprint` (n,) on it, m."""
        box = face // 6
        kind, period = self.kind.take(box), self.period.take(box)
        width = np.where(kind >= _FIRST_HOLES, self.lengths[:, 1].take(face), period)
        scaled = place / np.stack([period, width], axis=1) + self.offset.take(box, axis=0)
        cells = np.floor(scaled * SIZE).astype(np.int64) & (SIZE - 1)
        level = np.log2(np.maximum(footprint * (SIZE / np.minimum(period, width)), 1.0))
        blur = np.clip(np.round(level), 0, LEVELS - 1).astype(np.int64)
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
    along, aside = np.where(swap[:, None], second, first), np.where(swap[:, None], first, second)
    lengths = np.sort(lengths, axis=1)[:, ::-1]
    normal = np.cross(first, second)
    paints = [box.material for box in boxes]
    kinds = np.array([kind_of(paint) for paint in paints])
    shift = np.array([_offset(paint.seed) for paint in paints])
    return Surfaces(
        corner=_single(quads[:, 0]),
        along=_single(along / lengths[:, :1]),
        aside=_single(aside / lengths[:, 1:]),
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
