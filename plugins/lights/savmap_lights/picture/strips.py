"""Lit strips in a ceiling-facing view: the network says where a lamp is, the picture's brightness how far it reaches.

A network knows a long lamp by its ends and fades between them, so that masks end in the midst of it. What shines is the
brightest thing in the picture: from a mask, it is followed along its axis to where the brightness falls.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.plugin import Floats
from savmap_lights.picture.hidden import is_covered
from savmap_lights.picture.profiles import (
    DROP,
    VIEW_AXES,
    Singles,
    ends_of,
    is_stepped,
    median,
    normal_to,
    places_within,
    profile_of,
    sides,
)
from savmap_lights.picture.seeds import STRIP_RATIO, Seed

VARYING = (20.0, 0.0)
WIDER = 0.3
FIRST_STRIP = 10_000
BOTH_ENDS = 2
SAME_AXIS = np.cos(np.radians(4))
SLICES, FEWEST, PARTS = 24, 6, 5
THIN_PX, ROUNDS = 3.0, 3


@dataclass(frozen=True, eq=False)
class Body:
    """A lit strip: a number of its own, from `FIRST_STRIP`, its detections, axis (2,), width px, and its two ends (2,)
    px along the axis, None where it is cut, hidden or blurred; `covered`: where something that runs across hides an
    end; `reach`: how far it is seen either way (2, 2) px."""

    instance: int
    numbers: tuple[int, ...]
    axis: Floats
    width: float
    ends: tuple[Floats | None, Floats | None]
    covered: tuple[Floats, ...]
    reach: Floats


def strips(grey: Singles, seeds: Sequence[Seed]) -> list[Body]:
    """The strips that seeds are parts of; in a line of light, each up to its joints."""
    bodies: list[Body] = []
    taken: set[int] = set()
    for seed in seeds:
        if seed.number not in taken:
            line = _strip(grey, seed, seeds)
            bodies += [body for body in line if not any(overlap(body, other) for other in bodies)]
            taken |= {number for body in line for number in body.numbers}
    return [replace(body, instance=FIRST_STRIP + number) for number, body in enumerate(bodies)]


def overlap(body: Body, other: Body) -> bool:
    """Whether the middle of the shorter of two strips lies in the other."""
    short, long = sorted((body, other), key=length_of)
    offset = short.reach.mean(axis=0) - long.reach[0]
    return _within(offset, long.axis, long.width, 0.0, length_of(long))


def _strip(grey: Singles, seed: Seed, seeds: Sequence[Seed]) -> list[Body]:
    """The strip of a seed, with those that continue it: the first that shows both ends, else that with most ends, then
    the longest, of all axes and of two tolerances to how much its brightness may vary, which is little where the
    ceiling beside it is nearly as bright."""
    best: list[Body] = []
    for axis in _axes(seed, seeds):
        for varies in VARYING:
            line = _along(grey, replace(seed, level=seed.level - varies), axis, seeds)
            if line and _worth(line) == BOTH_ENDS:
                return line
            best = max((line, best), key=_size)
    return best


def _size(line: Sequence[Body]) -> tuple[int, float]:
    return (_worth(line), length_of(line[0])) if line else (0, 0.0)


def _worth(line: Sequence[Body]) -> int:
    return sum(end is not None for end in line[0].ends)


def length_of(body: Body) -> float:
    return float(np.linalg.norm(body.reach[1] - body.reach[0]))


def _axes(seed: Seed, seeds: Sequence[Seed]) -> list[Floats]:
    """Directions (2,) in which a seed's lamp may lie: its own where it is long, else those of the view and those to its
    likes."""
    if seed.length > STRIP_RATIO * seed.width:
        return [seed.axis]
    away = [other.middle - seed.middle for other in seeds if other is not seed]
    axes: list[Floats] = []
    for axis in (*VIEW_AXES, *(step / np.linalg.norm(step) for step in away if np.linalg.norm(step) > seed.width)):
        if all(abs(float(axis @ other)) < SAME_AXIS for other in axes):
            axes.append(axis)
    return axes


def _along(grey: Singles, seed: Seed, axis: Floats, seeds: Sequence[Seed]) -> list[Body]:
    """The strip through a seed along an axis, and those that continue it beyond joints; none where what is lit there is
    no strip."""
    middle, width = seed.middle, THIN_PX
    for number in range(ROUNDS):
        runs = _runs(grey, seed, middle, axis, width, others=number == ROUNDS - 1)
        if not runs or runs[0].high - runs[0].low < STRIP_RATIO * width:
            return []
        straight = _straightened(grey, seed, middle, axis, runs[0])
        if straight is None:
            return []
        middle, axis, width = straight
    sharp = [run for run in runs[1:] if run.low_sharp or run.high_sharp]
    alike = [run for run in sharp if _is_strip(grey, seed.level, middle, axis, width, run)]
    return [_body(grey, run, middle, axis, width, seed, seeds) for run in (runs[0], *alike)]


def _is_strip(grey: Singles, level: float, middle: Floats, axis: Floats, width: float, run: "Run") -> bool:
    """Whether what is lit further along a strip's axis is as wide as this."""
    along = np.linspace(run.low, run.high, SLICES * PARTS + 2)[1:-1].reshape(SLICES, PARTS)
    left, right = sides(grey, middle, (axis, normal_to(axis)), along, 1.5 * width + 4, level)
    return bool(np.count_nonzero(np.abs(right - left - width) <= WIDER * width + 1) > SLICES / 2)


