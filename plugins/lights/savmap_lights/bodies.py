"""Lit bodies in a ceiling-facing view: the network says where a lamp is, the picture's brightness how far it reaches.

A network knows a long lamp by its ends and fades between them, so that masks end in the midst of it. What shines is the brightest
thing in the picture: from a mask, it is followed along its axis to where the brightness falls.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.plugin import Detection, Floats

Singles = NDArray[np.float32]

STRIP_RATIO = 2.5
STEP_PX = 0.5
DROP, VARIES = 5.0, 20.0
BEYOND_PX = 9.0
SHARP_PX, STEEP = 3.5, 0.6
BESIDE_PX, COVERS, SAME_PX = 3.0, 8.0, 2.0
WIDER = 0.3
BORDER_PX = 3.0
SURE = 0.7
LEAST_PX = 12
FIRST_STRIP, FIRST_LIKE = 10_000, 20_000
VIEW_AXES = (np.array([1.0, 0.0]), np.array([0.0, 1.0]))
SLICES, FEWEST, PARTS = 24, 6, 5
THIN_PX, ROUNDS = 3.0, 3
HALF = 0.6


@dataclass(frozen=True, eq=False)
class Seed:
    """What a mask says of a lamp: number of its detection, middle (2,) px, long axis (2,), length and width px, and brightness."""

    number: int
    middle: Floats
    axis: Floats
    length: float
    width: float
    level: float


@dataclass(frozen=True, eq=False)
class Body:
    """A lit strip: a number of its own, from `FIRST_STRIP`, its detections, axis (2,), width px, and its two ends (2,) px along the axis,
    None where it is cut, hidden or blurred; `covered`: where something that runs across hides an end; `reach`: how far it is seen either way (2, 2) px."""

    instance: int
    numbers: tuple[int, ...]
    axis: Floats
    width: float
    ends: tuple[Floats | None, Floats | None]
    covered: tuple[Floats, ...]
    reach: Floats


def seeds_of(grey: Singles, detections: Sequence[Detection]) -> list[Seed]:
    """The detections' seeds, the largest first."""
    found = [_seed(grey, detection, number) for number, detection in enumerate(detections)]
    return sorted((seed for seed in found if seed is not None), key=lambda seed: -seed.length * seed.width)


def _seed(grey: Singles, detection: Detection, number: int) -> Seed | None:
    rows, columns = np.nonzero(detection.mask)
    if len(rows) < LEAST_PX:
        return None
    weights = detection.probability[rows, columns].astype(np.float64)
    pixels = np.stack([columns, rows], axis=1).astype(np.float64)
    middle = np.average(pixels, axis=0, weights=weights)
    spread, axes = np.linalg.eigh(np.cov((pixels - middle).T, aweights=weights) + 1e-9 * np.eye(2))
    long, wide = np.sqrt(12 * spread[1]), np.sqrt(12 * spread[0])
    sure = weights >= min(SURE, float(weights.max()))
    level = float(np.percentile(grey[rows, columns][sure], 75))
    return Seed(number, middle, axes[:, 1], float(long), float(wide), level)


def strips(grey: Singles, seeds: Sequence[Seed]) -> list[Body]:
    """The strips that seeds are parts of; in a line of light, each up to its joints."""
    found: list[Body] = []
    taken: set[int] = set()
    for seed in seeds:
        if seed.number not in taken:
            line = _strip(grey, seed, seeds)
            found += [body for body in line if not any(_overlap(body, other) for other in found)]
            taken |= {number for body in line for number in body.numbers}
    return [replace(body, instance=FIRST_STRIP + number) for number, body in enumerate(found)]


def _overlap(body: Body, other: Body) -> bool:
    """Whether the middle of the shorter of two strips lies in the other."""
    short, long = sorted((body, other), key=_length)
    offset = short.reach.mean(axis=0) - long.reach[0]
    return _within(offset, long.axis, long.width, 0.0, _length(long))


def _strip(grey: Singles, seed: Seed, seeds: Sequence[Seed]) -> list[Body]:
    """The strip of a seed, with those that continue it: that with most ends, then the longest, of all axes and of two tolerances to how
    much its brightness may vary, which is little where the ceiling beside it is nearly as bright."""
    levels = [replace(seed, level=seed.level - varies) for varies in (VARIES, 0.0)]
    tried = [line for axis in _axes(seed, seeds) for own in levels if (line := _along(grey, own, axis, seeds))]
    return max(tried, key=_worth, default=[])


def _worth(line: Sequence[Body]) -> tuple[int, float]:
    return sum(end is not None for end in line[0].ends), _length(line[0])


