"""What lights a path-traced scene: one or two long area lamps for every line of lamps, in place of hundreds of small ones."""

from collections.abc import Sequence

import numpy as np

from savmap.sim.primitives import Box
from savmap.train.blender_looks import Color, Fill, Rng
from savmap.train.blender_mesh import Floats

_WATTS_PER_RADIANCE_M2 = float(np.pi)


def _line(lamps: Sequence[Box], x: tuple[float, float], gain: float, color: Color) -> list[Fill]:
    """One lamp over the part of a line's lamps between `x`, as strong as they are together."""
    within = [lamp for lamp in lamps if x[0] <= lamp.center[0] <= x[1]]
    if not within:
        return []
    power = sum(lamp.material.emission * float(lamp.size[0] * lamp.size[2]) for lamp in within)
    bottom = min(float(lamp.center[1] - lamp.size[1] / 2) for lamp in within)
    place = ((x[0] + x[1]) / 2, bottom - 0.02, float(within[0].center[2]))
    return [Fill(place, (x[1] - x[0], float(within[0].size[2])), gain * power * _WATTS_PER_RADIANCE_M2, color)]


def lines_of_lamps(boxes: Sequence[Box], gain: float, color: Color, rng: Rng) -> list[Fill]:
    """Area lamps for the luminous boxes with a label, by lines of one z; each line in two parts of unequal strength."""
    lamps = [box for box in boxes if box.material.emission > 0 and box.face_labels]
    fills: list[Fill] = []
    for z in sorted({round(float(lamp.center[2]), 2) for lamp in lamps}):
        line = [lamp for lamp in lamps if abs(lamp.center[2] - z) < 0.02]
        ends: Floats = np.array([[b.center[0] - b.size[0] / 2, b.center[0] + b.size[0] / 2] for b in line])
        left, right = float(ends.min()), float(ends.max())
        cut = float(rng.uniform(left, right))
        for part in ((left, cut), (cut, right)):
            fills += _line(line, part, gain * float(np.exp(rng.normal(0, 0.4))), color)
    return fills
