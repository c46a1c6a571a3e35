"""Mapped lamps against a surveyor's sheet."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

import savmap.plugin as door
from savmap.plugin import Bools, Floats, Structure
from savmap_lights.doubts import is_whole

GATE_M = 1.0
SAME_LINE_M = 0.75
COMPACT_M = 0.01
ENDS = "ends of lights"


def centre_of(lamp: Structure) -> Floats:
    """The middle (1, 3) of a lamp."""
    return np.asarray(lamp.vertices.mean(axis=0, keepdims=True))


def score_lamps(lamps: Sequence[Structure], surveyed: Floats, ends_x: tuple[float, float]) -> door.Score:
    """Distances between the centres of lamps and of surveyed ones (n, 2, 3), and between the ends of those that are
    strips in both.

    Asked for are the lamps over the row's aisle: of the lines before the face, the one that the mapped lamps are
    nearest to, or, without any, the one nearest to the face. A strip of which an end was never seen is not compared.
    """
    lamps = [lamp for lamp in lamps if is_whole(lamp)]
    middles = surveyed.mean(axis=1)
    score = door.score_points(lamps, middles[:, None], GATE_M, "lights", ends_x, centre_of, over_aisle(lamps, middles))
    found = [lamp for lamp in lamps if np.isfinite(score.deviations.get(lamp.id, np.inf)) and len(lamp.vertices) == 2]
    ends = [distances for lamp in found if (distances := _ends_apart(lamp, surveyed)) is not None]
    if not ends:
        return score
    return replace(score, apart={**score.apart, ENDS: door.Distances(np.concatenate(ends))})


def over_aisle(lamps: Sequence[Structure], middles: Floats) -> Bools:
    """Which of the surveyed lamps (n, 3) are on the line over the row's aisle."""
    z = middles[:, 2]
    before = z > 0
    if not before.any():
        return np.ones(len(z), np.bool_)
    mapped = float(np.median([centre_of(lamp)[0, 2] for lamp in lamps])) if lamps else 0.0
    nearest = float(z[before][np.argmin(np.abs(z[before] - mapped))])
    line: Bools = np.abs(z - nearest) < SAME_LINE_M
    return line


def _ends_apart(lamp: Structure, surveyed: Floats) -> Floats | None:
    """Distances (2,) m between a lamp's ends and those of the surveyed strip whose middle is nearest; None of a compact
    one."""
    ends = surveyed[np.argmin(np.linalg.norm(surveyed.mean(axis=1) - centre_of(lamp), axis=1))]
    if np.linalg.norm(ends[1] - ends[0]) < COMPACT_M:
        return None
    ways = [np.linalg.norm(lamp.vertices - order, axis=1) for order in (ends, ends[::-1])]
    return np.asarray(min(ways, key=lambda distances: float(distances.sum())))
