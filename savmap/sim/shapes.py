"""Boxes from their extents."""

import numpy as np

from savmap.sim.primitives import Box, Material

Range = tuple[float, float]


def span(x: Range, y: Range, z: Range, material: Material) -> Box:
    """The box that fills the ranges x, y and z, in metres."""
    low, high = np.array([x[0], y[0], z[0]]), np.array([x[1], y[1], z[1]])
    return Box((low + high) / 2, high - low, material)
