"""How the camera went in a pass, from small grey copies of its panoramas: motion and likeness from each frame to the
next.

It costs 5 ms of processor time a frame, one hundredth of what measuring in a frame costs.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Floats, Panorama, array_record
from savmap.video.footage.corridor import PAD, FramePair, Motion, StripFlow, motion_of, refitted, strip_flow
from savmap.video.footage.small import small_grey

WIDTH = 256
UNALIKE, SAME_PLACE = 0.6, 0.35
DETAIL_PX = 6.0
DARKEST_SPREAD = 2.0


@dataclass(frozen=True, eq=False)
@array_record
class Steps:
    """The steps from each of n + 1 frames to the next: their times (n + 1,) s, the motions n, and how alike the two
    pictures of a step are (n,), 0 to 1, once the motion is allowed for."""

    stamps_s: Floats
    motions: tuple[Motion, ...]
    likeness: Floats

    @property
    def spans_s(self) -> Floats:
        """The time (n,) that each step takes."""
        return np.diff(self.stamps_s)

    @property
    def heading_deg(self) -> Floats:
        """How far the rig has turned to the right (n,) by the middle of each step since the first frame."""
        turned = np.array([motion.turn for motion in self.motions]) * self.spans_s
        half: Floats = np.cumsum(turned) - turned / 2
        return half

    def pace(self, way_deg: float) -> Floats:
        """How fast both sides pass (n,), deg/s, where the camera goes in the direction that was `way_deg` to the right
        of the panorama's centre at the first frame; negative where it goes the other way."""
        ways = way_deg - self.heading_deg
        fitted = [refitted(motion.rates, way) for motion, way in zip(self.motions, ways.tolist(), strict=True)]
        return np.array([(left + right) / 2 for _, left, right in fitted])


class PassWatch:
    """Watches the panoramas of a pass, in order."""

    def __init__(self) -> None:
        self._stamps: list[float] = []
        self._motions: list[Motion] = []
        self._likeness: list[float] = []
        self._last: list[NDArray[np.uint8]] = []
        self._strip: StripFlow | None = None

    def update(self, panorama: Panorama) -> None:
        """Take the next frame."""
        picture = small_grey(panorama, WIDTH)
        if self._last:
            motion, alike = self._step(self._stamps[-1], panorama.stamp_s, self._last[-1], picture)
            self._motions.append(motion)
            self._likeness.append(alike)
            self._pass_over_a_bad_frame(panorama.stamp_s, picture)
        self._stamps.append(panorama.stamp_s)
        self._last = [*self._last[-1:], picture]

    def _pass_over_a_bad_frame(self, stamp_s: float, picture: NDArray[np.uint8]) -> None:
        """Where a frame is like neither of its neighbours, and these are alike, it is a smeared one, and no break."""
        if len(self._likeness) >= 2 and max(self._likeness[-2:]) < UNALIKE:
            strip = strip_flow(_pair(self._stamps[-2], stamp_s, self._last[0], picture))
            if likeness(strip) > SAME_PLACE:
                self._likeness[-2:] = [UNALIKE, UNALIKE]

    def _step(
        self, first_s: float, second_s: float, first: NDArray[np.uint8], second: NDArray[np.uint8]
    ) -> tuple[Motion, float]:
        """Motion and likeness. Where the search for the motion went astray, it begins again from the motion before."""
        pair = _pair(first_s, second_s, first, second)
        strip = strip_flow(pair)
        alike = likeness(strip)
        if alike < UNALIKE and self._strip is not None:
            again = strip_flow(pair, self._strip)
            strip, alike = max((strip, alike), (again, likeness(again)), key=lambda tried: tried[1])
        if alike >= UNALIKE:
            self._strip = strip
        return motion_of(pair, strip), alike

    @property
    def steps(self) -> Steps:
        """All steps so far."""
        return Steps(np.array(self._stamps), tuple(self._motions), np.array(self._likeness))


def _pair(first_s: float, second_s: float, first: NDArray[np.uint8], second: NDArray[np.uint8]) -> FramePair:
    return FramePair(first_s, max(second_s - first_s, 1e-3), first, exposed_as(second, first))


def exposed_as(picture: NDArray[np.uint8], other: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture with the mean and the spread of another's grey values."""
    (mean, spread), (wanted, wide) = ((float(one.mean()), float(one.std())) for one in (picture, other))
    if min(spread, wide) < DARKEST_SPREAD:
        return picture
    return np.asarray(np.clip((picture - mean) * (wide / spread) + wanted, 0, 255), np.uint8)


def likeness(strip: StripFlow) -> float:
    """The correlation of the details of the first picture with those that its pixels go to in the second; 1 where there
    are none."""
    y, x = np.mgrid[0 : strip.first.shape[0], 0 : strip.first.shape[1]].astype(np.float32)
    moved = cv2.remap(strip.second.astype(np.float32), x + strip.flow[..., 0], y + strip.flow[..., 1], cv2.INTER_LINEAR)
    a, b = (_detail(np.asarray(picture, np.float32))[:, PAD:-PAD] for picture in (strip.first, moved))
    power = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / power if power > a.size else 1.0


def _detail(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(picture - cv2.GaussianBlur(picture, (0, 0), DETAIL_PX), np.float32)
