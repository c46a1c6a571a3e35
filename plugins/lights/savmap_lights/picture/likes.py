"""Lamps like one that is known, on a line with it, in the last levels of an overexposed picture: brighter than all that
is about them."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from savmap.plugin import Bools, Floats
from savmap_lights.picture.compact import Compact
from savmap_lights.picture.profiles import VIEW_AXES, Singles, sampled
from savmap_lights.picture.strips import Body, length_of, overlap

LEAST, END = 6.0, 3.0
GAP_PX, FLANK_PX, ASIDE_PX, REFINE_PX = 3, 3, 6, 3
FIRST_FAINT = 15_000
SLIVER = 0.5


def with_likes(last: Singles, lit: Sequence[Body], compact: Sequence[Compact]) -> list[Body]:
    """Strips, with those that look like one of them that shows both ends, and is no sliver beside the view's largest
    lamp."""
    whole = [body for body in lit if body.ends[0] is not None and body.ends[1] is not None]
    areas = [length_of(body) * body.width for body in whole] + [float(np.prod(lamp.sizes)) for lamp in compact]
    bodies = list(lit)
    for strip, area in zip(whole, areas, strict=False):
        if area < SLIVER * max(areas):
            continue
        for ends in ends_alike(last, strip.reach.mean(axis=0), strip.axis, length_of(strip), strip.width):
            body = replace(strip, instance=FIRST_FAINT + len(bodies), ends=(ends[0], ends[1]), covered=(), reach=ends)
            if not any(overlap(body, other) for other in bodies):
                bodies.append(body)
    return bodies


def compact_likes(last: Singles, lamp: Compact) -> list[Compact]:
    """Compact lamps that look like one, on lines with it along the view's axes."""
    alike = []
    for number, axis in enumerate(VIEW_AXES):
        for ends in ends_alike(last, lamp.middle, axis, lamp.sizes[number], lamp.sizes[1 - number]):
            alike.append(replace(lamp, middle=ends.mean(axis=0), covered=False))
    return alike


def ends_alike(last: Singles, middle: Floats, axis: Floats, length: float, width: float) -> list[Floats]:
    """Both ends (2, 2) px of what looks like a lamp of this length and width, px, on a line with it: brighter than what
    is beyond its ends and beside it, by the last levels of the picture."""
    reach = float(np.hypot(*last.shape))
    along = np.arange(-np.ceil(reach), np.ceil(reach) + 1)
    inside = _is_inside(last, middle + along[:, None] * axis, length / 2 + GAP_PX)
    along = along[inside]
    half = ASIDE_PX + width / 2 + FLANK_PX + 2
    sideways = np.arange(-np.ceil(half), np.ceil(half) + 1)
    if len(along) <= length + 4 * GAP_PX:
        return []
    values = sampled(last, middle, axis, along, sideways).astype(np.float32)
    stands_out = _stands_out(values, length, width)
    stands_out[:, np.abs(sideways) > ASIDE_PX] = -np.inf
    alike: list[Floats] = []
    while stands_out.max() > LEAST:
        at, nearby = np.unravel_index(int(np.argmax(stands_out)), stands_out.shape)
        stands_out[np.abs(along - along[at]) < 0.7 * length] = -np.inf
        ends = _ends(values[:, _core(int(nearby), width)].mean(axis=1), along, float(along[at]), length)
        if ends is not None:
            normal = np.array([-axis[1], axis[0]])
            alike.append(middle + np.array(ends)[:, None] * axis + sideways[nearby] * normal)
    return alike


def _is_inside(last: Singles, pixels: Floats, margin: float) -> Bools:
    size = np.array([last.shape[1], last.shape[0]]) - 1.0
    return np.asarray(((pixels > margin) & (pixels < size - margin)).all(axis=1))


def _core(nearby: int, width: float) -> slice:
    half = round(0.3 * width)
    return slice(max(nearby - half, 0), nearby + half + 1)


def _stands_out(values: Singles, length: float, width: float) -> Singles:
    """By how much a lamp at each place along and aside (n, m) would be brighter than the brightest of what is around
    it."""
    long, wide = 2 * round(length / 2 - 1) + 1, 2 * round(0.3 * width) + 1
    core = _mean(values, long, wide)
    ends, flanks = _mean(values, GAP_PX, wide), _mean(values, long, FLANK_PX)
    beyond, nearby = round(length / 2 + GAP_PX / 2 + 1), round(width / 2 + FLANK_PX / 2 + 1)
    around = [np.roll(ends, step, axis=0) for step in (-beyond, beyond)]
    around += [np.roll(flanks, step, axis=1) for step in (-nearby, nearby)]
    stands_out = core - np.max(around, axis=0)
    margin = beyond + GAP_PX
    stands_out[:margin] = stands_out[-margin:] = -np.inf
    return np.asarray(stands_out, np.float32)


def _mean(values: Singles, along: int, sideways: int) -> Singles:
    return np.asarray(cv2.blur(values, (max(sideways, 1), max(along, 1))), np.float32)


def _ends(core: Floats, along: Floats, middle: float, length: float) -> tuple[float, float] | None:
    """Where brightness (n,) changes most near the two ends of a lamp; None where it does not enough."""
    sums = np.concatenate([[0.0], np.cumsum(core)])
    cuts = np.arange(GAP_PX, len(core) - GAP_PX + 1)
    steps = (2 * sums[cuts] - sums[cuts - GAP_PX] - sums[cuts + GAP_PX]) / GAP_PX
    places = along[cuts] - 0.5
    alike = []
    for side in (-1, 1):
        near = np.flatnonzero(np.abs(places - (middle + side * length / 2)) <= REFINE_PX)
        if not len(near):
            return None
        k = int(near[np.argmax(side * steps[near])])
        if side * steps[k] < END:
            return None
        alike.append(float(places[k]) + _vertex(side * steps, k))
    return alike[0], alike[1]


def _vertex(values: Floats, k: int) -> float:
    """How far from its largest value the top of a parabola through it and its neighbours lies."""
    if not 0 < k < len(values) - 1:
        return 0.0
    before, top, after = values[k - 1 : k + 2].tolist()
    bend = before - 2 * top + after
    return float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < 0 else 0.0
