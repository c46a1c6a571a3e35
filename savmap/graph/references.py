"""What the user measured, and what is known of the camera before the solve: both give the map its scale and its
place."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from savmap.errors import SolveError
from savmap.graph.calibration import Calibration
from savmap.types import Axis, RowFacts, Trajectory


@dataclass(frozen=True)
class CameraHeight:
    """The camera's height above the floor: one unknown common height, given as value_m +- sigma_m, about which the
    camera sways by sway_m from frame to frame. `passes`: which ones it was measured for (none named: all)."""

    value_m: float
    sigma_m: float
    sway_m: float = 0.03
    passes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if min(self.sigma_m, self.sway_m) <= 0:
            raise SolveError("camera height: sigma and sway must be greater than 0 m")

    @property
    def name(self) -> str:
        """As in messages and in the map."""
        return " ".join(("camera height", *self.passes))


@dataclass(frozen=True)
class KnownLength:
    """A measured distance between two named edges or vertices."""

    start: str
    end: str
    value_m: float
    sigma_m: float
    axis: Axis | None = None

    def __post_init__(self) -> None:
        if self.sigma_m <= 0:
            raise SolveError(f"length {self.start} to {self.end}: sigma must be greater than 0 m")


@dataclass(frozen=True)
class SurveyedPoint:
    """A vertex measured in the row's frame; a coordinate that is not known is None."""

    name: str
    position_m: tuple[float | None, float | None, float | None]
    sigma_m: float

    def __post_init__(self) -> None:
        if self.sigma_m <= 0:
            raise SolveError(f"surveyed point {self.name}: sigma must be greater than 0 m")


@dataclass(frozen=True)
class KnownMarker:
    """A square fiducial marker, the side of whose black square is size_m +- sigma_m: "tag36h11" number 7."""

    dictionary: str
    number: int
    size_m: float
    sigma_m: float

    @property
    def name(self) -> str:
        """As in messages, in the map and among tracks."""
        return f"{self.dictionary} {self.number}"


OnContradiction = Literal["check", "refuse", "leave_out"]
"""What becomes of a row where a reference is contradicted: it is mapped without it and doubted, refused, or mapped
without a warning."""


@dataclass(frozen=True)
class References:
    """All that the user measured of a row, and what to do where the rest contradicts a part of it."""

    camera_heights: tuple[CameraHeight, ...] = ()
    lengths: tuple[KnownLength, ...] = ()
    points: tuple[SurveyedPoint, ...] = ()
    markers: tuple[KnownMarker, ...] = ()
    on_contradiction: OnContradiction = "check"


@dataclass(frozen=True, eq=False)
class CameraPriors:
    """What is known of the camera before the solve: a start (good attitudes, rough positions), the references, and, if
    poses are taken from an earlier map, `fixed`. `calibration`: which terms of the camera are unknowns too. `walked`: a
    path of known form and unknown scale, pass by pass, which binds frames that show too little to be placed alone."""

    facts: RowFacts
    start: Trajectory
    references: References
    fixed: Trajectory | None = None
    calibration: Calibration | None = None
    walked: Trajectory | None = None


def camera_priors(
    facts: RowFacts,
    start: Trajectory,
    references: References | None = None,
    fixed: Trajectory | None = None,
    calibration: Calibration | None = None,
    walked: Trajectory | None = None,
) -> CameraPriors:
    """Checked priors. Raises SolveError for a camera height of a pass that is not in the row, or a start that is not
    finite."""
    chosen = references or References()
    for height in chosen.camera_heights:
        unknown = sorted(set(height.passes) - set(facts.frames.passes))
        if unknown:
            raise SolveError(f"row {facts.name}: camera height for pass '{unknown[0]}', but the row has no such pass")
    if not np.isfinite(start.world_from_rig).all():
        raise SolveError(f"row {facts.name}: the start has frames without a pose")
    return CameraPriors(facts, start, chosen, fixed, calibration if calibration and calibration.names else None, walked)
