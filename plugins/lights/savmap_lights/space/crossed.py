"""Strips that something crosses at their own height, a girder or a cable tray: what shows as two or more is one.

Parts are nearer to one another than lamps are, and reach together as far as the other strips do.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.plugin import Floats
from savmap_lights.space.places import Lamp

FEWEST = 3
ALIKE, ALIKE_M = 0.01, 0.02
MOST_PARTS = 4
NEARER = 0.5
"""Parts are not as far apart as this share of the least gap between whole strips."""


def joined(lamps: Sequence[Lamp]) -> list[Lamp]:
    """Strips along a line, ordered along x, with parts of one joined, where at least three others are as long as one another."""
    extents = np.array([_extent(lamp) for lamp in lamps]).reshape(-1, 2)
    usual = _usual_strip(lamps, extents)
    if usual is None:
        return list(lamps)
    length, gap = usual
    whole = list[Lamp]()
    first = 0
    while first < len(lamps):
        last = _last_part(lamps, extents, first, length, gap)
        whole.append(lamps[first] if last == first else _of_parts(lamps[first], lamps[last]))
        first = last + 1
    return whole


def _extent(lamp: Lamp) -> tuple[float, float]:
    """From where to where along x a strip was seen."""
    x = [place.x for place in lamp.values()]
    x += [place.seen_to for place in lamp.values() if place.seen_to is not None]
    return min(x), max(x)


def _usual_strip(lamps: Sequence[Lamp], extents: Floats) -> tuple[float, float] | None:
    """The greatest length that enough strips have, and the least gap beside one of these; None where too few are alike, or none has a neighbour."""
    lengths = np.diff(extents, axis=1)[:, 0]
    both = np.array([len(lamp) == 2 for lamp in lamps], np.bool_)
    alike = (np.abs(lengths - lengths[:, None]) < ALIKE * lengths + ALIKE_M) & both & both[:, None]
    common = alike.sum(axis=1) >= FEWEST
    if not common.any():
        return None
    chosen = alike[int(np.argmax(np.where(common, lengths, 0.0)))]
    gaps = (extents[1:, 0] - extents[:-1, 1])[chosen[1:] & chosen[:-1]]
    return (float(np.median(lengths[chosen])), float(gaps.min())) if len(gaps) else None


def _last_part(lamps: Sequence[Lamp], extents: Floats, first: int, length: float, gap: float) -> int:
    """The last part of the strip that begins with a lamp; the lamp itself where it is none of several."""
    for last in range(first + 1, min(first + MOST_PARTS, len(lamps))):
        apart = extents[last, 0] - extents[last - 1, 1]
        if apart > NEARER * gap:
            break
        reach = extents[last, 1] - extents[first, 0]
        ends = "end 0" in lamps[first] and "end 1" in lamps[last]
        if ends and abs(reach - length) < ALIKE * length + ALIKE_M:
            return last
    return first


def _of_parts(first: Lamp, last: Lamp) -> Lamp:
    """The strip from where its first part starts to where its last one stops."""
    return {"end 0": replace(first["end 0"], seen_to=None), "end 1": replace(last["end 1"], seen_to=None)}
