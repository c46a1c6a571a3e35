"""How the camera moves in a pass, from small grey copies of its panoramas: how fast the rig turns, which way it goes,
how fast both sides pass, and how alike the pictures are, from each frame to the next.

Apparent motion of a strip around the horizon (dense inverse search: Kroeger et al. 2016; OpenCV's), as one rate for
each bearing. Turning shifts all bearings alike; going along shifts the two sides apart, in front, and together again,
behind: by speed over distance at right angles to the way, less ahead and behind. It costs 5 ms of processor time a
frame, one hundredth of what measuring in a frame costs.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Floats, Panorama, array_record
from savmap.types.planes import FilmedPanorama

FINE = 8
"""A picture so many times wider than its copy is thinned out before it is averaged: as good, without reading all."""
BEARINGS = 120
LOW_DEG, HIGH_DEG = -20.0, 35.0
PAD = 64
_WAYS = 72
_REFITS = 8
_LEAST_RESIDUAL = 0.5
WIDTH = 256
UNALIKE, SAME_PLACE = 0.6, 0.35
DETAIL_PX = 6.0
DARKEST_SPREAD = 2.0

Grey = NDArray[np.uint8]


def small_grey(panorama: Panorama, width: int) -> Grey:
    """A panorama in grey (width / 2, width)."""
    whole = panorama.planes.luma if isinstance(panorama, FilmedPanorama) else panorama.image
    step = max(1, whole.shape[1] // (FINE * width))
    thin = cv2.resize(whole[::step, ::step], (width, width // 2), interpolation=cv2.INTER_AREA)
    return np.asarray(thin if thin.ndim == 2 else cv2.cvtColor(thin, cv2.COLOR_RGB2GRAY), np.uint8)


@dataclass(frozen=True, eq=False)
@array_record
class FramePair:
    """Two grey panoramas `first`, `second` (H, 2H) uint8, the first at `stamp_s` in the recording, `gap_s` apart."""

    stamp_s: float
    gap_s: float
    first: Grey
    second: Grey


@dataclass(frozen=True, eq=False)
@array_record
class Motion:
    """At `stamp_s`: `turn` of the rig to the right, deg/s; `way`, the bearing it goes in, degrees to the right of the
    panorama's centre; `sides`, apparent speed at right angles to the way, left and right, deg/s; `misfit` of these
    three, deg/s; `rates` (BEARINGS,), apparent motion to the right, deg/s; `texture` (BEARINGS,), how much there is to
    see, 0 for a bare wall."""

    stamp_s: float
    turn: float
    way: float
    sides: tuple[float, float]
    misfit: float
    rates: Floats
    texture: Floats


@dataclass(frozen=True, eq=False)
@array_record
class StripFlow:
    """The strip around the horizon of a pair's pictures, with `PAD` columns of its other end at each end: `first`,
    `second` (h, w + 2 PAD) uint8, and where each pixel of the first goes, `flow` (h, w + 2 PAD, 2) px."""

    first: Grey
    second: Grey
    flow: NDArray[np.float32]


def strip_flow(pair: FramePair, begin: StripFlow | None = None) -> StripFlow:
    """The apparent motion in a pair's strip, searched for from that of another pair where one is given."""
    height, _ = pair.first.shape
    rows = slice(round((90 - HIGH_DEG) / 180 * height), round((90 - LOW_DEG) / 180 * height))
    first, second = (
        np.asarray(cv2.copyMakeBorder(image[rows], 0, 0, PAD, PAD, cv2.BORDER_WRAP), np.uint8)
        for image in (pair.first, pair.second)
    )
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(
        first, second, np.empty(0) if begin is None else begin.flow.copy()
    )
    return StripFlow(first, second, np.asarray(flow, np.float32))


def motion_of(pair: FramePair, strip: StripFlow | None = None) -> Motion:
    """The motion between a pair's two pictures, of whose `strip` the flow may be known already."""
    rates, texture = _rates(pair, strip or strip_flow(pair))
    turn, way, sides, misfit = _fit(rates)
    return Motion(pair.stamp_s + pair.gap_s / 2, turn, way, sides, misfit, rates, texture)


def refitted(rates: Floats, way: float) -> tuple[float, float, float]:
    """Turn, and motion of the left and right side, deg/s, of rates (BEARINGS,) where the way is known."""
    turn, left, right = _corridors(rates, np.array([way]))[0][0].tolist()
    return turn, left, right


def wrapped(degrees: Floats) -> Floats:
    """Angles as equal ones between -180 and 180 degrees."""
    turned: Floats = (degrees + 180) % 360 - 180
    return turned


def bearings() -> Floats:
    """Degrees to the right of the panorama's centre (BEARINGS,) for which rates are given."""
    return (np.arange(BEARINGS) + 0.5) * 360 / BEARINGS - 180


