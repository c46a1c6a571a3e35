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
    """A bright object: x, m, and the number of frames in which it was seen."""

    x: float
    frames: int


def shining(sightings: Sightings, level_m: float, line_z: float, lamps: Sequence[Lamp]) -> list[Light]:
    """Bright objects on the line, in enough frames, away from all lamps."""
    positions = sightings.at(level_m)
    unexplained = (np.abs(positions[:, 1] - line_z) < ASIDE_M) & ~sightings.of_part("side")
    for lamp in lamps:
        low, high = reach_of(lamp)
        unexplained &= (positions[:, 0] < low - BESIDE_M) | (positions[:, 0] > high + BESIDE_M)
    x, frames = positions[unexplained, 0], sightings.frames[unexplained]
    places = peaks.peaks(x, SAME_LAMP_M, LEAST_FRAMES)
    counts = [len(np.unique(frames[np.abs(x - place) <= SAME_LAMP_M])) for place in places]
    return [Light(place, count) for place, count in zip(places.tolist(), counts, strict=True) if count >= LEAST_FRAMES]


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
    """Start and stop of a lamp along x, m, as far as it was seen."""
    ends = [x for place in lamp.values() for x in (place.x, place.seen_to) if x is not None]
    return min(ends), max(ends)
