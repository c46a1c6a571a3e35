"""Procedural patterns as tiles: how much of a material's second colour shows, at several degrees of blur.

A tile spans one period of its pattern in both directions and repeats without a seam.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from savmap.sim.primitives import Floats, Material

SIZE = 256
LEVELS = 8
HOLES = ("holes", "holes-slot", "holes-double")
KINDS = ("plain", "noise", "wood", "carton", "stripes", "wire", "scratches", *HOLES)


def kind_of(material: Material) -> int:
    """The index in KINDS of a material's pattern; punched holes come in three shapes, by the material's seed."""
    name = HOLES[material.seed % len(HOLES)] if material.texture == "holes" else material.texture
    return KINDS.index(name)


@cache
def tiles() -> NDArray[np.uint8]:
    """All patterns (LEVELS, kinds, SIZE, SIZE): level l is blurred to cells of 2**l, the axes are (v, u)."""
    sharp = np.stack([_pattern(kind) for kind in KINDS])
    return np.stack([_blurred(sharp, 1 << level) for level in range(LEVELS)])


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
