"""Mapped lamps against a surveyor's sheet, and a survey's entry out of what somebody measured of lamps."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

import savmap.plugin as door
from savmap.plugin import Bools, Floats, Structure, SurveyEntry

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
    nearest to, or, without any, the one nearest to the face.
    """
    middles = surveyed.mean(axis=1)
    score = door.score_points(lamps, middles[:, None], GATE_M, "lights", ends_x, centre_of, over_aisle(lamps, middles))
    matched = [lamp for lamp in lamps if np.isfinite(score.deviations.get(lamp.id, np.inf)) and len(lamp.vertices) == 2]
    ends = [distances for lamp in matched if (distances := _ends_apart(lamp, surveyed)) is not None]
    if not ends:
        return score
    return replace(score, distances={**score.distances, ENDS: door.Distances(np.concatenate(ends))})


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


LONGER = 1.5
"""How much longer than wide a strip is; others are compact."""
NEAR_END = 0.1
"""The share of a strip's length that counts as its end."""


def survey_entry(structures: Sequence[Structure]) -> SurveyEntry:
    """The lamps with the ends of their long axes, which are one for compact ones."""
    return SurveyEntry({"lights": [{"ends": _ends(lamp.vertices).tolist()} for lamp in structures]})


def _ends(points: Floats) -> Floats:
    """The ends (2, 3) of a lamp out of its points (n, 3): the middles of those at either end of the direction in which
    it is longest."""
    if len(points) == 2:
        return points
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)[2]
    along = (points - middle) @ axes.T
    lengths = np.sort(np.ptp(along, axis=0))
    if len(points) < 3 or lengths[-1] < LONGER * lengths[-2]:
        return np.array([middle, middle])
    way = along[:, np.argmax(np.ptp(along, axis=0))]
    near = NEAR_END * lengths[-1]
    return np.array([points[way <= way.min() + near].mean(axis=0), points[way >= way.max() - near].mean(axis=0)])
