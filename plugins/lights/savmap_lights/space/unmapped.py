"""Light on the line of lamps that no mapped lamp explains."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.plugin import Sightings
from savmap.vision import peaks
from savmap_lights.space.line import LEAST_FRAMES
from savmap_lights.space.places import SAME_LAMP_M, Lamp

BESIDE_M = 0.4
ASIDE_M = 0.25


@dataclass(frozen=True)
class Light:
    """Something that shines: where along x, m, and in how many frames it was seen to."""

    x: float
    frames: int


def shining(seen: Sightings, level_m: float, line_z: float, lamps: Sequence[Lamp]) -> list[Light]:
    """What on the line was seen to shine in enough frames, away from all lamps."""
    at = seen.at(level_m)
    own = (np.abs(at[:, 1] - line_z) < ASIDE_M) & ~seen.of_part("side")
    for lamp in lamps:
        low, high = reach_of(lamp)
        own &= (at[:, 0] < low - BESIDE_M) | (at[:, 0] > high + BESIDE_M)
    x, frames = at[own, 0], seen.frames[own]
    found = peaks.peaks(x, SAME_LAMP_M, LEAST_FRAMES)
    counts = [len(np.unique(frames[np.abs(x - place) <= SAME_LAMP_M])) for place in found]
    return [Light(place, count) for place, count in zip(found.tolist(), counts, strict=True) if count >= LEAST_FRAMES]


def light_beyond(lamps: Sequence[Lamp], lights: Sequence[Light]) -> list[Light | None]:
    """For each lamp, in their order along x, the light between it and the next that most frames saw."""
    reaches = [reach_of(lamp) for lamp in lamps]
    nexts = [*(low for low, _ in reaches[1:]), np.inf]
    return [
        max((light for light in lights if high < light.x < after), key=lambda light: light.frames, default=None)
        for (_, high), after in zip(reaches, nexts, strict=True)
    ]


def light_before(lamps: Sequence[Lamp], lights: Sequence[Light]) -> Light | None:
    """The last light before the first lamp."""
    first = reach_of(lamps[0])[0]
    return max((light for light in lights if light.x < first), key=lambda light: light.x, default=None)


def reach_of(lamp: Lamp) -> tuple[float, float]:
    """From where to where along x a lamp was seen."""
    ends = [x for place in lamp.values() for x in (place.x, place.seen_to) if x is not None]
    return min(ends), max(ends)
