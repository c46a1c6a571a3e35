"""Lamps of a line by the places of their ends and centres: strips where the line is lit between two ends, and compact
lamps."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from savmap.plugin import Floats, RowFacts, Sightings
from savmap_lights.space.crossed import joined
from savmap_lights.space.line import SAME_LINE_M
from savmap_lights.space.places import SAME_LAMP_M, Aisle, Lamp, Place, places_of, shown

LIT = 0.75
LEAST_OPEN_M = 0.3
SHORTEST_M = 0.1


def lamps_of(aisle: Aisle) -> list[Lamp]:
    """The lamps of a line, of the kind of most marks: strips along it, strips across it, or compact lamps."""
    outward = aisle.marks.outward
    counts = [(outward[:, 0] != 0).sum(), (outward[:, 1] != 0).sum(), 2 * (outward == 0).all(axis=1).sum()]
    kind = int(np.argmax(counts))
    if kind == 0:
        starts, stops = (places_of(aisle, (sign, 0)) for sign in (-1, 1))
        return joined(_along(shown(starts, stops, aisle), shown(stops, starts, aisle), aisle.lit))
    if kind == 1:
        nears, fars = (places_of(aisle, (0, sign)) for sign in (-1, 1))
        return _across(shown(nears, (), aisle), shown(fars, (), aisle))
    return [{"centre": place} for place in shown(places_of(aisle, (0, 0)), (), aisle)]


def lit_stretches(middles: Sightings, level_m: float, line_z: float, facts: RowFacts) -> Floats:
    """Stretches (n, 2) of x, m, on which something on the line was seen lit."""
    places = middles.at(level_m)
    above = level_m - middles.origins[:, 1]
    focal = np.array([facts.views[feature.view].camera[0, 0] for feature in middles.features])
    spread = np.array([np.trace(feature.covariance[0]) for feature in middles.features])
    half = np.sqrt(spread) / np.maximum(focal, 1e-9) * above * (1 + np.square(middles.slopes).sum(axis=1))
    on_line = np.abs(places[:, 1] - line_z) <= SAME_LINE_M
    return np.stack([places[on_line, 0] - half[on_line], places[on_line, 0] + half[on_line]], axis=1)


def _along(starts: Sequence[Place], stops: Sequence[Place], lit: Floats) -> list[Lamp]:
    """Strips along the line: a start is paired with the stop that follows it, if the line is lit between them. A start
    or a stop without a partner, beside a lit stretch, is a strip with one end in sight."""
    lamps: list[Lamp] = []
    paired: list[Place] = []
    ends = sorted([*starts, *stops], key=lambda place: place.x - place.outward[0] * SHORTEST_M / 4)
    for here, after in pairwise(ends):
        if here.outward[0] < 0 < after.outward[0] and _is_lit(here.x, after.x, lit):
            lamps.append({"end 0": here, "end 1": after})
            paired += [here, after]
    for number, here in enumerate(ends):
        if not any(here is other for other in paired):
            beyond = [other.x for other in (ends[number + 1 :] if here.outward[0] < 0 else ends[:number])]
            limit = (min if here.outward[0] < 0 else max)(beyond, default=-here.outward[0] * np.inf)
            lamps += _open(here, limit, lit)
    return sorted(lamps, key=lambda lamp: min(place.x for place in lamp.values()))


def _is_lit(start: float, stop: float, lit: Floats) -> bool:
    """Whether a stretch is long enough for a strip and most of it was seen lit."""
    inside = lit[(lit[:, 0] < stop) & (lit[:, 1] > start)]
    marks = np.linspace(start, stop, 41)[1:-1]
    covered = ((inside[:, :1] <= marks) & (marks <= inside[:, 1:])).any(axis=0)
    return bool(stop - start >= SHORTEST_M and covered.mean() >= LIT)


def _open(place: Place, limit: float, lit: Floats) -> list[Lamp]:
    """A strip with one end in sight, as far as it was seen lit without a break, at most to `limit`; none if that is
    short."""
    direction = -place.outward[0]
    reach = 0.0
    stretches = np.sort(direction * (lit - place.x), axis=1)
    for low, high in stretches[np.argsort(stretches[:, 0])]:
        if low <= reach + SHORTEST_M and high > reach:
            reach = min(float(high), direction * (limit - place.x))
    part = "end 0" if direction > 0 else "end 1"
    long = reach > LEAST_OPEN_M
    return [{part: replace(place, seen_to=place.x + direction * reach)}] if long else []


def _across(nears: Sequence[Place], fars: Sequence[Place]) -> list[Lamp]:
    """Strips across the line: ends on either side at one place along it."""
    lamps: list[Lamp] = []
    for near in nears:
        nearby = [far for far in fars if abs(far.x - near.x) <= SAME_LAMP_M]
        if nearby:
            lamps.append({"end 0": near, "end 1": min(nearby, key=lambda far: abs(far.x - near.x))})
    return lamps
