"""Many small textures in one picture, each with its halvings, so that one look-up colours a whole view."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

TILE = 256
LEVELS = 5
"""Halvings of a tile: 256, 128, 64, 32 and 16 texels."""

Texture = NDArray[np.uint8]
"""(TILE, TILE, 4): RGB and how much of the face's tint applies; for translucent faces, how opaque it is."""

_COLUMNS = 16
_STARTS = (0, 256, 384, 448, 480)


@dataclass(frozen=True)
class Atlas:
    """Tiles of TILE texels in columns; below each tile its halvings."""

    pixels: NDArray[np.uint8]

    def corner(self, tile: NDArray[np.int32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Left and top of tiles in texels."""
        return (tile % _COLUMNS * TILE).astype(np.float32), (tile // _COLUMNS * 2 * TILE).astype(np.float32)

    def level_top(self) -> NDArray[np.float32]:
        """Where the halvings start below a tile's top, (LEVELS,), in texels."""
        return np.array(_STARTS, np.float32)

    def look_up(self, x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Texels (h, w, 4) at positions (h, w), bilinear."""
        return np.asarray(cv2.remap(self.pixels, x, y, cv2.INTER_LINEAR), np.uint8)


def atlas_of(textures: Sequence[Texture]) -> Atlas:
    """An atlas in which texture k is tile k."""
    rows = -(-len(textures) // _COLUMNS)
    pixels = np.zeros((rows * 2 * TILE, min(len(textures), _COLUMNS) * TILE, 4), np.uint8)
    for index, texture in enumerate(textures):
        left, top = index % _COLUMNS * TILE, index // _COLUMNS * 2 * TILE
        level = texture
        for start in _STARTS:
            size = level.shape[0]
            pixels[top + start : top + start + size, left : left + size] = level
            level = np.asarray(cv2.resize(level, (size // 2, size // 2), interpolation=cv2.INTER_AREA), np.uint8)
    return Atlas(pixels)
