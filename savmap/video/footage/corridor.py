"""Motion between two panoramas: how fast the rig turns, which way it goes, and how fast both sides pass.

Apparent motion of a strip around the horizon (dense inverse search: Kroeger et al. 2016; OpenCV's), as one rate for
each bearing. Turning shifts all bearings alike; going along shifts the two sides apart, in front, and together again,
behind: by speed over distance at right angles to the way, less ahead and behind. Points above one another on an upright
face move alike.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Floats, array_record

BEARINGS = 120
LOW_DEG, HIGH_DEG = -20.0, 35.0
PAD = 64
_WAYS = 72
_REFITS = 8
_LEAST_RESIDUAL = 0.5


@dataclass(frozen=True, eq=False)
@array_record
class FramePair:
    """Two grey panoramas `first`, `second` (H, 2H) uint8, the first at `stamp_s` in the recording, `gap_s` apart."""

    stamp_s: float
    gap_s: float
    first: NDArray[np.uint8]
    second: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
@array_record
class Motion:
    """At `stamp_s`: `turn` of the rig to the right, deg/s; `way`, the bearing it goes in, degrees to the right of the
    panorama's centre; `sides`, apparent speed at right angles to the way, left and right, deg/s; `misfit` of these
    three, deg/s; `rates` (BEARINGS,), apparent motion to the right, deg/s; `texture` (BEARINGS,), how much there is to
    see, 0 for a bare wall."""

    stamp_s: float
    turn: float
    way: float
    sides: tuple[float, float]
    misfit: float
    rates: Floats
    texture: Floats


@dataclass(frozen=True, eq=False)
@array_record
class StripFlow:
    """The strip around the horizon of a pair's pictures, with `PAD` columns of its other end at each end: `first`,
    `second` (h, w + 2 PAD) uint8, and where each pixel of the first goes, `flow` (h, w + 2 PAD, 2) px."""

    first: NDArray[np.uint8]
    second: NDArray[np.uint8]
    flow: NDArray[np.float32]


def strip_flow(pair: FramePair, begin: StripFlow | None = None) -> StripFlow:
    """The apparent motion in a pair's strip, searched for from that of another pair where one is given."""
    height, _ = pair.first.shape
    rows = slice(round((90 - HIGH_DEG) / 180 * height), round((90 - LOW_DEG) / 180 * height))
    first, second = (
        np.asarray(cv2.copyMakeBorder(image[rows], 0, 0, PAD, PAD, cv2.BORDER_WRAP), np.uint8)
        for image in (pair.first, pair.second)
    )
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(
        first, second, np.empty(0) if begin is None else begin.flow.copy()
    )
    return StripFlow(first, second, np.asarray(flow, np.float32))


def motion_of(pair: FramePair, strip: StripFlow | None = None) -> Motion:
    """The motion between a pair's two pictures, of whose `strip` the flow may be known already."""
    rates, texture = _rates(pair, strip or strip_flow(pair))
    turn, way, sides, misfit = _fit(rates)
    return Motion(pair.stamp_s + pair.gap_s / 2, turn, way, sides, misfit, rates, texture)


def refitted(rates: Floats, way: float) -> tuple[float, float, float]:
    """Turn, and motion of the left and right side, deg/s, of rates (BEARINGS,) where the way is known."""
    turn, left, right = _corridors(rates, np.array([way]))[0][0].tolist()
    return turn, left, right


def wrapped(degrees: Floats) -> Floats:
    """Angles as equal ones between -180 and 180 degrees."""
    turned: Floats = (degrees + 180) % 360 - 180
    return turned


def bearings() -> Floats:
    """Degrees to the right of the panorama's centre (BEARINGS,) for which rates are given."""
    return (np.arange(BEARINGS) + 0.5) * 360 / BEARINGS - 180


def _rates(pair: FramePair, strip: StripFlow) -> tuple[Floats, Floats]:
    """Apparent motion to the right (BEARINGS,) deg/s, medians over the strip's textured pixels, and its texture
    (BEARINGS,)."""
    width, first = pair.first.shape[1], strip.first
    across = strip.flow[:, PAD : PAD + width, 0]
    upright, level = (np.abs(cv2.Sobel(first, cv2.CV_32F, x, 1 - x)[:, PAD : PAD + width]) / 8 for x in (1, 0))
    columns = np.arange(width) * BEARINGS // width
    medians = [
        _weighted_median(across[:, columns == bearing], upright[:, columns == bearing] + 0.01)
        for bearing in range(BEARINGS)
    ]
    energy = np.bincount(columns, (upright + level).mean(axis=0)) / np.bincount(columns)
    return np.array(medians) * 360 / width / pair.gap_s, energy / (float(first.mean()) + 10.0)


def _weighted_median(values: NDArray[Any], weights: NDArray[Any]) -> float:
    order = np.argsort(values, axis=None)
    total = np.cumsum(weights.ravel()[order])
    return float(values.ravel()[order[np.searchsorted(total, total[-1] / 2)]])


def _fit(rates: Floats) -> tuple[float, float, tuple[float, float], float]:
    """Turn, way, sides and mean absolute misfit of the corridor's motion that fits rates (BEARINGS,) best."""
    ways = np.arange(_WAYS) * 360 / _WAYS - 180
    found, misfits = _corridors(rates, ways)
    misfits = np.where(found[:, 1] + found[:, 2] >= 0, misfits, np.inf)
    best = int(np.argmin(misfits))
    turn, left, right = found[best].tolist()
    return turn, float(ways[best]), (left, right), float(misfits[best])


def _corridors(rates: Floats, ways: Floats) -> tuple[Floats, Floats]:
    """For each way: turn, motion of the left and of the right side (n, 3), and mean misfit (n,); by reweighting."""
    aside = np.sin(np.radians(bearings() - ways[:, None]))
    model = np.stack([-np.ones_like(aside), -(np.minimum(aside, 0) ** 2), np.maximum(aside, 0) ** 2], axis=2)
    weights = np.ones_like(aside)
    for _ in range(_REFITS):
        weighted = model * weights[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ model + 1e-9 * np.eye(3)
        found = np.linalg.solve(normal, np.swapaxes(weighted, 1, 2) @ rates[:, None])
        residuals = np.abs(rates - (model @ found)[..., 0])
        weights = 1 / np.maximum(residuals, _LEAST_RESIDUAL)
    return found[..., 0], residuals.mean(axis=1)
