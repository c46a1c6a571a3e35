"""Lamps in a ceiling-facing view: mask and brightness to centre (compact lamps) or to ends (strips). Paper, section III.C."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from savmap.plugin import Detection, Feature, Floats, View, point_feature, touches_border
from savmap_lights.picture.compact import Compact, compact_of, more_like
from savmap_lights.picture.profiles import Singles
from savmap_lights.picture.seeds import Seed, seeds_of
from savmap_lights.picture.strips import Body, strips

FIRST_LIKE = 20_000
SIGMA_END_PX = 0.5
SIGMA_CENTRE_PX = 0.5
BY_MASK_PX = 1.2
SEEN = 255.0


def extract_features(view: View, detections: Sequence[Detection]) -> list[Feature]:
    """For each compact lamp a "centre", or, where something may hide a side of it, a "glimpse", and the middle of each "side".

    For each strip, up to its joints where it is part of a line of light: an "end a" and an "end b" where it ends sharply and within the
    view, a "centre" where both do, a "glimpse" where something that runs across hides an end, and a "middle" of what is seen of it,
    uncertain along it by half its length. Ends come in no particular order.

    What the picture's brightness does not show is measured in the masks.
    """
    grey = np.asarray(cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY), np.float32)
    seeds = seeds_of(grey, detections)
    compact = {seed.number: lamp for seed in seeds if (lamp := compact_of(grey, seed)) is not None}
    others = [seed for seed in seeds if seed.number not in compact]
    lit = strips(grey, others)
    features = _compact(view, detections, grey, seeds, compact)
    features += [feature for body in lit for feature in _strip(view, detections, body, SIGMA_END_PX)]
    return features + _by_mask(view, detections, _rest(others, lit))


def _compact(
    view: View, detections: Sequence[Detection], grey: Singles, seeds: Sequence[Seed], lamps: Mapping[int, Compact]
) -> list[Feature]:
    """Features of compact lamps, those too that the network did not see but that are as one that it did; a "glimpse" of one of which
    something may hide a side."""
    features: list[Feature] = []
    known: list[Floats] = []
    for seed in seeds:
        for lamp in [lamps[seed.number], *more_like(grey, seed, lamps[seed.number])] if seed.number in lamps else []:
            if all(np.abs(lamp.middle - other).max() > min(lamp.sizes) / 2 for other in known):
                known.append(lamp.middle)
                part = "glimpse" if lamp.covered else "centre"
                instance = FIRST_LIKE + len(known)
                detection = detections[seed.number]
                points = [(part, lamp.middle), *(("side", side) for side in lamp.sides)]
                features += [point_feature(view, detection, instance, *point, SIGMA_CENTRE_PX) for point in points]
    return features


def _rest(seeds: Sequence[Seed], bodies: Sequence[Body]) -> list[Seed]:
    taken = {number for body in bodies for number in body.numbers}
    return [seed for seed in seeds if seed.number not in taken]


def _by_mask(view: View, detections: Sequence[Detection], seeds: Sequence[Seed]) -> list[Feature]:
    """Features of lamps that do not stand out in the picture, from the network's probability."""
    if not seeds:
        return []
    own = {seed.number for seed in seeds}
    shared = {id(detections[number].probability): detections[number].probability for number in own}
    seen: Singles = np.asarray(SEEN * np.maximum.reduce(list(shared.values())), np.float32)
    again = [seed for seed in seeds_of(seen, detections) if seed.number in own]
    bodies = strips(seen, again)
    features = [feature for body in bodies for feature in _strip(view, detections, body, BY_MASK_PX)]
    whole = [seed for seed in _rest(again, bodies) if not touches_border(detections[seed.number].mask)]
    for seed in whole:
        features.append(point_feature(view, detections[seed.number], seed.number, "centre", seed.middle, BY_MASK_PX))
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
