"""Light on the line of lamps that no mapped lamp explains."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.plugin import Floats, Sightings
from savmap.vision import peaks
from savmap_lights.space.line import LEAST_FRAMES
from savmap_lights.space.places import SAME_LAMP_M, Lamp

BESIDE_M = 0.4
ASIDE_M = 0.25
OFTEN, NEAR_STEP = 0.75, 0.2
FEWEST, MOST, REGULAR = 4, 0.75, 0.05


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


def lights_beside(lamps: Sequence[Lamp], frames: Sequence[int], lights: Sequence[Light]) -> dict[int, float]:
    """By lamp, the x of light beside it that may be a lamp too: it was seen in about as many frames as the lamps on
    either side of it, or the only one, and is where a lamp would be by their spacing, if they have one. `lamps` are in
    their order along x, and were seen in so many `frames`."""
    reaches = np.array([reach_of(lamp) for lamp in lamps])
    spaced = spacing_of(reaches.mean(axis=1))
    light_of: dict[int, float] = {}
    for light in sorted(lights, key=lambda light: light.frames):
        after = int(np.searchsorted(reaches[:, 0], light.x))
        before = max(after - 1, 0)
        is_between = spaced is not None and abs(_off_step(light.x - spaced[0], spaced[1])) > NEAR_STEP
        if light.frames >= OFTEN * np.mean(frames[before : after + 1]) and not is_between:
            light_of[before] = light.x
    return light_of


def spacing_of(middles: Floats) -> tuple[float, float] | None:
    """A lamp's x and the spacing of lamps at these x (n,) in order, m: a step between two neighbours such that the
    others are so many steps away. None where they are few, or less than `MOST` of them are."""
    fitting = [
        (int((np.abs(_off_step(middles - x, step)) < REGULAR).sum()), step, x)
        for step in np.diff(middles).tolist()
        for x in middles.tolist()
        if step > 0
    ]
    count, step, x = max(fitting, default=(0, 0.0, 0.0))
    return (x, step) if count >= max(FEWEST, MOST * len(middles)) else None


def _off_step(along: Floats | float, step: float) -> Floats:
    """By what share of a step a distance, m, is off a whole number of them."""
    return np.asarray(along / step - np.round(along / step))


def reach_of(lamp: Lamp) -> tuple[float, float]:
    """Start and stop of a lamp along x, m, as far as it was seen."""
    ends = [x for place in lamp.values() for x in (place.x, place.seen_to) if x is not None]
    return min(ends), max(ends)
