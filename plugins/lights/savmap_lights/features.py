"""Lamps in a ceiling-facing view: mask and brightness to centre (compact lamps) or to ends (strips). Paper, section
III.C."""

from collections.abc import Iterable, Sequence, Set
from dataclasses import replace

import cv2
import numpy as np

from savmap.plugin import Detection, Feature, Floats, View, point_feature, touches_border
from savmap_lights.picture.compact import Compact, compacts_of, more_like, stands_out
from savmap_lights.picture.profiles import Singles
from savmap_lights.picture.seeds import seeds_of
from savmap_lights.picture.strips import FIRST_STRIP, Body, strips

FIRST_LIKE = 20_000
OUTLINED, MASKED = 55_000, 60_000
SIGMA_END_PX = 0.5
SIGMA_CENTRE_PX = 0.5
BY_MASK_PX = 1.2
SEEN = 255.0


def extract_features(view: View, detections: Sequence[Detection]) -> list[Feature]:
    """For each compact lamp a "centre", or, where something may hide a side of it, a "glimpse", and the middle of each
    "side".

    For each strip, up to its joints where it is part of a line of light: an "end a" and an "end b" where it ends
    sharply and within the view, a "centre" where both do, a "glimpse" where something that runs across hides an end,
    and a "middle" of what is seen of it, uncertain along it by half its length. Ends come in no particular order.

    What the picture's brightness does not show is measured in the masks.
    """
    grey = np.asarray(cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY), np.float32)
    seeds = seeds_of(grey, detections)
    joined = any(len(seed.parts) > 1 for seed in seeds)
    compact = [(seed, lamp) for seed in seeds for lamp in compacts_of(grey, seed, joined)]
    numbers = {seed.number for seed, _ in compact}
    lit = strips(grey, [seed for seed in seeds if seed.number not in numbers])
    lamps = _distinct((seed.number, other) for seed, lamp in compact for other in (lamp, *more_like(grey, seed, lamp)))
    features = _compact(view, detections, lamps)
    features += [feature for body in lit for feature in _strip(view, detections, body, SIGMA_END_PX)]
    measured = numbers | {number for body in lit for number in body.numbers}
    return features + _by_mask(view, grey, detections, set(range(len(detections))) - measured)


def is_by_mask(feature: Feature) -> bool:
    """Whether a feature was measured in a mask alone, and the brightness does not fall on all sides of it."""
    return not FIRST_STRIP <= feature.instance < MASKED


def _distinct(lamps: Iterable[tuple[int, Compact]]) -> list[tuple[int, Compact]]:
    """Compact lamps, each once, with the number of a detection."""
    kept: list[tuple[int, Compact]] = []
    for number, lamp in lamps:
        if all(np.abs(lamp.middle - other.middle).max() > min(lamp.sizes) / 2 for _, other in kept):
            kept.append((number, lamp))
    return kept


def _compact(view: View, detections: Sequence[Detection], lamps: Sequence[tuple[int, Compact]]) -> list[Feature]:
    """Features of compact lamps; a "glimpse" of one of which something may hide a side."""
    features: list[Feature] = []
    for instance, (number, lamp) in enumerate(lamps, FIRST_LIKE + 1):
        part = "glimpse" if lamp.covered else "centre"
        points = [(part, lamp.middle), *(("side", side) for side in lamp.sides)]
        features += [point_feature(view, detections[number], instance, *point, SIGMA_CENTRE_PX) for point in points]
    return features


def _by_mask(view: View, grey: Singles, detections: Sequence[Detection], numbers: Set[int]) -> list[Feature]:
    """Features of lamps whose ends the picture does not show, from the network's probability; compact ones with an
    instance from `OUTLINED` where they stand out all the same, as in a lit case."""
    if not numbers:
        return []
    shared = {id(detections[number].probability): detections[number].probability for number in numbers}
    seen: Singles = np.asarray(SEEN * np.maximum.reduce(list(shared.values())), np.float32)
    again = seeds_of(seen, detections, numbers)
    bodies = [replace(body, instance=MASKED + body.instance) for body in strips(seen, again)]
    features = [feature for body in bodies for feature in _strip(view, detections, body, BY_MASK_PX)]
    taken = {number for body in bodies for number in body.numbers}
    for seed in again:
        detection = detections[seed.number]
        if seed.number not in taken and not touches_border(detection.mask):
            instance = seed.number + OUTLINED * stands_out(grey, detection)
            features.append(point_feature(view, detection, instance, "centre", seed.middle, BY_MASK_PX))
    return features


def _strip(view: View, detections: Sequence[Detection], body: Body, sigma_px: float) -> list[Feature]:
    """Features of one strip; its instance is unique in the view, beside those of compact lamps."""
    detection = detections[body.numbers[0]]
    instance = body.instance
    points = [
        point_feature(view, detection, instance, f"end {name}", end, sigma_px)
        for name, end in zip("ab", body.ends, strict=True)
        if end is not None
    ]
    if body.ends[0] is not None and body.ends[1] is not None:
        points.append(point_feature(view, detection, instance, "centre", (body.ends[0] + body.ends[1]) / 2, sigma_px))
    points += [point_feature(view, detection, instance, "glimpse", place, sigma_px) for place in body.covered]
    return [*points, _middle(view, detection, instance, body, sigma_px)]


def _middle(view: View, detection: Detection, instance: int, body: Body, sigma_px: float) -> Feature:
    """What is seen of a strip: its middle, with half its length as the standard deviation along it."""
    across: Floats = np.array([-body.axis[1], body.axis[0]])
    half = np.linalg.norm(body.reach[1] - body.reach[0]) / 2
    covariance = half**2 * np.outer(body.axis, body.axis) + sigma_px**2 * np.outer(across, across)
    pixel = body.reach.mean(axis=0)[None]
    return Feature(
        view.frame, view.spec.name, detection.label, "middle", instance, pixel, covariance[None], score=detection.score
    )
