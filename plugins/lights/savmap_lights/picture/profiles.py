"""Brightness along lines through a picture, and where it falls from lit to dark."""

from math import ceil, floor, inf

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.plugin import Bools, Floats, Ints

Singles = NDArray[np.float32]

VIEW_AXES = (np.array([1.0, 0.0]), np.array([0.0, 1.0]))
STEP_PX = 0.5
DROP = 5.0
BEYOND_PX = 9.0
SHARP_PX, STEEP = 3.5, 0.6
BORDER_PX = 3.0
STEEP_STEPS, BEYOND_STEPS, NEARBY_STEPS = round(SHARP_PX / STEP_PX), round(BEYOND_PX / STEP_PX), 48
HALF = 0.6
STEEP_PART, VALLEY, STEP_SHARE = 0.4, 0.5, (0.25, 0.9)
"""A fall is in two steps where it is at least `STEEP_PART` as steep as anywhere on both sides of a place where it is at
most `VALLEY` as steep as on either, and where the first step is such a share of it."""


def places_within(grey: Singles, middle: Floats, axis: Floats) -> Floats:
    """Places along an axis, px from the middle, within the picture."""
    low, high = -inf, inf
    for at, way, size in zip(middle.tolist(), axis.tolist(), grey.shape[::-1], strict=True):
        if way:
            first, last = sorted((-at / way, (size - 1 - at) / way))
            low, high = max(low, first), min(high, last)
    return STEP_PX * np.arange(ceil(low / STEP_PX), floor(high / STEP_PX) + 1, dtype=np.float64)


def profile_of(grey: Singles, middle: Floats, axis: Floats, places: Floats, half: float) -> Floats:
    """Mean brightness (n,) at places along an axis, over a band of `half` px to either side."""
    steps = max(1, round(half))
    sideways = half / steps * np.arange(-steps, steps + 1, dtype=np.float64)
    profile: Floats = sampled_aslant(grey, middle, normal_to(axis), axis, sideways, places).mean(axis=0)
    return profile


def normal_to(axis: Floats) -> Floats:
    """The axis (2,) at right angles to one."""
    return np.array([-axis[1], axis[0]])


def sampled(grey: Singles, middle: Floats, axis: Floats, along: Floats, sideways: Floats) -> Floats:
    """Brightness (n, m) at places along and aside of an axis."""
    return sampled_aslant(grey, middle, axis, normal_to(axis), along, sideways)


def sampled_aslant(
    grey: Singles, middle: Floats, axis: Floats, normal: Floats, along: Floats, sideways: Floats
) -> Floats:
    """Brightness (n, m) at places along an axis and along another one, which need not be at right angles to it."""
    x, y = (np.add.outer(middle[k] + along * axis[k], sideways * normal[k]).astype(np.float32) for k in (0, 1))
    values = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, np.float64)


