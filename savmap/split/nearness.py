"""How near things are at right angles to the way, sample by sample along a straight.

Along a line at distance d from the way every point passes at the rate v / d once its bearing is allowed for. What stands at
right angles is compared with what passes fastest around, ahead and behind: speed drops out, and the moment at which the
end of a row is at right angles shows as a step.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from savmap.split.motion import Motion, bearings, refitted, wrapped
from savmap.split.straights import Straight
from savmap.types import Floats, array_record

_ABEAM_DEG = 13.0
_AROUND_DEG = 35.0
_LEAST_SINE = 0.3
_SHARE_NEAR = 60.0
_STILL = 1.5


@dataclass(frozen=True, eq=False)
@array_record
class Nearness:
    """Along a straight of n samples: `rates` (n, 2) at right angles, left and right, deg/s; `tops` (n, 2), the fastest on
    each side; `texture` (n, 2) at right angles; `still` (n,), whether the camera stands."""

    rates: Floats
    tops: Floats
    texture: Floats
    still: np.ndarray[tuple[int], np.dtype[np.bool_]]


def nearness(motions: Sequence[Motion], rig: Floats, straight: Straight) -> Nearness:
    """Nearness along a straight; `rig` (all samples) as from `headings`."""
    span = range(straight.first, straight.last + 1)
    rows = [_sample(motions[index], straight.way, straight.travel - straight.way - rig[index]) for index in span]
    rates, tops, texture, still = (np.array(column) for column in zip(*rows, strict=True))
    return Nearness(rates, tops, texture, still)


def _sample(motion: Motion, way: float, aside: float) -> tuple[Floats, Floats, Floats, bool]:
    """Rates at right angles (2,), the fastest (2,), texture (2,), and whether the camera stands. `aside`: how far to the right of
    the way the straight's direction is, degrees."""
    turn, left, right = refitted(motion.rates, way)
    from_way = np.radians(wrapped(bearings() - way))
    from_line = wrapped(bearings() - way - aside)
    parallax = (motion.rates + turn) * np.sign(np.sin(from_way))
    sines = np.abs(np.sin(from_way)) * np.abs(np.sin(np.radians(from_line)))
    scaled = np.where(sines > _LEAST_SINE, parallax / np.maximum(sines, _LEAST_SINE), 0.0)
    smooth = median_filter(scaled, size=5, mode="wrap")
    beside = [np.abs(from_line - angle) < _ABEAM_DEG for angle in (-90.0, 90.0)]
    rates = np.array([float(np.percentile(scaled[hand], _SHARE_NEAR)) for hand in beside])
    around = [np.abs(from_line - angle) < 90 - _AROUND_DEG for angle in (-90.0, 90.0)]
    tops = np.array([float(smooth[hand].max()) for hand in around])
    texture = np.array([float(motion.texture[hand].mean()) for hand in beside])
    return rates, tops, texture, max(left, right) < _STILL
