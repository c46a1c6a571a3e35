"""Edges of beams that goods hide in all frames, and whose readings are those of the goods.

A pallet that stands out over the aisle hides the upper edge of the beam under it from a camera above, along most of the beam. What is read instead
is the goods' own edge, which is nearer to the camera than the face: it moves on the face from frame to frame, and makes the beam thin. The
beam's other edge stays where it is.
"""

import numpy as np

from savmap.types import Bools, Floats, Ints

LEAST_LEVELS, ALIKE, MOSTLY = 4, 0.1, 0.6
"""A row has a usual height if so many levels at least, and such a share of them, agree with it to that share."""
THIN = 0.86
STEADY, LOOSE = 0.1, 0.2
"""The middle half of an edge's readings spans less, or more, than that share of the usual height."""
LEAST_READINGS = 6


def hidden_edges(level_numbers: Ints, readings: Floats, candidates: Bools) -> Bools:
    """Which edges (k, 2), lower and upper, of `candidates` (k,) among the levels are hidden: at most one of a level.

    level_numbers (m,): the level of each sighting, or -1. readings (m, 2): heights of its lower and upper edge, nan where there is none. No
    edge is hidden where the row's beams have no usual height.
    """
    hidden = np.zeros((len(candidates), 2), np.bool_)
    of_level = [readings[level_numbers == level] for level in range(len(candidates))]
    heights = np.array([_median(own[:, 1] - own[:, 0]) for own in of_level])
    usual = float(np.nanmedian(heights)) if np.isfinite(heights).any() else np.nan
    if len(heights) < LEAST_LEVELS or np.mean(np.abs(heights - usual) < ALIKE * usual) < MOSTLY:
        return hidden
    for level in np.flatnonzero(candidates & (heights < THIN * usual)):
        spread = [_spread(edge) / usual for edge in of_level[level].T]
        for edge in (0, 1):
            hidden[level, edge] = spread[edge] > LOOSE and spread[1 - edge] < STEADY
    return hidden


def _median(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) >= LEAST_READINGS else np.nan


def _spread(values: Floats) -> float:
    """How far the middle half of an edge's readings (n,) spans; nan where these are few."""
    known = values[np.isfinite(values)]
    return float(np.subtract(*np.quantile(known, [0.75, 0.25]))) if len(known) >= LEAST_READINGS else np.nan