def _rates(pair: FramePair, strip: StripFlow) -> tuple[Floats, Floats]:
    """Apparent motion to the right (BEARINGS,) deg/s, medians over textured pixels, and the texture (BEARINGS,)."""
    width, first = pair.first.shape[1], strip.first
    across = strip.flow[:, PAD : PAD + width, 0]
    upright, level = (np.abs(cv2.Sobel(first, cv2.CV_32F, x, 1 - x)[:, PAD : PAD + width]) / 8 for x in (1, 0))
    columns = np.arange(width) * BEARINGS // width
    counts = np.bincount(columns)
    number = np.arange(counts.max())
    taken = number < counts[:, None]
    of_bearing = np.minimum((np.cumsum(counts) - counts)[:, None] + number, width - 1)
    values, weights = across.T[of_bearing], np.where(taken[..., None], upright.T[of_bearing] + 0.01, 0)
    medians = _weighted_medians(values.reshape(BEARINGS, -1), weights.reshape(BEARINGS, -1))
    energy = np.bincount(columns, (upright + level).mean(axis=0)) / counts
    return medians * 360 / width / pair.gap_s, energy / (float(first.mean()) + 10.0)


def _weighted_medians(values: NDArray[Any], weights: NDArray[Any]) -> Floats:
    """The weighted median (n,) of each row (n, m)."""
    order = np.argsort(values, axis=1)
    total = np.cumsum(np.take_along_axis(weights, order, axis=1), axis=1)
    middle = np.argmax(total >= total[:, -1:] / 2, axis=1)
    row = np.arange(len(values))
    return np.asarray(values[row, order[row, middle]], np.float64)


def _fit(rates: Floats) -> tuple[float, float, tuple[float, float], float]:
    """Turn, way, sides and mean absolute misfit of the corridor's motion that fits rates (BEARINGS,) best."""
    ways = np.arange(_WAYS) * 360 / _WAYS - 180
    fitted, misfits = _corridors(rates, ways)
    misfits = np.where(fitted[:, 1] + fitted[:, 2] >= 0, misfits, np.inf)
    best = int(np.argmin(misfits))
    turn, left, right = fitted[best].tolist()
    return turn, float(ways[best]), (left, right), float(misfits[best])


def _corridors(rates: Floats, ways: Floats) -> tuple[Floats, Floats]:
    """For each way: turn, motion of the left and of the right side (n, 3), and mean misfit (n,); by reweighting."""
    sine = np.sin(np.radians(bearings() - ways[:, None]))
    model = np.stack([-np.ones_like(sine), -(np.minimum(sine, 0) ** 2), np.maximum(sine, 0) ** 2], axis=1)
    products = np.concatenate([(model[:, :, None] * model[:, None]).reshape(len(ways), 9, -1), model * rates], axis=1)
    weights = np.ones_like(sine)
    for _ in range(_REFITS):
        sums = products @ weights[..., None]
        normal = sums[:, :9].reshape(-1, 3, 3) + 1e-9 * np.eye(3)
        fitted = np.linalg.solve(normal, sums[:, 9:])[..., 0]
        residuals = np.abs(rates - (fitted[:, None] @ model)[:, 0])
        weights = 1 / np.maximum(residuals, _LEAST_RESIDUAL)
    return fitted, residuals.mean(axis=1)


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
        self._last: list[Grey] = []
        self._strip: StripFlow | None = None

    def update(self, panorama: Panorama) -> Grey:
        """Take the next frame; the picture that is taken of it."""
        picture = small_grey(panorama, WIDTH)
        self.take(panorama.stamp_s, picture)
        return picture

    def take(self, stamp_s: float, picture: Grey) -> None:
        """Take the picture of the next frame."""
        if self._last:
            motion, alike = self._step(self._stamps[-1], stamp_s, self._last[-1], picture)
            self._motions.append(motion)
            self._likeness.append(alike)
            self._pass_over_a_bad_frame(stamp_s, picture)
        self._stamps.append(stamp_s)
        self._last = [*self._last[-1:], picture]

    def _pass_over_a_bad_frame(self, stamp_s: float, picture: Grey) -> None:
        """Where a frame is like neither of its neighbours, and these are alike, it is a smeared one, and no break."""
        if len(self._likeness) >= 2 and max(self._likeness[-2:]) < UNALIKE:
            strip = strip_flow(_pair(self._stamps[-2], stamp_s, self._last[0], picture))
            if likeness(strip) > SAME_PLACE:
                self._likeness[-2:] = [UNALIKE, UNALIKE]

    def _step(self, first_s: float, second_s: float, first: Grey, second: Grey) -> tuple[Motion, float]:
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


def _pair(first_s: float, second_s: float, first: Grey, second: Grey) -> FramePair:
    return FramePair(first_s, max(second_s - first_s, 1e-3), first, exposed_as(second, first))


def exposed_as(picture: Grey, other: Grey) -> Grey:
    """A picture with the mean and the spread of another's grey values."""
    (mean, spread), (wanted, wide) = ((float(grey.mean()), float(grey.std())) for grey in (picture, other))
    if min(spread, wide) < DARKEST_SPREAD:
        return picture
    return np.asarray(np.clip((picture - mean) * (wide / spread) + wanted, 0, 255), np.uint8)


def likeness(strip: StripFlow) -> float:
    """The correlation of the details of the first picture with those that its pixels go to in the second; 1 where there
    are none."""
    y, x = np.mgrid[0 : strip.first.shape[0], 0 : strip.first.shape[1]].astype(np.float32)
    moved = cv2.remap(strip.second.astype(np.float32), x + strip.flow[..., 0], y + strip.flow[..., 1], cv2.INTER_LINEAR)
    pictures = (np.asarray(picture, np.float32) for picture in (strip.first, moved))
    a, b = ((picture - cv2.GaussianBlur(picture, (0, 0), DETAIL_PX))[:, PAD:-PAD] for picture in pictures)
    power = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / power if power > a.size else 1.0
