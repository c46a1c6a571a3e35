"""Straights of a recording: stretches between turns, with their directions of travel, and how near things are abeam.

The direction of travel is the rig's heading (the sum of its turning) plus the way it goes in the panorama. A panorama
that was stabilised to one direction therefore serves as well as one that turns with the cart, and going in reverse is
another direction.

Along a line at distance d from the way every point passes at the rate v / d once its bearing is allowed for. What is
abeam (at right angles to the way) is compared with what passes fastest around, ahead and behind: the speed cancels out,
and the moment at which the end of a row is abeam shows as a step.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter

from savmap.apps.split.records import SplitSettings
from savmap.types import Bools, Floats, array_record
from savmap.video.motion import Motion, bearings, refitted, wrapped

_LEAST_RATE = 2.0
_WAY_FLIP = 90.0
_ABEAM_DEG = 13.0
_AROUND_DEG = 35.0
_LEAST_SINE = 0.3
_SHARE_NEAR = 60.0
_STILL = 1.5


@dataclass(frozen=True)
class Straight:
    """Samples `first` to `last` of a stretch without a turn; `way` in the panorama and `travel` (the rig's heading with
    it), degrees to the right; `travel` goes on counting beyond 180."""

    first: int
    last: int
    way: float
    travel: float


def headings(motions: Sequence[Motion]) -> Floats:
    """The rig's heading (n,) against the first sample's, degrees to the right, counted on beyond 180."""
    stamps = np.array([motion.stamp_s for motion in motions])
    turns = np.array([motion.turn for motion in motions])
    return np.concatenate([[0.0], np.cumsum(np.diff(stamps) * (turns[1:] + turns[:-1]) / 2)])


def straights(
    motions: Sequence[Motion], rig: Floats, settings: SplitSettings, cuts_s: Sequence[float] = ()
) -> list[Straight]:
    """The straights of a recording in order, `rig` as from `headings`; those in which nothing moved are left out, and
    none goes on over a cut (times, ascending, s)."""
    stamps = np.array([motion.stamp_s for motion in motions])
    bounds = [0, *np.searchsorted(stamps, cuts_s).tolist(), len(motions)]
    parts = (slice(first, end) for first, end in pairwise(bounds) if end > first)
    return [straight for part in parts for straight in _uncut(motions, rig, settings, part)]


def _uncut(motions: Sequence[Motion], rig: Floats, settings: SplitSettings, uncut: slice) -> list[Straight]:
    """The straights of a part of a recording without a cut."""
    calm = np.array([abs(motion.turn) < settings.turn_deg_s for motion in motions[uncut]])
    straight_parts: list[Straight] = []
    for first, last in ((first + uncut.start, last + uncut.start) for first, last in runs(calm)):
        for part in _one_way(motions, first, last):
            straight = _straight(motions, rig, *part)
            if straight is None:
                continue
            if straight_parts and _same(straight_parts[-1], straight, rig, settings.bend_deg):
                straight = _straight(motions, rig, straight_parts.pop().first, straight.last) or straight
            straight_parts.append(straight)
    return _extended(straight_parts, rig, settings.bend_deg, uncut)


def runs(flags: Bools) -> list[tuple[int, int]]:
    """First and last index of each run of true flags (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


def _one_way(motions: Sequence[Motion], first: int, last: int) -> list[tuple[int, int]]:
    """A run without a turn, divided where the camera goes back the way it came."""
    parts: list[tuple[int, int]] = []
    start, way = first, None
    for index in range(first, last + 1):
        motion = motions[index]
        if not _has_way(motion):
            continue
        if way is not None and abs(wrapped(np.array(motion.way - way))) > _WAY_FLIP:
            parts.append((start, index - 1))
            start, way = index, motion.way
        way = motion.way if way is None else way + 0.5 * float(wrapped(np.array(motion.way - way)))
    return [*parts, (start, last)]


def _has_way(motion: Motion) -> bool:
    """Whether the camera moves fast enough for its way to be known."""
    return sum(motion.sides) / 2 > max(_LEAST_RATE, motion.misfit)


def _straight(motions: Sequence[Motion], rig: Floats, first: int, last: int) -> Straight | None:
    """The straight of these samples; None where the way is not known in any."""
    moving = [index for index in range(first, last + 1) if _has_way(motions[index])]
    if not moving:
        return None
    weights = np.array([sum(motions[index].sides) for index in moving])
    ways = np.radians([motions[index].way for index in moving])
    way = float(np.degrees(np.angle((weights * np.exp(1j * ways)).sum())))
    return Straight(first, last, way, float(np.median(rig[moving])) + way)


def _same(first: Straight, second: Straight, rig: Floats, bend_deg: float) -> bool:
    """Whether the direction of travel is the same in both straights and between them."""
    between = rig[first.last : second.first + 1] + first.way - first.travel
    back = abs(float(wrapped(np.array(second.way - first.way)))) > _WAY_FLIP
    return not back and abs(second.travel - first.travel) < bend_deg and bool((np.abs(between) < bend_deg).all())


def _extended(straight_parts: Sequence[Straight], rig: Floats, bend_deg: float, part: slice) -> list[Straight]:
    """The straights, each extended into the turns at its ends while the direction of travel is nearly its own."""
    wider = []
    for number, straight in enumerate(straight_parts):
        low = straight_parts[number - 1].last + 1 if number else part.start
        high = straight_parts[number + 1].first - 1 if number + 1 < len(straight_parts) else part.stop - 1
        alike = np.abs(rig + straight.way - straight.travel) < bend_deg
        first, last = straight.first, straight.last
        while first > low and alike[first - 1]:
            first -= 1
        while last < high and alike[last + 1]:
            last += 1
        wider.append(replace(straight, first=first, last=last))
    return wider


@dataclass(frozen=True, eq=False)
@array_record
class Nearness:
    """Along a straight of n samples: `rates` (n, 2) abeam, left and right, deg/s; `tops` (n, 2), the fastest on each
    side; `texture` (n, 2) abeam; `still` (n,), whether the camera stands."""

    rates: Floats
    tops: Floats
    texture: Floats
    still: Bools


def nearness(motions: Sequence[Motion], rig: Floats, straight: Straight) -> Nearness:
    """Nearness along a straight; `rig` (all samples) as from `headings`."""
    span = range(straight.first, straight.last + 1)
    rows = [_sample(motions[index], straight.way, straight.travel - straight.way - rig[index]) for index in span]
    rates, tops, texture, still = (np.array(column) for column in zip(*rows, strict=True))
    return Nearness(rates, tops, texture, still)


def _sample(motion: Motion, way: float, off_deg: float) -> tuple[Floats, Floats, Floats, bool]:
    """Rates abeam (2,), the fastest (2,), texture (2,), and whether the camera stands. `off_deg`: how far to the right
    of the way the straight's direction is, degrees."""
    turn, left, right = refitted(motion.rates, way)
    from_way = np.radians(wrapped(bearings() - way))
    from_line = wrapped(bearings() - way - off_deg)
    parallax = (motion.rates + turn) * np.sign(np.sin(from_way))
    sines = np.abs(np.sin(from_way)) * np.abs(np.sin(np.radians(from_line)))
    scaled = np.where(sines > _LEAST_SINE, parallax / np.maximum(sines, _LEAST_SINE), 0.0)
    smooth = median_filter(scaled, size=5, mode="wrap")
    abeam = [np.abs(from_line - angle) < _ABEAM_DEG for angle in (-90.0, 90.0)]
    rates = np.array([float(np.percentile(scaled[hand], _SHARE_NEAR)) for hand in abeam])
    around = [np.abs(from_line - angle) < 90 - _AROUND_DEG for angle in (-90.0, 90.0)]
    tops = np.array([float(smooth[hand].max()) for hand in around])
    texture = np.array([float(motion.texture[hand].mean()) for hand in abeam])
    return rates, tops, texture, max(left, right) < _STILL
