"""The space that lamps fill, around what was mapped of them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.plugin import Floats, Solid, Structure

STRIP_M, COMPACT_M, THICKNESS_M = 0.12, 0.4, 0.08
"""Width of a strip, side of a compact lamp, and height of both: usual sizes of lamps in halls."""
SHORTEST_M = 1e-3
UP = np.array([0.0, 1.0, 0.0])


def with_solids(structures: Sequence[Structure]) -> list[Structure]:
    """Lamps with the space around what was mapped, which is the middle of their height."""
    return [replace(lamp, solid=_solid(lamp.vertices)) for lamp in structures]


def _solid(vertices: Floats) -> Solid | None:
    """Of two ends or of a centre; None where a strip's ends lie above one another."""
    along = (vertices[-1] - vertices[0]) * [1.0, 0.0, 1.0]
    length = float(np.linalg.norm(along))
    if length < SHORTEST_M and len(vertices) > 1:
        return None
    way = along / length if len(vertices) > 1 else np.array([1.0, 0.0, 0.0])
    half = (STRIP_M if len(vertices) > 1 else COMPACT_M) / 2
    across = half * np.cross(way, UP)
    first, last = (
        (vertices[0], vertices[-1]) if len(vertices) > 1 else (vertices[0] - half * way, vertices[0] + half * way)
    )
    outline = np.array([first - across, last - across, last + across, first + across])
    return Solid(outline - THICKNESS_M / 2 * UP, THICKNESS_M * UP, assumed=True, ifc_class="IfcLightFixture")
