"""Ends and centres of lamps in space, by a known path: places along a line, heights, and the lamps' thickness.

A camera below a box sees its lower edge at an end that lies beyond the camera, and its upper edge at an end that faces
the camera.
"""

from dataclasses import dataclass

import numpy as np

from savmap.plugin import Bools, Floats, Ints

ROUNDS = 12
TUKEY = 4.7
APART_M = 0.05
THICKEST_M = 0.2
SURELY = 3.0
FLOOR_M = 0.001


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays to places along an axis: the number of the place and of its lamp (n,), where the ray starts along the axis
    and in height (n,) m, its slope (n,), which edge it touches (n,), +1 the upper, -1 the lower, 0 neither, and its
    standard deviation (n,) m."""

    place: Ints
    lamp: Ints
    origin: Floats
    height: Floats
    slope: Floats
    edge: Ints
    sigma: Floats


@dataclass(frozen=True, eq=False)
class Fitted:
    """Places (p,) m along the axis; height (k,) m of each lamp's middle; half the lamps' thickness, m; kept (n,):
    whether each ray fits."""

    places: Floats
    heights: Floats
    half_m: float
    kept: Bools


def fit(rays: Rays, level_m: float) -> Fitted:
    """Places, heights and thickness by robust least squares (Tukey). A prior of `APART_M` binds the heights to a common
    one. A thickness is accepted if it is significant and at most `2 * THICKEST_M`."""
    with_edges = _fit(rays, level_m, bool((rays.edge != 0).any()))
    half, sigma = with_edges[0].half_m, with_edges[1]
    if SURELY * sigma < half < THICKEST_M or not (rays.edge != 0).any():
        return with_edges[0]
    return _fit(rays, level_m, False)[0]


def _fit(rays: Rays, level_m: float, thick: bool) -> tuple[Fitted, float]:
    count, lamps = int(rays.place.max()) + 1, int(rays.lamp.max()) + 1
    size = count + 1 + lamps + int(thick)
    left = np.zeros((len(rays.place), size))
    row = np.arange(len(rays.place))
    left[row, rays.place] = 1.0
    left[row, count] = -rays.slope
    left[row, count + 1 + rays.lamp] = -rays.slope
    if thick:
        left[row, -1] = -rays.edge * rays.slope
    right = rays.origin + (level_m - rays.height) * rays.slope
    prior = np.zeros((lamps + 1, size))
    prior[np.arange(lamps), count + 1 + np.arange(lamps)] = 1 / APART_M
    prior[lamps, count] = 1e-3
    weight = 1 / rays.sigma
    scale, parameters, normal = 1.0, np.zeros(size), np.eye(size)
    for _ in range(ROUNDS):
        design = np.concatenate([left * weight[:, None], prior])
        normal = design.T @ design + 1e-9 * np.eye(size)
        parameters = np.linalg.solve(normal, design.T @ np.concatenate([right * weight, np.zeros(lamps + 1)]))
        errors = (left @ parameters - right) / rays.sigma
        scale = max(1.0, 1.48 * float(np.median(np.abs(errors))))
        relative_error = np.abs(errors) / (TUKEY * scale)
        weight = np.where(relative_error < 1, 1 - np.minimum(relative_error, 1) ** 2, 1e-6) / rays.sigma
    spread = scale**2 * np.linalg.inv(normal)
    to_heights = np.zeros((lamps, size))
    to_heights[:, count] = 1.0
    to_heights[np.arange(lamps), count + 1 + np.arange(lamps)] = 1.0
    half = float(parameters[-1]) if thick else 0.0
    fitted = Fitted(parameters[:count], level_m + to_heights @ parameters, half, relative_error < 1)
    return fitted, float(np.sqrt(spread[-1, -1])) if thick else 0.0
