"""What `savmap split` finds."""

from dataclasses import dataclass
from typing import Literal

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True)
class PassFound:
    """A drive along structures without a turn: from `start_s` to `end_s` in the recording.

    `heading_deg` is the direction of travel relative to the first pass, degrees to the right, -180 to 180. `way_deg` is where
    in the panorama the camera goes, degrees to the right of its centre column. `sides` are those with structure.
    `confidence` is 0 to 1: below 0.5 it deserves a look. `stood_s` is how long the camera stood.
    """

    start_s: float
    end_s: float
    heading_deg: float
    way_deg: float
    sides: tuple[Side, ...]
    confidence: float
    stood_s: float
