"""Overexposed ceilings: where a lamp's light makes the ceiling about it as bright as itself, the last levels below
white still tell them apart.

A lamp is white in all colours; a ceiling that it lights is so in one colour or two, and seldom in the darkest.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from savmap.plugin import Detection, Floats
from savmap_lights.picture.compact import Compact
from savmap_lights.picture.profiles import HALF, VIEW_AXES, Singles, sampled
from savmap_lights.picture.seeds import LEAST_PX, brightness_of
from savmap_lights.picture.strips import Body, length_of

WHITE, LEVELS = 245.0, 10.0
SMOOTH_PX, ABOUT_PX = 0.7, 4
NEARLY, GLARING = 0.3, 0.25
BESIDE, AS_WHITE = 0.25, 0.7
NEAR_BY_PX, AROUND_PX = np.array([3.0, 4.5, 6.0]), np.arange(3.0, 12.1, 1.5)
FULL = 50.0
NEAR_PX, FAR_PX, STEP_PX, WITHIN_PX = 2.5, 5.0, 0.25, 3.0
LEAST_CONTRAST = 1.0
LEDGE_PX, LEDGE_LEVELS = 3.0, 1.2
SURELY_LAMP = 0.85


@dataclass(frozen=True, eq=False)
class Glare:
    """An overexposed picture in its darkest colour (h, w), smoothed, and the last levels of that before white, 0 to
    50."""

    darkest: Singles
    last: Singles

    @property
    def outlines(self) -> Singles:
        """The last levels, lamps evened: what noise darkens a lamp by is no edge."""
        return np.asarray(np.minimum(self.last / SURELY_LAMP, FULL), np.float32)


def glare_of(image: np.ndarray, grey: Singles, detections: Sequence[Detection]) -> Glare | None:
    """The glare of a picture (h, w, 3) where much is nearly, but not quite, as bright as the lamps; None where there is
    no such glare. What is as white as a lamp, a skylight, hides one behind it, and glares not."""
    large = [detection for detection in detections if np.count_nonzero(detection.mask) >= LEAST_PX]
    if max((brightness_of(grey, detection) for detection in large), default=0.0) < WHITE:
        return None
    red, green, blue = cv2.split(image)
    least = cv2.min(cv2.min(red, green), blue).astype(np.float32)
    darkest: Singles = np.asarray(cv2.GaussianBlur(least, (0, 0), SMOOTH_PX), np.float32)
    white = max(brightness_of(darkest, detection) for detection in large)
    if white < WHITE:
        return None
    least, most = white - LEVELS * (1 - np.array([NEARLY, SURELY_LAMP]))
    bright = darkest > least
    lamps = np.zeros(bright.shape, np.uint8)
    for detection in large:
        lamps[detection.place] |= detection.mask[detection.place].view(np.uint8)
    about = np.ones((2 * ABOUT_PX + 1, 2 * ABOUT_PX + 1), np.uint8)
    glaring = np.count_nonzero(bright & (darkest < most) & (cv2.dilate(lamps, about) == 0))
    if glaring <= GLARING * np.count_nonzero(bright):
        return None
    last = np.clip((darkest - (white - LEVELS)) / LEVELS, 0, 1) * FULL
    return Glare(darkest, np.asarray(last, np.float32))


def beside_strip(last: Singles, body: Body) -> bool:
    """Whether what is beside a strip is nearly, but not quite, as bright as the strip."""
    return _beside(last, body.reach.mean(axis=0), body.axis, length_of(body), body.width)


def beside_compact(last: Singles, lamp: Compact) -> bool:
    """Whether what is beside a compact lamp, on any side, is nearly, but not quite, as bright as the lamp."""
    ways = enumerate(VIEW_AXES)
    return any(_beside(last, lamp.middle, axis, lamp.sizes[k], lamp.sizes[1 - k]) for k, axis in ways)


def _beside(last: Singles, middle: Floats, axis: Floats, length: float, width: float) -> bool:
    along = np.linspace(-0.4, 0.4, 2 * round(length / 4) + 3) * length
    near, around = (
        [sampled(last, middle, axis, along, way * (width / 2 + sideways)) / FULL for way in (-1, 1)]
        for sideways in (NEAR_BY_PX, AROUND_PX)
    )
    bright = max(float((values > NEARLY).mean()) for values in near)
    return bright > BESIDE and max(float(values.mean()) for values in around) < AS_WHITE


def strip_again(darkest: Singles, body: Body) -> Body:
    """A strip found in the last levels, its ends where all levels fall half-way: the last ones fall too soon before
    what is dark."""
    first, second = body.ends
    return replace(
        body,
        ends=(
            None if first is None else _half_way(darkest, first, -body.axis, 0.3 * body.width),
            None if second is None else _half_way(darkest, second, body.axis, 0.3 * body.width),
        ),
    )


def compact_again(darkest: Singles, lamp: Compact) -> Compact:
    """A compact lamp found in the last levels, its sides where all levels fall half-way, or where something that
    adjoins it and is hardly darker begins."""
    middle, sizes = lamp.middle, [0.0, 0.0]
    for number, axis in enumerate(VIEW_AXES):
        half = 0.3 * lamp.sizes[1 - number]
        low, high = (
            _without_ledge(darkest, lamp.middle, _half_way(darkest, side, sign * axis, half), sign * axis, half)
            for sign in (-1, 1)
            for side in [lamp.middle + sign * lamp.sizes[number] / 2 * axis]
        )
        sizes[number] = float((high - low) @ axis)
        middle = middle + (float((low + high) @ axis) / 2 - float(lamp.middle @ axis)) * axis
    return replace(lamp, middle=middle, sizes=(sizes[0], sizes[1]))


def _without_ledge(darkest: Singles, middle: Floats, side: Floats, outward: Floats, half: float) -> Floats:
    """A lamp's side, or, where what shines before it is evenly darker than the lamp's middle, the place where that
    begins."""
    reach = float((side - middle) @ outward)
    if reach <= 2 * LEDGE_PX:
        return side
    along = np.arange(0.0, reach, STEP_PX)
    line = sampled(darkest, middle, outward, along, np.linspace(-half, half, 2 * round(half) + 3)).mean(axis=1)
    core = float(np.median(line[along < reach / 2]))
    full = along[np.flatnonzero(line >= core - LEDGE_LEVELS)[-1]]
    ledge = line[(along > full + 1) & (along < reach - NEAR_PX / 2)]
    if reach - full < LEDGE_PX or not len(ledge):
        return side
    k = int(np.flatnonzero(line >= (core + float(np.median(ledge))) / 2)[-1])
    moved: Floats = middle + (float(along[k]) + STEP_PX / 2) * outward
    return moved


def _half_way(darkest: Singles, pixel: Floats, outward: Floats, half: float) -> Floats:
    """Where, near a pixel, brightness falls half-way between what is inside and what is outside of it; the pixel where
    it does not."""
    along = np.arange(-FAR_PX, FAR_PX + 0.01, STEP_PX)
    line = sampled(darkest, pixel, outward, along, np.linspace(-half, half, 2 * round(half) + 3)).mean(axis=1)
    inside, outside = line[along <= -NEAR_PX].mean(), line[along >= NEAR_PX].mean()
    under = np.flatnonzero((line < outside + HALF * (inside - outside)) & (np.abs(along) <= WITHIN_PX))
    if inside - outside < LEAST_CONTRAST or not len(under) or along[under[0]] <= -WITHIN_PX:
        return pixel
    k = int(under[0])
    share = (line[k - 1] - outside - HALF * (inside - outside)) / max(float(line[k - 1] - line[k]), 1e-9)
    moved: Floats = pixel + (float(along[k - 1]) + STEP_PX * float(np.clip(share, 0, 1))) * outward
    return moved