def _length(body: Body) -> float:
    return float(np.linalg.norm(body.reach[1] - body.reach[0]))


def _axes(seed: Seed, seeds: Sequence[Seed]) -> Iterator[Floats]:
    """Directions (2,) in which a seed's lamp may lie: its own where it is long, else those of the view and those to its likes."""
    if seed.length > STRIP_RATIO * seed.width:
        yield seed.axis
        return
    for other in seeds:
        away = other.middle - seed.middle
        if other is not seed and np.linalg.norm(away) > seed.width:
            yield away / np.linalg.norm(away)
    yield from VIEW_AXES


def _along(grey: Singles, seed: Seed, axis: Floats, seeds: Sequence[Seed]) -> list[Body]:
    """The strip through a seed along an axis, and those that continue it beyond joints; none where what is lit there is no strip."""
    middle, width = seed.middle, THIN_PX
    for _ in range(ROUNDS):
        runs = _runs(grey, seed, middle, axis, width)
        if not runs or runs[0].high - runs[0].low < STRIP_RATIO * width:
            return []
        straight = _straightened(grey, seed, middle, axis, runs[0])
        if straight is None:
            return []
        middle, axis, width = straight
    alike = [run for run in runs[1:] if _is_strip(grey, seed.level, middle, axis, width, run)]
    return [_body(grey, run, middle, axis, width, seed, seeds) for run in (runs[0], *alike)]


def _is_strip(grey: Singles, level: float, middle: Floats, axis: Floats, width: float, run: "Run") -> bool:
    """Whether what is lit further along a strip's axis is as wide as this, and ends sharply somewhere."""
    along = np.linspace(run.low, run.high, SLICES * PARTS + 2)[1:-1]
    aside = np.arange(-1.5 * width - 4, 1.5 * width + 4.01, STEP_PX)
    values = sampled(grey, middle, axis, along, aside).reshape(SLICES, PARTS, -1).mean(axis=1)
    left, right = (_sides(values, aside, level, side) for side in (-1, 1))
    alike = np.abs(right - left - width) <= WIDER * width + 1
    return bool(alike.mean() > 0.5 and (run.low_sharp or run.high_sharp))


def _body(
    grey: Singles, run: "Run", middle: Floats, axis: Floats, width: float, seed: Seed, seeds: Sequence[Seed]
) -> Body:
    low, high = (middle + at * axis for at in (run.low, run.high))
    inside = {other.number for other in seeds if _within(other.middle - middle, axis, width, run.low, run.high)}
    numbers = tuple(sorted(inside)) or (seed.number,)
    sharp = [(low, run.low, run.low_sharp), (high, run.high, run.high_sharp)]
    hidden = [is_sharp and _is_covered(grey, middle, axis, width, at) for _, at, is_sharp in sharp]
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
    aside = abs(float(offset[0] * axis[1] - offset[1] * axis[0]))
    return low - 1 <= along <= high + 1 and aside < 0.75 * width


def _runs(grey: Singles, seed: Seed, middle: Floats, axis: Floats, width: float) -> list[Run]:
    """What is lit along an axis: the seed's own run first, then others as long as a strip."""
    places = _inside(grey, middle, axis)
    if len(places) < 2:
        return []
    profile = _profile(grey, middle, axis, places, 0.3 * width)
    lit = np.concatenate([[False], profile >= seed.level - DROP, [False]])
    changes = np.flatnonzero(lit[1:] != lit[:-1])
    firsts, lasts = changes[::2], changes[1::2] - 1
    if not len(firsts):
        return []
    away = np.maximum(np.maximum(places[firsts], -places[lasts]), 0.0)
    own = int(np.argmin(away))
    if away[own] > seed.length / 2:
        return []
    long = np.flatnonzero(places[lasts] - places[firsts] >= width)
    chosen = [own, *(k for k in long.tolist() if k != own)]
    return [_run(profile, places, int(firsts[k]), int(lasts[k])) for k in chosen]


def _run(profile: Floats, places: Floats, first: int, last: int) -> Run:
    end = len(places) - 1
    low = _fall(profile[::-1], places[::-1], end - first + 1) if first > 0 else (float(places[0]), False)
    high = _fall(profile, places, last + 1) if last < end else (float(places[end]), False)
    return Run(low[0], high[0], low[1], high[1])