def _body(
    grey: Singles, run: "Run", middle: Floats, axis: Floats, width: float, seed: Seed, seeds: Sequence[Seed]
) -> Body:
    low, high = (middle + at * axis for at in (run.low, run.high))
    inside = {other.number for other in seeds if _within(other.middle - middle, axis, width, run.low, run.high)}
    numbers = tuple(sorted(inside)) or (seed.number,)
    sharp = [(low, run.low, run.low_sharp), (high, run.high, run.high_sharp)]
    hidden = [
        is_sharp and is_covered(grey, middle, axis, width, at, outward)
        for (_, at, is_sharp), outward in zip(sharp, (-1, 1), strict=True)
    ]
    ends = [
        pixel if is_sharp and not hides else None for (pixel, _, is_sharp), hides in zip(sharp, hidden, strict=True)
    ]
    covered = tuple(pixel for (pixel, _, _), hides in zip(sharp, hidden, strict=True) if hides)
    return Body(0, numbers, axis, width, (ends[0], ends[1]), covered, np.array([low, high]))


@dataclass(frozen=True)
class Run:
    """What is lit along an axis around a place: from `low` to `high` px, and whether it ends there sharply."""

    low: float
    high: float
    low_sharp: bool
    high_sharp: bool


def _within(offset: Floats, axis: Floats, width: float, low: float, high: float) -> bool:
    along = float(offset @ axis)
    sideways = abs(float(offset[0] * axis[1] - offset[1] * axis[0]))
    return low - 1 <= along <= high + 1 and sideways < 0.75 * width


def _runs(grey: Singles, seed: Seed, middle: Floats, axis: Floats, width: float, others: bool) -> list[Run]:
    """What is lit along an axis: the seed's own run first, then, if they are asked for, others as long as a strip; none
    without the first."""
    places = places_within(grey, middle, axis)
    if len(places) < 2:
        return []
    profile = profile_of(grey, middle, axis, places, 0.3 * width)
    lit = np.concatenate([[False], profile >= seed.level - DROP, [False]])
    changes = np.flatnonzero(lit[1:] != lit[:-1])
    firsts, lasts = changes[::2], changes[1::2] - 1
    if not len(firsts):
        return []
    away = np.maximum(np.maximum(places[firsts], -places[lasts]), 0.0)
    inner = int(np.argmin(away))
    if away[inner] > seed.length / 2:
        return []
    long = np.flatnonzero(places[lasts] - places[firsts] >= width).tolist() if others else []
    kept = np.array([inner, *(k for k in long if k != inner)])
    ends, sharp = ends_of(profile, places, firsts[kept], lasts[kept])
    if others:
        for way, line, dark in ((0, profile[::-1], len(places) - firsts), (1, profile, lasts + 1)):
            for k in np.flatnonzero(sharp[way]):
                sharp[way, k] = not is_stepped(line, int(dark[kept[k]]))
    return [Run(*run) for run in zip(*ends.tolist(), *sharp.tolist(), strict=True)]


def _straightened(
    grey: Singles, seed: Seed, middle: Floats, axis: Floats, run: Run
) -> tuple[Floats, Floats, float] | None:
    """Middle, axis and width of a strip by where its brightness falls sharply to either side; None where it does not in
    most places."""
    margin = 0.1 * (run.high - run.low)
    along = np.linspace(run.low + margin, run.high - margin, SLICES * PARTS).reshape(SLICES, PARTS)
    normal = normal_to(axis)
    left, right = sides(grey, middle, (axis, normal), along, seed.length + 8, seed.level)
    wide = right - left
    both = np.isfinite(wide)
    width = median(wide[both]) if np.count_nonzero(both) >= FEWEST else seed.width
    both &= np.abs(wide - width) <= 0.3 * width + 1
    either = np.where(np.isfinite(left), left + width / 2, right - width / 2)
    centre = np.where(both, (left + right) / 2, either)
    lit = both if np.count_nonzero(both) >= FEWEST else np.isfinite(centre)
    if np.count_nonzero(lit) < SLICES / 3:
        return None
    slope, shift, off = _line(along.mean(axis=1)[lit], centre[lit])
    if off > 0.15 * width + 0.7:
        return None
    turned = axis + slope * normal
    return middle + shift * normal, turned / np.linalg.norm(turned), width


def _line(at: Floats, values: Floats) -> tuple[float, float, float]:
    """Slope and value at 0 of a line through values (n,), without those that are far from it, and the median distance
    to it."""
    slope, shift = 0.0, median(values)
    for _ in range(4):
        off = np.abs(values - slope * at - shift)
        near = off <= max(3 * median(off), 0.3)
        count = np.count_nonzero(near)
        if count < FEWEST:
            break
        places, heights = at[near], values[near]
        about = places.sum() / count
        offset = places - about
        slope = float(offset @ heights / (offset @ offset))
        shift = float(heights.sum() / count - slope * about)
    return slope, shift, median(np.abs(values - slope * at - shift))