def median(values: Floats) -> float:
    """The median of a few values (n,), at a quarter of the cost of NumPy's."""
    ordered = np.sort(values)
    return float(ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2


def ends_of(profile: Floats, places: Floats, firsts: Ints, lasts: Ints) -> tuple[Floats, Bools]:
    """Where runs of lit places (r,) end that way and this way (2, r) along a profile, and whether sharply."""
    end = len(places) - 1
    dark = np.concatenate([end - firsts, lasts]) + 1
    at, sharp = falls(np.repeat([profile[::-1], profile], len(firsts), axis=0), np.minimum(dark, end))
    low, high = np.where(dark > end, end, at).reshape(2, -1)
    return np.stack([places[-1] - STEP_PX * low, places[0] + STEP_PX * high]), (sharp & (dark <= end)).reshape(2, -1)


def is_stepped(profile: Floats, dark: int) -> bool:
    """Whether a profile falls in two steps about its first dark place.

    A lamp whose side shines less, or whose housing is dark, looks so from the nearer side. Which step is its end is not
    known to a pixel, and a pixel there is 5 cm of height for a lamp 6 m above the camera.
    """
    gap, reach = round(1 / STEP_PX), round(BEYOND_PX / STEP_PX)
    line = profile[max(dark - reach, 0) : dark + reach]
    steepness = line[:-gap] - line[gap:]
    steep = np.flatnonzero(steepness >= STEEP_PART * steepness.max(initial=DROP))
    if not len(steep):
        return False
    first, last = int(steep[0]), int(steep[-1])
    valley = first + int(np.argmin(steepness[first : last + 1]))
    sides = (steepness[first : valley + 1].max(), steepness[valley : last + 1].max())
    share = (line[: valley + 1].max() - line[valley : valley + gap + 1].mean()) / max(float(np.ptp(line)), DROP)
    return bool(steepness[valley] <= VALLEY * min(sides) and STEP_SHARE[0] < share < STEP_SHARE[1])


def falls(profiles: Floats, dark: Ints) -> tuple[Floats, Bools]:
    """After how many steps profiles (n, m) fall steepest about their first dark places (n,), and whether they do so
    sharply: by most of what they fall nearby, and well within the picture."""
    begin, end = np.maximum(dark - 2 * STEEP_STEPS, 0), np.minimum(dark + BEYOND_STEPS, profiles.shape[1])
    row, column = np.arange(len(dark)), np.arange(2 * STEEP_STEPS + BEYOND_STEPS)
    at = begin[:, None] + column
    inside, at = at < end[:, None], np.minimum(at, end[:, None] - 1)
    lines = profiles[row[:, None], at]
    drops = np.where(inside[:, STEEP_STEPS:], lines[:, :-STEEP_STEPS] - lines[:, STEEP_STEPS:], -np.inf)
    k = np.argmax(drops, axis=1)
    drop = drops[row, k]
    highest, lowest = np.maximum.accumulate(lines, axis=1), np.minimum.accumulate(lines[:, ::-1], axis=1)
    nearby = highest[row, k] - lowest[row, -1 - k]
    level = lines[row, k + STEEP_STEPS] + HALF * np.maximum(drop, 0)
    under = (lines < level[:, None]) & (column > k[:, None])
    after = np.maximum(np.argmax(under, axis=1), 1)
    high, low, first = lines[row, after - 1], lines[row, after], at[row, after - 1]
    share = np.clip((high - level) / np.maximum(high - low, 1e-9), 0, 1)
    middles = first + share * (at[row, after] - first)
    sharp = under[row, after] & (drop >= np.maximum(DROP, STEEP * nearby))
    return middles, sharp & (STEP_PX * (profiles.shape[1] - 1 - middles) > BORDER_PX)


def sides(
    grey: Singles, middle: Floats, axes: tuple[Floats, Floats], along: Floats, reach: float, level: float
) -> tuple[Floats, Floats]:
    """For each row of places (n, p) along the first of two axes, how far to either side (n,), px along the second, the
    mean brightness at them falls sharply to dark; nan where it does not within reach. First it is looked for nearby."""
    most = ceil((2 * reach + 0.01) / STEP_PX) // 2
    centre = STEP_PX * most - reach
    lines, left = np.full((2, len(along), most + 1), np.inf), np.arange(len(along))
    for half in sorted({min(NEARBY_STEPS, most), most}):
        near, places = centre + STEP_PX * np.arange(-half, half + 1.0), along[left]
        values = sampled_aslant(grey, middle, *axes, places.ravel(), near).reshape(*places.shape, -1).mean(axis=1)
        lines[0, left, : half + 1], lines[1, left, : half + 1] = values[:, half::-1], values[:, half:]
        is_dark = lines < level - DROP
        dark = is_dark.argmax(axis=2)
        certain = is_dark.any(axis=2) & (dark + BEYOND_STEPS + BORDER_PX / STEP_PX < half)
        left = np.flatnonzero(~certain.all(axis=0))
        if not len(left):
            break
    at, sharp = falls(lines.reshape(-1, most + 1), dark.ravel())
    low, high = np.where(sharp & (dark.ravel() > 0), STEP_PX * at, np.nan).reshape(2, -1)
    return centre - low, centre + high