def _is_covered(grey: Singles, middle: Floats, axis: Floats, width: float, at: float) -> bool:
    """Whether the brightness changes sharply beside a strip too where this ends, to both sides: something that runs across hides it."""
    reach = SHARP_PX / 2 + SAME_PX
    along = at + np.arange(-reach, reach + 0.01, STEP_PX)
    steep = round(SHARP_PX / STEP_PX)
    for side in (-1, 1):
        begin = 0.5 * width + max(BESIDE_PX, 0.25 * width)
        aside = side * np.linspace(begin, begin + 2 * BESIDE_PX, 5)
        line = sampled(grey, middle, axis, along, aside).mean(axis=1)
        steps = np.abs(line[steep:] - line[:-steep])
        if steps.max() < COVERS:
            return False
    return True


def _fall(profile: Floats, places: Floats, dark: int) -> tuple[float, bool]:
    """Where a profile falls steepest about its first dark place, and whether it does so sharply, by most of what it falls nearby, and
    well within the picture."""
    steep = round(SHARP_PX / STEP_PX)
    begin, end = max(dark - 2 * steep, 0), min(dark + round(BEYOND_PX / STEP_PX), len(profile))
    line, where = profile[begin:end], places[begin:end]
    if len(line) <= steep:
        return float(places[dark]), False
    drops = line[:-steep] - line[steep:]
    k = int(np.argmax(drops))
    drop, floor = float(drops[k]), float(line[k + steep])
    middle = _crossing(line[k:], where[k:], floor + HALF * drop)
    nearby = float(line[: k + 1].max() - line[k:].min())
    return middle, bool(drop >= max(DROP, STEEP * nearby) and abs(middle - places[-1]) > BORDER_PX)


def _crossing(line: Floats, where: Floats, level: float) -> float:
    """Where values that fall pass a level for the first time."""
    under = np.flatnonzero(line < level)
    if not len(under):
        return float(where[-1])
    k = int(under[0])
    if k == 0:
        return float(where[0])
    share = (line[k - 1] - level) / max(line[k - 1] - line[k], 1e-9)
    return float(where[k - 1] + share * (where[k] - where[k - 1]))


def _inside(grey: Singles, middle: Floats, axis: Floats) -> Floats:
    """Places along an axis, px from the middle, within the picture."""
    size = np.array([grey.shape[1], grey.shape[0]]) - 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        limits = np.stack([-middle / axis, (size - middle) / axis])
    limits = np.where(np.isfinite(limits), limits, np.array([[-np.inf], [np.inf]]))
    low, high = limits.min(axis=0).max(), limits.max(axis=0).min()
    return np.arange(np.ceil(low / STEP_PX), np.floor(high / STEP_PX) + 1) * STEP_PX


def _profile(grey: Singles, middle: Floats, axis: Floats, places: Floats, half: float) -> Floats:
    """Mean brightness (n,) at places along an axis, over a band of `half` px to either side."""
    aside = np.linspace(-half, half, max(3, 2 * round(half) + 1))
    profile: Floats = sampled(grey, middle, axis, places, aside).mean(axis=1)
    return profile


def sampled(grey: Singles, middle: Floats, axis: Floats, along: Floats, aside: Floats) -> Floats:
    """Brightness (n, m) at places along and aside of an axis."""
    return _sampled_at(grey, middle, axis, np.array([-axis[1], axis[0]]), along, aside)


def _sampled_at(grey: Singles, middle: Floats, axis: Floats, normal: Floats, along: Floats, aside: Floats) -> Floats:
    pixels = (middle + along[:, None, None] * axis + aside[None, :, None] * normal).astype(np.float32)
    values = cv2.remap(grey, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, np.float64)


def _straightened(
    grey: Singles, seed: Seed, middle: Floats, axis: Floats, run: Run
) -> tuple[Floats, Floats, float] | None:
    """Middle, axis and width of a strip by where its brightness falls sharply to either side; None where it does not in most places."""
    margin = 0.1 * (run.high - run.low)
    along = np.linspace(run.low + margin, run.high - margin, SLICES * PARTS).reshape(SLICES, PARTS)
    aside = np.arange(-seed.length - 8, seed.length + 8.01, STEP_PX)
    values = sampled(grey, middle, axis, along.ravel(), aside).reshape(SLICES, PARTS, -1).mean(axis=1)
    along = along.mean(axis=1)
    left, right = (_sides(values, aside, seed.level, side) for side in (-1, 1))
    both = np.isfinite(left) & np.isfinite(right)
    width = float(np.median((right - left)[both])) if both.sum() >= FEWEST else seed.width
    both &= np.abs(right - left - width) <= 0.3 * width + 1
    either = np.where(np.isfinite(left), left + width / 2, right - width / 2)
    centre = np.where(both, (left + right) / 2, either)
    known = both if both.sum() >= FEWEST else np.isfinite(centre)
    if known.sum() < SLICES / 3:
        return None
    slope, shift, off = _line(along[known], centre[known])
    if off > 0.15 * width + 0.7:
        return None
    normal = np.array([-axis[1], axis[0]])
    turned = axis + slope * normal
    return middle + shift * normal, turned / np.linalg.norm(turned), width


