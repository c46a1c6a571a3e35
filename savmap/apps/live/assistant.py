"""The capture assistant: what whoever walks should do, from each frame and from the latest map.

Within half a second it tells of speed, turning and tilt, within two of blur, darkness, flicker and what covers the
lens. Figures are those of a small grey copy of the panorama and of its centre at full resolution; motion is that of
`savmap.video.motion`. Each limit is a constant below, with what it is of.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import FilmedPanorama, Floats, Panorama, RowMap
from savmap.video.motion import HIGH_DEG, LOW_DEG, WIDTH, PassWatch, small_grey
from savmap.vision.views import DARK, LEGIBLE

Severity = Literal["good", "attention", "stop"]
Arrow = Literal["", "left", "right", "back", "on"]

RECENT, LEAST = 12, 4
"""Frames that figures are of, and how many of them are needed."""
FAST_DEG, LEAST_LIKENESS = 24.0, 0.75
"""What is abeam may pass by so many degrees from a frame to the next: the same place is then in four frames or more;
and the details of two frames should be so much alike once the motion is allowed for (`savmap.video.motion`)."""
TURN_DEG_S = 20.0
TILT_DEG = 12.0
FLICKER = 0.12
"""Change of the mean brightness from frame to frame, up and down in turn, of the mean."""
BLUR, SHARP_FRAMES = 0.6, 40
"""Of the usual sharpness of the latest so many frames."""
STEADY, STEEP, OFTEN, BLOT_FRAMES, MOVING_DEG = 5.0, 2.0, 10, 14, 15.0
"""An upright edge that stays where it is: grey levels a pixel to the right, so many times as steep as level, in all but
so many percent of the frames, while what is abeam passes by so many degrees."""
COVERED_DEG = 14.0
"""The height of a connected piece of such edges."""
FACING_DEG = 55.0
NEAR_M, FAR_M = 0.5, 5.0
BEHIND_M, NAMED = 1.5, 2
"""What lies so far behind the camera has been passed; so many elements are named in a sentence."""
LAG_S, DISK_BYTES = 5.0, 1 << 30

Grey = NDArray[np.uint8]


@dataclass(frozen=True)
class Advice:
    """One thing to do, said as one sentence: its code, how urgent it is, and the arrow that goes with it."""

    code: str
    severity: Severity
    text: str
    arrow: Arrow = ""


@dataclass(eq=False)
class CaptureAssistant:
    """Watches the panoramas of a walk, in order. `facing_deg`: where the structure is, degrees to the right of the
    panorama's centre; None: not known yet. `tilt_deg`: by how much the camera leans."""

    facing_deg: float | None = None
    tilt_deg: float = 0.0
    _watch: PassWatch = field(default_factory=PassWatch)
    _greys: deque[Grey] = field(default_factory=lambda: deque(maxlen=BLOT_FRAMES))
    _swept: deque[float] = field(default_factory=lambda: deque(maxlen=BLOT_FRAMES))
    _turns: deque[float] = field(default_factory=lambda: deque(maxlen=LEAST))
    _likeness: deque[float] = field(default_factory=lambda: deque(maxlen=LEAST))
    _means: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))
    _sharpness: deque[float] = field(default_factory=lambda: deque(maxlen=SHARP_FRAMES))
    _frames: int = 0

    def take(self, panorama: Panorama) -> list[Advice]:
        """What the latest frames call for."""
        grey = small_grey(panorama, WIDTH)
        self._step(panorama.stamp_s, grey)
        self._greys.append(grey)
        band = horizon(grey)
        self._means.append(float(band.mean()))
        self._sharpness.append(sharpness(panorama))
        self._frames += 1
        return list(self._advice(band))

    def _step(self, stamp_s: float, grey: Grey) -> None:
        """Motion from the frame before; what was watched earlier is let go."""
        self._watch.take(stamp_s, grey)
        steps = self._watch.steps
        if len(steps.motions):
            motion, span = steps.motions[-1], float(steps.spans_s[-1])
            self._swept.append(max(sum(motion.sides) / 2 * span, 0.0))
            self._turns.append(motion.turn)
            self._likeness.append(float(steps.likeness[-1]))
        if len(steps.motions) >= RECENT:
            self._watch = PassWatch()
            self._watch.take(stamp_s, grey)

    def _advice(self, band: Grey) -> Iterator[Advice]:
        if self._frames < LEAST:
            return
        if float((band > DARK).mean()) < LEGIBLE:
            yield Advice("dark", "stop", "It is too dark: make it brighter, or let the camera expose for longer.")
            return
        if self.is_covered():
            yield Advice(
                "covered", "stop", "Something covers the view of the structure: clean the lens, take the hand away."
            )
        if self.is_too_fast():
            yield Advice("too-fast", "attention", "Walk more slowly.")
        turn = float(np.median(self._turns)) if self._turns else 0.0
        if abs(turn) > TURN_DEG_S:
            side: Arrow = "left" if turn > 0 else "right"
            yield Advice("turning", "attention", f"The camera turns: turn it back to the {side}.", side)
        if self.tilt_deg > TILT_DEG:
            yield Advice("tilted", "attention", f"The camera leans by {self.tilt_deg:.0f} degrees: set it upright.")
        latest, usual = np.median(list(self._sharpness)[-LEAST:]), np.percentile(self._sharpness, 75)
        if len(self._sharpness) >= RECENT and bool(latest < BLUR * usual):
            yield Advice("blurred", "attention", "The picture is blurred: walk more slowly, or clean the lens.")
        if self.is_flickering():
            yield Advice(
                "flicker", "attention", "Brightness flickers: set the shutter to 1/50 s or 1/60 s, as the mains."
            )

    def is_flickering(self) -> bool:
        """Whether brightness goes up and down from frame to frame."""
        means = np.array(self._means)
        if len(means) < RECENT:
            return False
        changes = np.diff(means) / np.maximum(means[1:], 1.0)
        turns = changes[1:] * changes[:-1] < 0
        return bool(np.median(np.abs(changes)) > FLICKER and turns.mean() > 0.5)

    def is_covered(self) -> bool:
        """Whether a part of what faces the structure stays as it is while the rest moves on."""
        if self.facing_deg is None or len(self._greys) < BLOT_FRAMES or sum(self._swept) < MOVING_DEG:
            return False
        bands = np.stack([horizon(grey) for grey in self._greys]).astype(np.float32)
        width = bands.shape[2]
        bearings = (np.arange(width) + 0.5) * 360 / width - 180
        across = np.abs((bearings - (self.facing_deg or 0.0) + 180) % 360 - 180) < FACING_DEG
        slopes, level = (
            np.stack([np.abs(cv2.Sobel(band, cv2.CV_32F, x, 1 - x)) / 8 for band in bands]) for x in (1, 0)
        )
        upright = np.where(slopes > STEEP * level, slopes, 0.0)[:, :, across]
        steady = (np.percentile(upright, OFTEN, axis=0) > STEADY).astype(np.uint8)
        joined = cv2.dilate(steady, np.ones((3, 1), np.uint8))
        _, _, stats, _ = cv2.connectedComponentsWithStats(joined, connectivity=8)
        height = int(stats[1:, cv2.CC_STAT_HEIGHT].max()) if len(stats) > 1 else 0
        return height * 360.0 / int(width) > COVERED_DEG

    def is_too_fast(self) -> bool:
        """Whether the latest frames have too little in common, or what is abeam passes too far between them."""
        if len(self._likeness) < LEAST:
            return False
        swept = float(np.median(list(self._swept)[-LEAST:]))
        return bool(swept > FAST_DEG or np.median(self._likeness) < LEAST_LIKENESS)


