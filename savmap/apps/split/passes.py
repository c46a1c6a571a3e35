"""From motions to passes: straights with structure alongside, their beginnings and ends, sides and directions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.apps.split.records import SIDES, DetectedPass, SplitResult, SplitSettings
from savmap.apps.split.straights import Nearness, Straight, headings, nearness, straights
from savmap.types import Bools, Floats, array_record
from savmap.video.motion import Motion, wrapped

_SQUARE_DEG = 30.0
_LONG = 2.0
_LEAST_GAIN_S = 1.0
_REACH_DEG, _MOST_REACH_S = 8.0, 0.5


@dataclass(frozen=True, eq=False)
@array_record
class _Candidate:
    """A stretch of a straight with something near alongside: its times, rates and texture (2,) abeam, the share of
    samples that are near, and how long the camera stood."""

    straight: Straight
    start_s: float
    end_s: float
    rates: Floats
    texture: Floats
    near_share: float
    stood_s: float


def find_passes(motions: Sequence[Motion], settings: SplitSettings, cuts_s: Sequence[float] = ()) -> SplitResult:
    """The passes of a recording from the motions of its frame pairs, in order, and the times at which it was cut, s."""
    rig = headings(motions)
    lines = straights(motions, rig, settings, cuts_s)
    candidates = [candidate for line in lines for candidate in _along(motions, rig, line, settings)]
    squared = _squared([candidate.straight.travel for candidate in candidates])
    kept = _plausible(candidates, squared, settings)
    passes = tuple(_record(candidates[index], squared[index] - squared[kept[0]], settings) for index in kept)
    stamps = np.array([motion.stamp_s for motion in motions])
    way = lines[0].way if lines else 0.0
    travel: Floats = rig + way - (lines[0].travel if lines else 0.0)
    return SplitResult(passes, stamps, travel)


def _along(motions: Sequence[Motion], rig: Floats, line: Straight, settings: SplitSettings) -> list[_Candidate]:
    """The stretches of a straight with something near alongside."""
    near = nearness(motions, rig, line)
    if near.still.all():
        return []
    stamps = np.array([motion.stamp_s for motion in motions[line.first : line.last + 1]])
    level = _level(near, settings)
    gains = np.where(near.still, 0.0, (level - settings.near) * _spans(stamps))
    groups = _joined(_best(gains, 0, len(gains), settings.near), stamps, settings.gap_s)
    return [_candidate(line, near, level, stamps, group, settings.near) for group in groups]


def _level(near: Nearness, settings: SplitSettings) -> Floats:
    """How near the nearer side is abeam (n,), as a share of the nearest around, or of what is usual along the way where
    everything is far; while the camera stands, as before it stood (or, at the beginning, after)."""
    moving = ~near.still
    usual = np.percentile(near.rates[moving], 80, axis=0)
    counted = _structured(usual, _texture(near, usual), settings)
    tops = near.tops[:, counted].max(axis=1)
    least = settings.open_share * np.percentile(tops[moving], 80)
    shares = near.rates[:, counted].max(axis=1) / np.maximum(tops, least)
    measured = np.flatnonzero(moving)
    before = measured[(np.searchsorted(measured, np.arange(len(shares)), side="right") - 1).clip(0)]
    level: Floats = np.clip(shares, 0, 1)[before]
    return level


def _texture(near: Nearness, usual: Floats) -> Floats:
    """The texture (2,) of each side where something there passes at half of its `usual` rate (2,) or more."""
    close = (near.rates >= usual / 2) & ~near.still[:, None]
    return np.array(
        [float(np.median(near.texture[close[:, hand], hand])) if close[:, hand].any() else 0.0 for hand in (0, 1)]
    )


def _structured(rates: Floats, texture: Floats, settings: SplitSettings) -> Bools:
    """Which sides (2,) have structure, by the rates and texture abeam."""
    near = rates >= settings.side_rate * rates.max()
    rich: Bools = near & (texture >= settings.texture * texture[near].max())
    return rich


def _spans(stamps: Floats) -> Floats:
    """The time (n,) that each sample stands for, s."""
    return np.gradient(stamps) if len(stamps) > 1 else np.ones(1)


def _best(gains: Floats, first: int, end: int, near: float) -> list[tuple[int, int]]:
    """Runs of samples in first..end with the largest sum of gains, then those before and after it, in order: dips
    within a run are passed over where what follows makes up for them (maximum subarray: Bentley 1984)."""
    if first >= end:
        return []
    sums = np.concatenate([[0.0], np.cumsum(gains[first:end])])
    lowest = np.minimum.accumulate(sums)
    last = int(np.argmax(sums - lowest))
    if sums[last] - lowest[last] < _LEAST_GAIN_S * (1 - near):
        return []
    start = int(np.flatnonzero(sums[:last] <= lowest[last])[-1])
    before = _best(gains, first, first + start, near)
    after = _best(gains, first + last, end, near)
    return [*before, (first + start, first + last - 1), *after]


def _joined(groups: Sequence[tuple[int, int]], stamps: Floats, gap_s: float) -> list[tuple[int, int]]:
    """Runs of samples joined over gaps that are no longer than `gap_s`."""
    joined: list[tuple[int, int]] = []
    for first, last in groups:
        if joined and stamps[first] - stamps[joined[-1][1]] <= gap_s:
            joined[-1] = joined[-1][0], last
        else:
            joined.append((first, last))
    return joined


def _candidate(
    line: Straight, near: Nearness, level: Floats, stamps: Floats, group: tuple[int, int], least: float
) -> _Candidate:
    part = slice(group[0], group[1] + 1)
    moving = ~near.still[part]
    start = _border(near, stamps, group[0], group[0] - 1)
    end = _border(near, stamps, group[1], group[1] + 1)
    rates = np.median(near.rates[part][moving], axis=0)
    texture = np.median(near.texture[part], axis=0)
    stood = float(_spans(stamps)[part][~moving].sum())
    return _Candidate(line, start, end, rates, texture, float((level[part] >= least).mean()), stood)


def _border(near: Nearness, stamps: Floats, inside: int, outside: int) -> float:
    """The time when an end is abeam: half way between a sample inside and its neighbour outside, and further inside by
    the angle by which apparent motion of what is near reaches over what is behind. The sample's time at the ends of a
    straight."""
    if not 0 <= outside < len(stamps):
        return float(stamps[inside])
    rate = max(near.rates[inside].max(), _REACH_DEG / _MOST_REACH_S)
    inwards = np.sign(inside - outside) * _REACH_DEG / rate
    return float((stamps[inside] + stamps[outside]) / 2 + inwards)


def _squared(travels: Sequence[float]) -> list[float]:
    """Directions of travel with changes rounded to quarter turns where they are nearly that, because sums of turns
    drift."""
    squared: list[float] = []
    for index, travel in enumerate(travels):
        change = travel - travels[index - 1] if index else 0.0
        whole = 90.0 * round(change / 90)
        squared.append((squared[-1] if index else 0.0) + (whole if abs(change - whole) < _SQUARE_DEG else change))
    return squared


def _plausible(candidates: Sequence[_Candidate], travels: Sequence[float], settings: SplitSettings) -> list[int]:
    """The candidates that are long enough, along the recording's main direction, and near enough."""
    lasting = [index for index, candidate in enumerate(candidates) if _moving_s(candidate) >= settings.least_s]
    if not lasting:
        return []
    weights = np.array([_moving_s(candidates[index]) * candidates[index].rates.max() for index in lasting])
    doubled = np.radians(2 * np.array([travels[index] for index in lasting]))
    axis = float(np.degrees(np.angle((weights * np.exp(1j * doubled)).sum()))) / 2
    usual = float(np.median([candidates[index].rates.max() for index in lasting]))
    return [
        index
        for index in lasting
        if abs(wrapped(np.array(2 * (travels[index] - axis)))) < 2 * settings.axis_deg
        and candidates[index].rates.max() >= settings.open_share * usual
    ]


def _moving_s(candidate: _Candidate) -> float:
    return candidate.end_s - candidate.start_s - candidate.stood_s


def _record(candidate: _Candidate, heading: float, settings: SplitSettings) -> DetectedPass:
    structured = _structured(candidate.rates, candidate.texture, settings)
    sides = tuple(side for side, counted in zip(SIDES, structured, strict=True) if counted)
    long = min(1.0, _moving_s(candidate) / (_LONG * settings.least_s))
    confidence = candidate.near_share * (0.5 + 0.5 * long)
    turned = float(wrapped(np.array(heading)))
    return DetectedPass(
        round(candidate.start_s, 2),
        round(candidate.end_s, 2),
        round(abs(turned) if abs(turned) > 179.95 else turned + 0.0, 1),
        round(candidate.straight.way, 1),
        sides,
        round(float(confidence), 2),
        round(candidate.stood_s, 1),
    )
