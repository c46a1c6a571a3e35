"""A survey's entry of a row out of what somebody measured of its lamps: a point, two ends, or an outline or body."""

from collections.abc import Sequence

import numpy as np

from savmap.plugin import Floats, Structure, SurveyEntry

LONGER = 1.5
"""How much longer than wide a strip is; others are compact."""
NEAR_END = 0.1
"""The share of a strip's length that counts as its end."""


def survey_entry(structures: Sequence[Structure]) -> SurveyEntry:
    """The lamps with the ends of their long axes, which are one for compact ones."""
    return SurveyEntry({"lights": [{"ends": _ends(own.vertices).tolist()} for own in structures]})


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
