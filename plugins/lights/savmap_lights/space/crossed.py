"""Parts of strips. A girder or a cable tray at a strip's height crosses it, so that the strip shows as two or more; the
parts are joined.

Parts are nearer to one another than lamps are, and together they have the length of the other strips.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.plugin import Floats
from savmap_lights.space.places import Lamp

FEWEST = 3
ALIKE, ALIKE_M = 0.01, 0.02
TOGETHER, TOGETHER_M = 0.05, 0.02
"""So far the length of parts together may be off the usual one: on an overexposed ceiling ends come out a little too
far apart, some more than others."""
MOST_PARTS = 4
NEARER = 0.5
"""The gap between parts is at most this share of the least gap between whole strips."""


def joined(lamps: Sequence[Lamp]) -> list[Lamp]:
    """Strips along a line, ordered along x, with the parts of a strip joined. At least three other strips must have
    equal lengths."""
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
    """Start and stop of a strip along x, m, as far as it was seen."""
    x = [place.x for place in lamp.values()]
    x += [place.seen_to for place in lamp.values() if place.seen_to is not None]
    return min(x), max(x)


def _usual_strip(lamps: Sequence[Lamp], extents: Floats) -> tuple[float, float] | None:
    """The greatest length that enough strips have in common, m, and the least gap between two of these. None where
    there is none."""
    lengths = np.diff(extents, axis=1)[:, 0]
    two_ends = np.array([len(lamp) == 2 for lamp in lamps], np.bool_)
    same_length = (np.abs(lengths - lengths[:, None]) < ALIKE * lengths + ALIKE_M) & two_ends & two_ends[:, None]
    common = same_length.sum(axis=1) >= FEWEST
    if not common.any():
        return None
    chosen = same_length[int(np.argmax(np.where(common, lengths, 0.0)))]
    gaps = (extents[1:, 0] - extents[:-1, 1])[chosen[1:] & chosen[:-1]]
    return (float(np.median(lengths[chosen])), float(gaps.min())) if len(gaps) else None


def _last_part(lamps: Sequence[Lamp], extents: Floats, first: int, length: float, gap: float) -> int:
    """The index of the last part of the strip that begins with lamp `first`; `first` itself where the lamp is a whole
    strip."""
    for last in range(first + 1, min(first + MOST_PARTS, len(lamps))):
        gap_before = extents[last, 0] - extents[last - 1, 1]
        if gap_before > NEARER * gap:
            break
        reach = extents[last, 1] - extents[first, 0]
        ends = "end 0" in lamps[first] and "end 1" in lamps[last]
        if ends and abs(reach - length) < TOGETHER * length + TOGETHER_M:
            return last
    return first


def _of_parts(first: Lamp, last: Lamp) -> Lamp:
    """The strip from the start of its first part to the end of its last one."""
    return {"end 0": replace(first["end 0"], seen_to=None), "end 1": replace(last["end 1"], seen_to=None)}
