"""What a plugin gives to the solve: landmarks, measured pixels, and relations between coordinates (paper, section
III.E).

The paper's constraints are `BetweenFactor`s and `PriorFactor`s that bind one axis. A `Relation` says the same, so that
the linear start and the checks of the references can read it too; `factors.problem_factors` makes the factor of it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import gtsam
import numpy as np

from savmap.graph.keys import Variable
from savmap.graph.measurements import ImageMeasurements
from savmap.types import Axis, Floats

TIGHT_M = 1e-4


@dataclass(frozen=True)
class Relation:
    """Coordinate `axis` of landmark b minus that of landmark a (a alone, if b is None) is `value` +- `sigma` m; without
    an axis, the straight distance from a to b is.

    A relation with a `name` is a figure that the user gave: it may fix scale and place, and is reported. One without a
    name is structure: a grid line, the face plane. `note_if_outlier` is for a named relation whose landmark may have
    been taken for another: where all other references refute it, it is left out and the user gets this line.
    `may_be_missing`: that is no reason to warning the map, for the user did not say that this very landmark exists.
    `is_given` is False for a named relation that nobody measured: savmap saw it, or takes it for granted. `presumed` is
    for one of the latter: what to tell the user where something else is found than its value. It is the first to be
    left out then, and refuses no row.
    """

    axis: Axis | None
    a: int
    b: int | None
    value: float
    sigma: float
    name: str = ""
    note_if_outlier: str = ""
    may_be_missing: bool = False
    presumed: str = ""
    is_given: bool = True

    @property
    def column(self) -> int:
        """0, 1 or 2 for x, y or z. ValueError for a distance, which has none."""
        return ("x", "y", "z").index(self.axis)

    @property
    def keys(self) -> tuple[int, ...]:
        """The landmarks' keys: one or two."""
        return (self.a,) if self.b is None else (self.a, self.b)


def equal_coordinate(axis: Axis, a: int, b: int, sigma: float = TIGHT_M) -> Relation:
    """Landmarks a and b have the same coordinate: points of a column (x), of a row (y)."""
    return Relation(axis, a, b, 0.0, sigma)


def fixed_coordinate(axis: Axis, a: int, value: float = 0.0, sigma: float = TIGHT_M) -> Relation:
    """A landmark's coordinate is set by convention: z = 0 for the face plane, x = 0 for the row's origin."""
    return Relation(axis, a, None, value, sigma)


def known_coordinate(axis: Axis, a: int, value: float, sigma: float, name: str, note_if_outlier: str = "") -> Relation:
    """The user measured a landmark's coordinate, such as the height of a structure's lowest edge (h_ref)."""
    return Relation(axis, a, None, value, sigma, name, note_if_outlier)


def known_length(axis: Axis, a: int, b: int, value: float, sigma: float, name: str) -> Relation:
    """The user measured the distance from a to b along an axis (negative if b lies before a)."""
    return Relation(axis, a, b, value, sigma, name)


def known_distance(a: int, b: int, value: float, sigma: float, name: str) -> Relation:
    """The user measured the straight distance from a to b, in any direction: of an object that stands askew."""
    return Relation(None, a, b, value, sigma, name)


@dataclass(frozen=True, eq=False)
class Constraints:
    """A plugin's part of the graph.

    `keys`: landmark keys by name; `initial`: first position (3,) m of each, row frame; `measurements`: their pixels.
    `coordinates`: more names that the user's references may use, such as that of an edge, as (axis, key).
    `alternatives`: sets of relations by a description of what was found in the video. Exactly one set holds: the solve
    takes the one that agrees best with the measurements, if it does so clearly. `factors`: the plugin's GTSAM factors.
    They may bind the plugin's keys and `frame_key`s only; for other plugins' landmarks there are the `relate` hook and
    the references. Factors of frames that are not solved for are left out. `variables`: variables that no pixel
    measures but these factors bind, with their first values by key: a `gtsam.Pose2` at a `KeySpace.pose2` key, three
    numbers at a `KeySpace.vector3` key. `height_reference`: how the user gives a known height on
    this plugin's structures, for error messages. `unit`: a length that is taken for 1 where a camera sees a row in part
    only, and nothing gives the scale.
    """

    plugin: str
    keys: Mapping[str, int]
    measurements: ImageMeasurements
    relations: tuple[Relation, ...]
    initial: Mapping[str, Floats]
    coordinates: Mapping[str, tuple[Axis, int]] = field(default_factory=dict)
    factors: gtsam.NonlinearFactorGraph | None = None
    alternatives: Mapping[str, tuple[Relation, ...]] = field(default_factory=dict)
    variables: Mapping[int, Variable] = field(default_factory=dict)
    height_reference: str = ""
    unit: tuple[Relation, ...] = ()

    def __post_init__(self) -> None:
        missing = set(self.keys) - set(self.initial)
        if missing:
            raise ValueError(f"Constraints of '{self.plugin}': no start for landmark '{min(missing)}'")
        unknown = set(np.unique(self.measurements.keys).tolist()) - set(self.keys.values())
        if unknown:
            raise ValueError(
                f"Constraints of '{self.plugin}': {len(unknown)} observed keys are not among its landmarks"
            )
        loose = set(self.variables).difference(*(factor.keys() for factor in factors_in(self.factors)))
        if loose:
            raise ValueError(f"Constraints of '{self.plugin}': no factor binds {len(loose)} of its own variables")


def factors_in(graph: gtsam.NonlinearFactorGraph | None) -> Iterator[gtsam.NonlinearFactor]:
    """The factors of a graph."""
    if graph is not None:
        yield from map(graph.at, range(graph.size()))
