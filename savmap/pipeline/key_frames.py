"""Which frames of a drive are measured in: those before which the camera moved on by a share of its distance from the
face. Frames between show much the same, errors included."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from savmap.types import Floats
from savmap.vision.odometry import Followed

SHARE = 0.2
"""Of its distance from the face, by which the camera moves on from one key frame to the next. What stands off the face
is seen as several things where it is 0.3: one of 17 test rows is then refused, none with this."""
AROUND_DEG, FRONT = 40.0, 0.15
"""The face is where this share of the points is nearer, of those about its direction."""
PARALLAX_RAD = 0.1
"""By which the points move, where the path is not known."""
LEAST_POINTS = 8


class Placed(Protocol):
    """Where the latest frame of a drive is, as odometry tells: its pose world_from_rig (4, 4), or None; the part of
    the path it belongs to; and the places (n, 3) of the points that are seen there."""

    @property
    def pose(self) -> Floats | None: ...
    @property
    def part(self) -> int: ...
    @property
    def places(self) -> Floats: ...


class KeyFrames:
    """Chooses key frames from the frames of a drive, in order. `towards`: unit directions of the faces (3,) in the rig
    frame; of none, every direction is one."""

    def __init__(self) -> None:
        self.towards: Sequence[Floats] = ()
        self._followed: Followed | None = None
        self._pose: Floats | None = None
        self._part = -1

    def is_key(self, followed: Followed, odometry: Placed) -> bool:
        """Whether the latest frame of the odometry is one; `followed`: the points that were followed to it."""
        passed_over = not len(followed.numbers)
        if passed_over or (self._followed is not None and not self._moved_on(self._followed, followed, odometry)):
            return False
        self._followed, self._pose, self._part = followed, odometry.pose, odometry.part
        return True

    def _moved_on(self, last: Followed, followed: Followed, odometry: Placed) -> bool:
        pose, places = odometry.pose, odometry.places
        if self._pose is None or pose is None or odometry.part != self._part or len(places) < LEAST_POINTS:
            return _shift(last, followed) > PARALLAX_RAD
        moved = float(np.linalg.norm(pose[:3, 3] - self._pose[:3, 3]))
        return moved > SHARE * front((places - pose[:3, 3]) @ pose[:3, :3], self.towards)


def front(points: Floats, towards: Sequence[Floats]) -> float:
    """How far the nearest of the faces is that lie towards these directions, by points (n, 3) in the rig frame; of no
    direction, how far the points are."""
    distances = np.linalg.norm(points, axis=1)
    usual = float(np.quantile(distances, FRONT)) if len(distances) else 0.0
    fronts = list[float]()
    for direction in towards:
        depths = points @ direction
        about = depths > np.cos(np.radians(AROUND_DEG)) * distances
        fronts += [float(np.quantile(depths[about], FRONT))] if about.sum() >= LEAST_POINTS else []
    return min(fronts, default=usual)


def _shift(last: Followed, followed: Followed) -> float:
    """The middle angle by which points moved, radians; all of it where too few were followed."""
    shared, a, b = np.intersect1d(last.numbers, followed.numbers, assume_unique=True, return_indices=True)
    if len(shared) < LEAST_POINTS:
        return float(np.pi)
    return float(np.median(np.linalg.norm(last.rays[a] - followed.rays[b], axis=1)))
