"""Light on the line of lamps that no mapped lamp explains."""

from collections.abc import Sequence

import numpy as np

from savmap.plugin import Floats, Sightings
from savmap.vision import peaks
from savmap_lights.space.lamps import Lamp
from savmap_lights.space.line import LEAST_FRAMES
from savmap_lights.space.places import SAME_LAMP_M

BESIDE_M = 0.4
ASIDE_M = 0.25


def shining(seen: Sightings, level_m: float, line_z: float, lamps: Sequence[Lamp]) -> Floats:
    """Places (n,) along x where something on the line was seen to shine in enough frames, away from all lamps."""
    at = seen.at(level_m)
    own = (np.abs(at[:, 1] - line_z) < ASIDE_M) & ~seen.of_part("side")
    for lamp in lamps:
        low, high = reach_of(lamp)
        own &= (at[:, 0] < low - BESIDE_M) | (at[:, 0] > high + BESIDE_M)
    x, frames = at[own, 0], seen.frames[own]
    found = peaks.peaks(x, SAME_LAMP_M, LEAST_FRAMES)
    enough = [len(np.unique(frames[np.abs(x - place) <= SAME_LAMP_M])) >= LEAST_FRAMES for place in found]
    return found[np.array(enough, np.bool_)]


def light_beyond(lamps: Sequence[Lamp], places: Floats) -> list[float | None]:
    """For each lamp, in their order along x, the first of some places that lies between it and the next."""
    reaches = [reach_of(lamp) for lamp in lamps]
    nexts = [*(low for low, _ in reaches[1:]), np.inf]
    return [
        min((x for x in places.tolist() if high < x < after), default=None)
        for (_, high), after in zip(reaches, nexts, strict=True)
    ]


def light_before(lamps: Sequence[Lamp], places: Floats) -> float | None:
    """The last of some places that lies before the first lamp."""
    first = reach_of(lamps[0])[0]
    return max((x for x in places.tolist() if x < first), default=None)


def reach_of(lamp: Lamp) -> tuple[float, float]:
    """From where to where along x a lamp was seen."""
    ends = [x for place in lamp.values() for x in (place.x, place.seen_to) if x is not None]
    return min(ends), max(ends)
