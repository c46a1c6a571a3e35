"""A survey's entry of a row out of what somebody measured of its signs: four corners, or the eight of a plate."""

from collections.abc import Sequence

import numpy as np

from savmap.errors import OutputError
from savmap.types import Floats, Structure, SurveyEntry

UP = np.array([0.0, 1.0, 0.0])
FACING = 0.7
"""Of a sign's normal, the share along z from which the sign is one of the face, and so read from before it."""


def survey_entry(structures: Sequence[Structure]) -> SurveyEntry:
    """The signs with their corners, clockwise from the upper left one as one reads them, and their texts. Either side
    of a sign that is not in the face may be the one that is read: its four corners stay in the order in which they were
    given, and a plate is read where its first corner is. Raises OutputError."""
    return SurveyEntry({"signs": [_sign(own) for own in structures]})


def _sign(structure: Structure) -> dict[str, object]:
    text = structure.attributes.get("text", "")
    return {"corners": _corners(structure).tolist(), "text": text if isinstance(text, str) else str(text)}


def _corners(structure: Structure) -> Floats:
    points = structure.vertices
    if len(points) not in (4, 8):
        raise OutputError(f"{structure.id}: a sign has four corners, or eight as a plate: there are {len(points)}")
    normal = _normal(points)
    if normal[2] < FACING and len(points) == 4:
        return points
    if normal[2] < FACING and (points[0] - points.mean(axis=0)) @ normal < 0:
        normal = -normal
    front = points[np.sort(np.argsort(-(points @ normal), kind="stable")[:4])]
    arms = front - front.mean(axis=0)
    across, up = arms @ np.cross(UP, normal), arms @ UP
    clockwise = np.argsort(-np.arctan2(up, across), kind="stable")
    first = int(np.argmax((up - across)[clockwise]))
    ordered: Floats = front[np.roll(clockwise, -first)]
    return ordered


def _normal(points: Floats) -> Floats:
    """The direction (3,) in which a plate is thinnest, towards +z."""
    normal: Floats = np.linalg.svd(points - points.mean(axis=0))[2][-1]
    return normal if normal[2] >= 0 else -normal