def _line(at: Floats, values: Floats) -> tuple[float, float, float]:
    """Slope and value at 0 of a line through values (n,), without those that are far from it, and the median distance to it."""
    slope, shift = 0.0, float(np.median(values))
    for _ in range(4):
        off = np.abs(values - slope * at - shift)
        near = off <= max(3 * float(np.median(off)), 0.3)
        if near.sum() < FEWEST:
            break
        slope, shift = np.polyfit(at[near], values[near], 1).tolist()
    return slope, shift, float(np.median(np.abs(values - slope * at - shift)))


def _sides(values: Floats, aside: Floats, level: float, side: int) -> Floats:
    """For each row of values (n, m) where it falls by half going to a side from the middle; nan where it does not fall sharply."""
    out = np.full(len(values), np.nan)
    centre = len(aside) // 2
    ordered, where = (values[:, centre:], aside[centre:]) if side > 0 else (values[:, centre::-1], aside[centre::-1])
    for row, line in enumerate(ordered):
        dark = np.flatnonzero(line < level - DROP)
        if len(dark) and dark[0] > 0:
            place, sharp = _fall(line, where, int(dark[0]))
            out[row] = place if sharp else np.nan
    return out


@dataclass(frozen=True, eq=False)
class Compact:
    """A compact lamp: its middle (2,) px, its sizes px along the view's axes, and whether something before it may hide a side."""

    middle: Floats
    sizes: tuple[float, float]
    covered: bool

    @property
    def sides(self) -> list[Floats]:
        """The middles (2,) px of its four sides."""
        halves = [size / 2 * axis for size, axis in zip(self.sizes, VIEW_AXES, strict=True)]
        return [self.middle + sign * half for half in halves for sign in (-1, 1)]


def compact_of(grey: Singles, seed: Seed) -> Compact | None:
    """A compact lamp by where its brightness falls sharply on all sides, along the view's axes; None where it does not, or not well
    within the picture."""
    if not _within_picture(grey, seed.middle, seed.length / 2 + BORDER_PX):
        return None
    middle, covered, sizes = seed.middle, False, [0.0, 0.0]
    for number, axis in enumerate(VIEW_AXES):
        across = VIEW_AXES[1 - number]
        aside = np.arange(-seed.length - 8, seed.length + 8.01, STEP_PX)
        along = np.linspace(-0.3 * seed.width, 0.3 * seed.width, SLICES)
        values = _sampled_at(grey, middle, axis, across, along, aside)
        left, right = (_sides(values, aside, seed.level, side) for side in (-1, 1))
        both = np.isfinite(left) & np.isfinite(right)
        if both.sum() < SLICES / 2 or float(np.median((right - left)[both])) < 0.6 * seed.width:
            return None
        low, high = (float(np.median(side[both])) for side in (left, right))
        sizes[1 - number] = high - low
        covered |= any(_is_covered(grey, middle, across, seed.width, at) for at in (low, high))
        middle = middle + (low + high) / 2 * across
    return None if max(sizes) > STRIP_RATIO * min(sizes) else Compact(middle, (sizes[0], sizes[1]), covered)


def more_like(grey: Singles, seed: Seed, lamp: Compact) -> list[Compact]:
    """Compact lamps of one size on lines with a lamp, along the view's axes."""
    found: list[Compact] = []
    for number, axis in enumerate(VIEW_AXES):
        places = _inside(grey, lamp.middle, axis)
        lit = _profile(grey, lamp.middle, axis, places, 0.3 * lamp.sizes[1 - number]) >= seed.level - DROP
        changes = np.flatnonzero(np.diff(np.concatenate([[False], lit, [False]]).astype(np.int8)))
        for first, last in zip(places[changes[::2]], places[changes[1::2] - 1], strict=True):
            if abs(last - first - lamp.sizes[number]) <= WIDER * lamp.sizes[number] and not first <= 0 <= last:
                like = replace(seed, middle=lamp.middle + (first + last) / 2 * axis)
                other = compact_of(grey, like)
                if other is not None and np.allclose(other.sizes, lamp.sizes, rtol=WIDER, atol=1.0):
                    found.append(other)
    return found


def _within_picture(grey: Singles, middle: Floats, margin: float) -> bool:
    size = np.array([grey.shape[1], grey.shape[0]]) - 1.0
    return bool((middle > margin).all() and (middle < size - margin).all())
