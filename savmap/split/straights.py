"""Where the recording goes straight: stretches between turns, with the direction of travel of each.

The direction of travel is the rig's heading (its turning summed up) plus the way it goes in the panorama; so a panorama that is
held level and northwards afterwards does as well as one that turns with the cart, and going in reverse is another
direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.split.motion import Motion, wrapped
from savmap.split.settings import Settings
from savmap.types import Floats

_LEAST_RATE = 2.0
_WAY_FLIP = 90.0


@dataclass(frozen=True)
class Straight:
    """Samples `first` to `last` of a stretch without a turn; `way` in the panorama and `travel` (the rig's heading with it),
    degrees to the right; `travel` goes on counting beyond 180."""

    first: int
    last: int
    way: float
    travel: float


def headings(motions: Sequence[Motion]) -> Floats:
    """The rig's heading (n,) against the first sample's, degrees to the right, counted on beyond 180."""
    stamps = np.array([one.stamp_s for one in motions])
    turns = np.array([one.turn for one in motions])
    return np.concatenate([[0.0], np.cumsum(np.diff(stamps) * (turns[1:] + turns[:-1]) / 2)])


def straights(motions: Sequence[Motion], rig: Floats, settings: Settings) -> list[Straight]:
    """The straights of a recording in order, `rig` as from `headings`; those in which nothing moved are left out."""
    calm = np.array([abs(one.turn) < settings.turn_deg_s for one in motions])
    found: list[Straight] = []
    for first, last in runs(calm):
        for part in _one_way(motions, first, last):
            straight = _straight(motions, rig, *part)
            if straight is None:
                continue
            if found and _same(found[-1], straight, rig, settings.bend_deg):
                straight = _straight(motions, rig, found.pop().first, straight.last) or straight
            found.append(straight)
    return _reaching_out(found, rig, settings.bend_deg)


def runs(flags: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> list[tuple[int, int]]:
    """First and last index of each run of true flags (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


def _one_way(motions: Sequence[Motion], first: int, last: int) -> list[tuple[int, int]]:
    """A run without a turn, parted where the camera goes back the way it came."""
    parts: list[tuple[int, int]] = []
    start, way = first, None
    for index in range(first, last + 1):
        one = motions[index]
        if not _tells_way(one):
            continue
        if way is not None and abs(wrapped(np.array(one.way - way))) > _WAY_FLIP:
            parts.append((start, index - 1))
            start, way = index, one.way
        way = one.way if way is None else way + 0.5 * float(wrapped(np.array(one.way - way)))
    return [*parts, (start, last)]


def _tells_way(one: Motion) -> bool:
    return sum(one.sides) / 2 > max(_LEAST_RATE, one.misfit)


def _straight(motions: Sequence[Motion], rig: Floats, first: int, last: int) -> Straight | None:
    """The straight of these samples; None where nothing tells the way."""
    known = [index for index in range(first, last + 1) if _tells_way(motions[index])]
    if not known:
        return None
    weights = np.array([sum(motions[index].sides) for index in known])
    ways = np.radians([motions[index].way for index in known])
    way = float(np.degrees(np.angle((weights * np.exp(1j * ways)).sum())))
    return Straight(first, last, way, float(np.median(rig[known])) + way)


def _same(one: Straight, other: Straight, rig: Floats, bend_deg: float) -> bool:
    """Whether the direction of travel is the same, and was on the way from one to the other."""
    between = rig[one.last : other.first + 1] + one.way - one.travel
    back = abs(float(wrapped(np.array(other.way - one.way)))) > _WAY_FLIP
    return not back and abs(other.travel - one.travel) < bend_deg and bool((np.abs(between) < bend_deg).all())


def _reaching_out(found: Sequence[Straight], rig: Floats, bend_deg: float) -> list[Straight]:
    """The straights with the parts of the turns at either end in which the direction is still nearly theirs."""
    wider = []
    for number, one in enumerate(found):
        low = found[number - 1].last + 1 if number else 0
        high = found[number + 1].first - 1 if number + 1 < len(found) else len(rig) - 1
        alike = np.abs(rig + one.way - one.travel) < bend_deg
        first, last = one.first, one.last
        while first > low and alike[first - 1]:
            first -= 1
        while last < high and alike[last + 1]:
            last += 1
        wider.append(replace(one, first=first, last=last))
    return wider
