"""What the solve gives back."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from savmap.graph.constraints import Own
from savmap.graph.covariance import Covariance
from savmap.types import Floats, ReferenceUse, Trajectory


@dataclass(frozen=True)
class Landmark:
    """A solved point: position (3,) m in the row's frame, covariance (3, 3) m^2, observations that were used and rejected."""

    position: Floats
    covariance: Floats
    observations: int
    rejected: int


@dataclass(frozen=True)
class Rejected:
    """An observation that did not fit."""

    room: str
    track: str
    frame: int
    view: str


@dataclass(frozen=True)
class Solution:
    """Trajectory, landmarks by room and name, the references as they were used, and what is worth telling the user.

    `off`: how many standard deviations each reference, by name, is off what the rest says. `own`: the plugins' own variables by key
    (see `Constraints`); `own_covariance` tells how well they are known."""

    trajectory: Trajectory
    landmarks: Mapping[str, Mapping[str, Landmark]]
    references: tuple[ReferenceUse, ...]
    rejected: tuple[Rejected, ...]
    warnings: tuple[str, ...]
    report: Mapping[str, float | int | str]
    keys: Mapping[str, Mapping[str, int]]
    covariance: Covariance
    off: Mapping[str, float]
    own: Mapping[int, Own] = field(default_factory=dict)

    def of(self, room: str) -> Mapping[str, Landmark]:
        """Landmarks of a room by name."""
        return self.landmarks.get(room, {})

    def own_covariance(self, key: int) -> Floats:
        """Covariance (3, 3) of a variable of a plugin's own, in GTSAM's tangent: of a Pose2 x, y in its own axes (m) and its turn
        (rad)."""
        return self.covariance.of([key])

    def joint(self, room: str, names: Sequence[str]) -> Floats:
        """Joint covariance (3n, 3n) m^2 of some landmarks of a room, x y z of each in turn."""
        return self.covariance.of([self.keys[room][name] for name in names])

    def difference_sigma(self, room: str, first: str, second: str, axis: int) -> float:
        """Standard deviation in m of the distance between two landmarks along an axis: a width, a beam's height."""
        joint = self.joint(room, [first, second])
        other = 3 + axis
        return float(np.sqrt(max(joint[axis, axis] + joint[other, other] - 2 * joint[axis, other], 0.0)))
