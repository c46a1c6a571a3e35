"""Brightness along lines through a picture, and where it falls from lit to dark."""

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
HALF = 0.6
STEEP_PART, VALLEY, STEP_SHARE = 0.4, 0.5, (0.25, 0.9)
"""A fall is in two steps where it is at least `STEEP_PART` as steep as anywhere on both sides of a place where it is at most `VALLEY` as steep as on either,
and where the first step is such a share of it."""


def places_within(grey: Singles, middle: Floats, axis: Floats) -> Floats:
    """Places along an axis, px from the middle, within the picture."""
    size = np.array([grey.shape[1], grey.shape[0]]) - 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        limits = np.stack([-middle / axis, (size - middle) / axis])
    limits = np.where(np.isfinite(limits), limits, np.array([[-np.inf], [np.inf]]))
    low, high = limits.min(axis=0).max(), limits.max(axis=0).min()
    return np.arange(np.ceil(low / STEP_PX), np.floor(high / STEP_PX) + 1) * STEP_PX


def profile_of(grey: Singles, middle: Floats, axis: Floats, places: Floats, half: float) -> Floats:
    """Mean brightness (n,) at places along an axis, over a band of `half` px to either side."""
    aside = np.linspace(-half, half, max(3, 2 * round(half) + 1))
    profile: Floats = sampled(grey, middle, axis, places, aside).mean(axis=1)
    return profile


def sampled(grey: Singles, middle: Floats, axis: Floats, along: Floats, aside: Floats) -> Floats:
    """Brightness (n, m) at places along and aside of an axis."""
    return sampled_aslant(grey, middle, axis, np.array([-axis[1], axis[0]]), along, aside)


def sampled_aslant(grey: Singles, middle: Floats, axis: Floats, normal: Floats, along: Floats, aside: Floats) -> Floats:
    """Brightness (n, m) at places along an axis and along another one, which need not be at right angles to it."""
    pixels = (middle + along[:, None, None] * axis + aside[None, :, None] * normal).astype(np.float32)
    values = cv2.remap(grey, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, np.float64)


def fall(profile: Floats, places: Floats, dark: int) -> tuple[float, bool]:
    """Where a profile falls steepest about its first dark place, and whether it does so sharply, in one step."""
    middles, sharp = falls(profile[None], places, np.array([dark]))
    return float(middles[0]), bool(sharp[0]) and not is_stepped(profile, dark)


def is_stepped(profile: Floats, dark: int) -> bool:
    """Whether a profile falls in two steps about its first dark place.

    A lamp whose side shines less, or whose housing is dark, looks so from the nearer side. Which step is its end is not known to a pixel,
    and a pixel there is 5 cm of height for a lamp 6 m above the camera.
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


def falls(profiles: Floats, places: Floats, dark: Ints) -> tuple[Floats, Bools]:
    """Where profiles (n, m) fall steepest about their first dark places (n,), and whether they do so sharply: by most of what they fall
    nearby, and well within the picture."""
    steep, reach = round(SHARP_PX / STEP_PX), round(BEYOND_PX / STEP_PX)
    begin, end = np.maximum(dark - 2 * steep, 0), np.minimum(dark + reach, len(places))
    at = begin[:, None] + np.arange(2 * steep + reach)
    inside, at = at < end[:, None], np.minimum(at, end[:, None] - 1)
    lines = np.take_along_axis(profiles, at, axis=1)
    drops = np.where(inside[:, steep:], lines[:, :-steep] - lines[:, steep:], -np.inf)
    k = np.argmax(drops, axis=1)
    row, column = np.arange(len(lines)), np.arange(lines.shape[1])
    drop, before = drops[row, k], column <= k[:, None]
    nearby = np.where(before, lines, -np.inf).max(axis=1) - np.where(column >= k[:, None], lines, np.inf).min(axis=1)
    level = lines[row, k + steep] + HALF * np.maximum(drop, 0)
    under = (lines < level[:, None]) & ~before
    after = np.maximum(np.argmax(under, axis=1), 1)
    high, low = lines[row, after - 1], lines[row, after]
    share = np.clip((high - level) / np.maximum(high - low, 1e-9), 0, 1)
    start, stop = places[at[row, after - 1]], places[at[row, after]]
    middles = start + share * (stop - start)
    sharp = under.any(axis=1) & (drop >= np.maximum(DROP, STEEP * nearby))
    return middles, sharp & (np.abs(middles - places[-1]) > BORDER_PX)


def falls_aside(values: Floats, aside: Floats, level: float, side: int) -> Floats:
    """For each row of values (n, m) where it falls by half going to a side from the middle; nan where it does not fall sharply."""
    centre = len(aside) // 2
    lines, where = (values[:, centre:], aside[centre:]) if side > 0 else (values[:, centre::-1], aside[centre::-1])
    is_dark = lines < level - DROP
    dark = np.argmax(is_dark, axis=1)
    places, sharp = falls(lines, where, dark)
    return np.where(sharp & (dark > 0), places, np.nan)