def horizon(grey: Grey) -> Grey:
    """The band (h, w) around the horizon of a small grey panorama (H, 2H)."""
    height = len(grey)
    return grey[round((90 - HIGH_DEG) / 180 * height) : round((90 - LOW_DEG) / 180 * height)]


def sharpness(panorama: Panorama) -> float:
    """How much fine detail the band around the horizon has at full resolution, of the contrast that it has: the 99th
    percentile of the gradient to the right over that of a copy of a quarter of the size."""
    whole = panorama.planes.luma if isinstance(panorama, FilmedPanorama) else panorama.image[..., 1]
    height = len(whole)
    band = whole[round(0.42 * height) : round(0.58 * height)]
    coarse = cv2.resize(band, (band.shape[1] // 4, band.shape[0] // 4), interpolation=cv2.INTER_AREA)
    fine, rough = (np.percentile(np.abs(np.diff(part.astype(np.int16), axis=1)), 99) for part in (band, coarse))
    return float(fine) / max(float(rough), 1.0)


def advice_of_map(row: RowMap, camera: Floats) -> Iterator[Advice]:
    """What the latest map of a row calls for where the camera is at (3,) m: to go back to what was passed and is not
    certain, and to keep the right distance."""
    if row.face is not None:
        distance = float(abs((camera - row.face.origin) @ row.face.axes[:, 2]))
        if distance < NEAR_M:
            yield Advice("too-near", "attention", f"The structure is {distance:.1f} m away: keep more distance.")
        elif distance > FAR_M:
            yield Advice("too-far", "attention", f"The structure is {distance:.1f} m away: go nearer.")
    passed = [*_passed(row, float(camera[0]))]
    if passed:
        first = min(passed, key=lambda item: abs(item[1]))
        names = ", ".join(dict.fromkeys(name for name, _ in passed[:NAMED]))
        more = f" and {len(passed) - NAMED} more" if len(passed) > NAMED else ""
        yield Advice(
            "go-back", "attention", f"Go back {abs(first[1]):.0f} m: {names}{more} could not be seen well.", "back"
        )


def _passed(row: RowMap, camera_x: float) -> Iterator[tuple[str, float]]:
    """Elements that are warned of and were passed, with how far along the row they lie from the camera."""
    places = row.trajectory.world_from_rig[:, 0, 3]
    way = float(np.sign(places[-1] - places[0])) if len(places) > 1 else 0.0
    structures = {part.id: part.vertices.mean(axis=0) for group in row.structures.values() for part in group}
    for warning in row.verdict.warnings if row.verdict else ():
        for name in warning.subjects if warning.code in ("uncertain-element", "inaccurate-element") else ():
            place = structures.get(name, warning.place)
            if place is not None and way * (camera_x - float(place[0])) > BEHIND_M:
                yield name, float(place[0]) - camera_x


def most_urgent(advice: Sequence[Advice]) -> Advice:
    """The one that is shown."""
    order = ("stop", "attention", "good")
    return min(advice, key=lambda item: order.index(item.severity), default=Advice("good", "good", "Walk on.", "on"))
