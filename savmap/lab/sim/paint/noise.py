"""Noise that textures are made of. All fields are (TILE, TILE) float32 and repeat without a seam, about 0 to 1."""

import cv2
import numpy as np

from savmap.lab.sim.paint.atlas import TILE, Texture
from savmap.lab.sim.paint.faces import Singles
from savmap.lab.sim.paint.stage import Rgb

Random = np.random.Generator


def field(rng: Random, across: int, along: int, size: int = TILE) -> Singles:
    """Smooth noise of this many bumps across and along."""
    grid = rng.random((along, across), np.float32)
    padded = np.pad(grid, 2, mode="wrap")
    ratio = size / across, size / along
    large = cv2.resize(padded, None, fx=ratio[0], fy=ratio[1], interpolation=cv2.INTER_CUBIC)
    left, top = round(2 * ratio[0]), round(2 * ratio[1])
    return np.ascontiguousarray(large[top : top + size, left : left + size])


def clouds(rng: Random, coarsest: int = 2, octaves: int = 5, persistence: float = 0.55) -> Singles:
    """Fractal noise."""
    total = np.zeros((TILE, TILE), np.float32)
    weight = 0.0
    for octave in range(octaves):
        bumps = min(coarsest << octave, TILE)
        total += persistence**octave * field(rng, bumps, bumps)
        weight += persistence**octave
    return total / np.float32(weight)


def streaks(rng: Random, length: float = 0.5, level: bool = True) -> Singles:
    """Fine lines, level or upright, about `length` of a tile long."""
    few, many = max(2, round(1 / length)), TILE // 2
    fine = field(rng, few, many) if level else field(rng, many, few)
    return 0.6 * fine + 0.4 * (field(rng, 2, 48) if level else field(rng, 48, 2))


def cells(rng: Random, count: int) -> Singles:
    """Flat patches of random values about random points: crystals."""
    scale = 2
    size = TILE // scale
    points = rng.random((count, 2)).astype(np.float32) * size
    values = rng.random(count).astype(np.float32)
    y, x = np.mgrid[:size, :size].astype(np.float32)
    nearest = np.full((size, size), np.inf, np.float32)
    patch = np.zeros((size, size), np.float32)
    for (px, py), value in zip(points, values, strict=True):
        dx, dy = np.abs(x - px), np.abs(y - py)
        distance = np.minimum(dx, size - dx) ** 2 + np.minimum(dy, size - dy) ** 2
        closer = distance < nearest
        nearest[closer] = distance[closer]
        patch[closer] = value
    return np.asarray(cv2.resize(patch, (TILE, TILE), interpolation=cv2.INTER_LINEAR), np.float32)


def texture(rgb: Singles, tinted: Singles | float = 1.0) -> Texture:
    """A texture from colours (TILE, TILE, 3) or greys (TILE, TILE), 0 to 1, and how much of a tint they take."""
    colours = np.repeat(rgb[..., None], 3, axis=2) if rgb.ndim == 2 else rgb
    share = np.broadcast_to(np.asarray(tinted, np.float32), (TILE, TILE))
    whole = np.concatenate([colours, share[..., None]], axis=2)
    return np.asarray(np.clip(whole, 0, 1) * 255, np.uint8)


def mixed(under: Singles, over: Singles | Rgb, amount: Singles) -> Singles:
    """`over` laid on `under` (TILE, TILE, 3) by an amount (TILE, TILE)."""
    blend: Singles = under + np.clip(amount, 0, 1)[..., None] * (np.asarray(over, np.float32) - under)
    return blend


def rgb_of(grey: Singles, colour: Rgb = (1.0, 1.0, 1.0)) -> Singles:
    """Greys (TILE, TILE) in a colour."""
    coloured: Singles = grey[..., None] * np.asarray(colour, np.float32)
    return coloured


def steps(values: Singles, edge: float, width: float) -> Singles:
    """0 below an edge, 1 above it, a slope of this width between."""
    ramp: Singles = np.clip((values - edge) / np.float32(width) + 0.5, 0, 1)
    return ramp
