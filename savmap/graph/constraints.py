"""What a room gives to the solve: landmarks, observed pixels, and relations between coordinates (paper, section III.E).

The paper's constraints are `BetweenFactor`s and `PriorFactor`s that bind one axis. A `Relation` says the same, so that it can
also be read by the linear start and by the check of gauge and scale; `factors.py` makes the factor of it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import gtsam
import numpy as np

from savmap.graph.observations import Observations
from savmap.types import Axis, Floats

TIGHT_M = 1e-4
Own = gtsam.Pose2 | Floats


@dataclass(frozen=True)
class Relation:
    """Coordinate `axis` of landmark b minus that of landmark a (a alone, if b is None) is `value` +- `sigma` m; without an
    axis, the straight distance from a to b is.

    A relation with a `name` is a figure the user gave: it may fix scale and place, and is reported. One without a name is
    structure: a grid line, the face plane. `doubt` is what to tell the user where all other references refute a named one
    because its landmark was mistaken; it is left out then.
    """

    axis: Axis | None
    a: int
    b: int | None
    value: float
    sigma: float
    name: str = ""
    doubt: str = ""

    @property
    def column(self) -> int:
        """0, 1 or 2 for x, y or z. ValueError for a distance, which has none."""
        return ("x", "y", "z").index(self.axis)


def tie(axis: Axis, a: int, b: int, sigma: float = TIGHT_M) -> Relation:
    """Landmarks a and b have the same coordinate: points of a column (x), of a row (y)."""
    return Relation(axis, a, b, 0.0, sigma)


def pin(axis: Axis, a: int, value: float = 0.0, sigma: float = TIGHT_M) -> Relation:
    """A landmark's coordinate is set by convention: the face plane, x = 0 at the first upright."""
    return Relation(axis, a, None, value, sigma)


def reference(axis: Axis, a: int, value: float, sigma: float, name: str, doubt: str = "") -> Relation:
    """A landmark's coordinate was measured by the user, such as the height of a section's lowest edge (h_ref)."""
    return Relation(axis, a, None, value, sigma, name, doubt)


def known_length(axis: Axis, a: int, b: int, value: float, sigma: float, name: str) -> Relation:
    """The user measured the distance from a to b along an axis (negative if b lies before a)."""
    return Relation(axis, a, b, value, sigma, name)


def known_distance(a: int, b: int, value: float, sigma: float, name: str) -> Relation:
    """The user measured the straight distance from a to b, along whatever direction: of a thing that stands askew."""
    return Relation(None, a, b, value, sigma, name)


@dataclass(frozen=True)
class Constraints:
    """A room's part of the graph.

    `keys`: landmark keys by name; `initial`: their published start (3,) m, row frame; `places`: more names that a user's
    length may use, such as an edge, as (axis, key); `alternatives`: one of these sets of relations, by what it
    says of the part that was found, holds: that which agrees best with what was seen, if it does so clearly; `factors`: GTSAM factors of the plugin's own, over keys of this room and
    `frame_key`s. `own`: variables that no projected pixel observes but these factors bind, with their starts by key: a `gtsam.Pose2` at a
    `KeySpace.pose2` key, three numbers at a `KeySpace.vector3` key. Factors of frames that are not solved for are left out.
    """

    room: str
    keys: Mapping[str, int]
    observations: Observations
    relations: tuple[Relation, ...]
    initial: Mapping[str, Floats]
    places: Mapping[str, tuple[Axis, int]] = field(default_factory=dict)
    factors: gtsam.NonlinearFactorGraph | None = None
    alternatives: Mapping[str, tuple[Relation, ...]] = field(default_factory=dict)
    own: Mapping[int, Own] = field(default_factory=dict)

    def __post_init__(self) -> None:
        missing = set(self.keys) - set(self.initial)
        if missing:
            raise ValueError(f"Constraints of '{self.room}': no start for landmark '{min(missing)}'")
        unknown = set(np.unique(self.observations.keys).tolist()) - set(self.keys.values())
        if unknown:
            raise ValueError(f"Constraints of '{self.room}': {len(unknown)} observed keys are not among its landmarks")
        loose = set(self.own).difference(*(factor.keys() for factor in each(self.factors)))
        if loose:
            raise ValueError(f"Constraints of '{self.room}': no factor binds {len(loose)} of its own variables")


def each(graph: gtsam.NonlinearFactorGraph | None) -> Iterator[gtsam.NonlinearFactor]:
    """The factors of a graph."""
    if graph is not None:
        yield from map(graph.at, range(graph.size()))
