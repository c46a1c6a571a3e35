"""Settings and results of `savmap split`."""

from dataclasses import dataclass
from typing import Literal

from savmap.types import Floats, array_record

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True)
class SplitSettings:
    """All numbers of `savmap split`.

    - Sampling: a pair of frames every `every_s` seconds, and every `closer_s` where passes begin and end; the two are
      at least `apart_s` apart, and are shrunk to `width` pixels.
    - Straights: the rig turns slower than `turn_deg_s`; a straight goes on while its direction of travel stays within
      `bend_deg`.
    - Cuts: two pictures in a row that are alike by less than `suspect`, 0 to 1, once motion is allowed for, are
    compared
      again every `closer_s`; where two of these are alike by less than `cut`, the recording was cut.
    - Nearness: what is abeam passes at `near` or more of the rate of what passes fastest around; gaps of up to `gap_s`
      do not end a pass.
    - Structure: a side passes at `side_rate` or more of the rate of the other side, and its texture is `texture` or
      more of the richer side's.
    - Passes: `least_s` long or more, without stops, along the recording's main direction or against it within
      `axis_deg`, and as near as `open_share` of the usual distance or nearer.
    """

    every_s: float = 1.0
    closer_s: float = 0.25
    apart_s: float = 0.06
    width: int = 512
    turn_deg_s: float = 8.0
    bend_deg: float = 30.0
    suspect: float = 0.45
    cut: float = 0.3
    near: float = 0.42
    gap_s: float = 8.0
    side_rate: float = 0.25
    texture: float = 0.4
    least_s: float = 4.0
    axis_deg: float = 40.0
    open_share: float = 0.35


@dataclass(frozen=True)
class DetectedPass:
    """A drive along structures without a turn: from `start_s` to `end_s` in the recording.

    `heading_deg` is the direction of travel relative to the first pass, degrees to the right, -180 to 180. `way_deg` is
    the direction in the panorama in which the camera goes, degrees to the right of its centre column. `sides` are those
    with structure. `confidence` is 0 to 1; a person should check a pass below 0.5. `stood_s` is how long the camera
    stood.
    """

    start_s: float
    end_s: float
    heading_deg: float
    way_deg: float
    sides: tuple[Side, ...]
    confidence: float
    stood_s: float


@dataclass(frozen=True, eq=False)
@array_record
class SplitResult:
    """The passes of a recording, for its timeline the direction of travel (n,) degrees at times (n,) s, and the cost:
    the number of frame pairs, the frames decoded for them, some of them twice, and all frames of the recording."""

    passes: tuple[DetectedPass, ...]
    stamps_s: Floats
    travel_deg: Floats
    frame_pairs: int = 0
    frames_decoded: int = 0
    frames: int = 0
