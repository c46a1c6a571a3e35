"""Compact lamps in a ceiling-facing view: all four sides by where the picture's brightness falls."""

from dataclasses import dataclass, replace

import numpy as np

from savmap.plugin import Detection, Floats
from savmap_lights.picture.bars import without_bar
from savmap_lights.picture.hidden import is_covered
from savmap_lights.picture.profiles import (
    BORDER_PX,
    DROP,
    VIEW_AXES,
    Singles,
    median,
    places_within,
    profile_of,
    sides,
)
from savmap_lights.picture.seeds import STRIP_RATIO, Seed, brightness_of

SLICES = 24
WIDER = 0.3
BESIDE_PX, AROUND_PX, DARKER = 4, 10, 40.0


@dataclass(frozen=True, eq=False)
class Compact:
    """A compact lamp: its middle (2,) px, its sizes px along the view's axes, and whether something before it may hide
    a side."""

    middle: Floats
    sizes: tuple[float, float]
    covered: bool

    @property
    def sides(self) -> list[Floats]:
        """The middles (2,) px of its four sides."""
        halves = [size / 2 * axis for size, axis in zip(self.sizes, VIEW_AXES, strict=True)]
        return [self.middle + sign * half for half in halves for sign in (-1, 1)]


def compacts_of(grey: Singles, seed: Seed, joined: bool = False) -> list[Compact]:
    """The compact lamp of a seed, or those of its parts where something bright that runs along the lamps joins them in
    one mask; a part that something hides may be one of a strip. `joined`: whether something joins lamps anywhere in the
    picture."""
    whole = compact_of(grey, seed, joined)
    if whole is not None:
        return [whole]
    lamps = [compact_of(grey, part, joined=True) for part in seed.parts]
    return [lamp for lamp in lamps if lamp is not None and not lamp.covered]


def compact_of(grey: Singles, seed: Seed, joined: bool = False) -> Compact | None:
    """A compact lamp by where its brightness falls sharply on all sides, along the view's axes; without what shines
    beside it and goes on to both sides, where something joins it with others. None where it does not, or not well
    within the picture."""
    if not _within_picture(grey, seed.middle, seed.length / 2 + BORDER_PX):
        return None
    middle, sizes, lamps = seed.middle, [0.0, 0.0], []
    for number, axis in enumerate(VIEW_AXES):
        across = VIEW_AXES[1 - number]
        along = np.linspace(-0.3 * seed.width, 0.3 * seed.width, SLICES)[:, None]
        left, right = sides(grey, middle, (axis, across), along, seed.length + 8, seed.level)
        both = np.isfinite(left) & np.isfinite(right)
        if np.count_nonzero(both) < SLICES / 2 or median((right - left)[both]) < 0.6 * seed.width:
            return None
        low, high = median(left[both]), median(right[both])
        sizes[1 - number] = high - low
        lamps.append((middle, across, low, high))
        middle = middle + (low + high) / 2 * across
    if max(sizes) > STRIP_RATIO * min(sizes):
        return None
    hidden = [
        tuple(is_covered(grey, about, across, seed.width, *end) for end in ((low, -1), (high, 1)))
        for about, across, low, high in reversed(lamps)
    ]
    for number, axis in enumerate(VIEW_AXES if joined else ()):
        low, high = without_bar(grey, middle, axis, sizes[number], sizes[1 - number], seed.level)
        first, last = hidden[number]
        hidden[number] = first and low <= -sizes[number] / 2, last and high >= sizes[number] / 2
        middle, sizes[number] = middle + (low + high) / 2 * axis, high - low
    return (
        None if max(sizes) > STRIP_RATIO * min(sizes) else Compact(middle, (sizes[0], sizes[1]), bool(np.any(hidden)))
    )


def more_like(grey: Singles, seed: Seed, lamp: Compact) -> list[Compact]:
    """Compact lamps of one size on lines with a lamp, along the view's axes."""
    lamps: list[Compact] = []
    for number, axis in enumerate(VIEW_AXES):
        places = places_within(grey, lamp.middle, axis)
        lit = profile_of(grey, lamp.middle, axis, places, 0.3 * lamp.sizes[1 - number]) >= seed.level - DROP
        changes = np.flatnonzero(np.diff(np.concatenate([[False], lit, [False]]).astype(np.int8)))
        for first, last in zip(places[changes[::2]], places[changes[1::2] - 1], strict=True):
            if abs(last - first - lamp.sizes[number]) <= WIDER * lamp.sizes[number] and not first <= 0 <= last:
                like = replace(seed, middle=lamp.middle + (first + last) / 2 * axis)
                other = compact_of(grey, like)
                if other is not None and np.allclose(other.sizes, lamp.sizes, rtol=WIDER, atol=1.0):
                    lamps.append(other)
    return lamps


def stands_out(grey: Singles, detection: Detection) -> bool:
    """Whether it is darker than a lamp's brightness on all four sides of its mask, most of what is 5 to 10 px away."""
    level = brightness_of(grey, detection)
    rows, columns = detection.place
    top, bottom, left, right = rows.start, rows.stop, columns.start, columns.stop
    sides = [
        grey[max(top - AROUND_PX, 0) : max(top - BESIDE_PX, 0), left:right],
        grey[bottom + BESIDE_PX : bottom + AROUND_PX, left:right],
        grey[top:bottom, max(left - AROUND_PX, 0) : max(left - BESIDE_PX, 0)],
        grey[top:bottom, right + BESIDE_PX : right + AROUND_PX],
    ]
    return all(side.size and float(np.median(side)) < level - DARKER for side in sides)


def _within_picture(grey: Singles, middle: Floats, margin: float) -> bool:
    size = np.array([grey.shape[1], grey.shape[0]]) - 1.0
    return bool((middle > margin).all() and (middle < size - margin).all())
