"""Lamps in a ceiling-facing view: mask and brightness to centre (compact lamps) or to ends (strips). Paper, section
III.C."""

from collections.abc import Iterable, Sequence, Set
from dataclasses import replace

import cv2
import numpy as np

from savmap.plugin import Detection, Feature, Floats, View, point_feature, touches_border
from savmap_lights.picture.compact import Compact, compacts_of, more_like, stands_out
from savmap_lights.picture.glare import Glare, beside_compact, beside_strip, compact_again, glare_of, strip_again
from savmap_lights.picture.likes import FIRST_FAINT, compact_likes, with_likes
from savmap_lights.picture.profiles import Singles
from savmap_lights.picture.seeds import Seed, seeds_of
from savmap_lights.picture.strips import FIRST_STRIP, VARYING, Body, strips, without_hidden_ends

FIRST_LIKE = 20_000
GLARING, OUTLINED, MASKED = 30_000, 55_000, 60_000
SIGMA_END_PX = 0.5
SIGMA_CENTRE_PX = 0.5
FAINT_PX = 1.5
BY_MASK_PX = 1.2
SEEN = 255.0
EVEN = (0.0,)


def extract_features(view: View, detections: Sequence[Detection]) -> list[Feature]:
    """For each compact lamp a "centre", or, where something may hide a side of it, a "glimpse", and the middle of each
    "side".

    For each strip, up to its joints where it is part of a line of light: an "end a" and an "end b" where it ends
    sharply and within the view, a "centre" where both do, a "glimpse" where something that runs across hides an end,
    and a "middle" of what is seen of it, uncertain along it by half its length. Ends come in no particular order.

    On an overexposed ceiling lamps are looked for in the last levels below white first. What the picture's brightness
    does not show is measured in the masks.
    """
    grey = np.asarray(cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY), np.float32)
    glare = glare_of(view.image, grey, detections)
    features: list[Feature] = []
    left = set(range(len(detections)))
    if glare is not None:
        left, features = _glaring(view, detections, glare, grey)
    compact, lit = _lamps_and_strips(grey, seeds_of(grey, detections, left))
    lamps = _distinct(
        (n, other, SIGMA_CENTRE_PX) for n, lamp, seed in compact for other in (lamp, *more_like(grey, seed, lamp))
    )
    features += _compact(view, detections, lamps, 0)
    features += [feature for body in lit for feature in _strip(view, detections, body, SIGMA_END_PX)]
    return features + _by_mask(view, grey, detections, left - _numbers(compact, lit))


def is_by_mask(feature: Feature) -> bool:
    """Whether a feature was measured in a mask alone, and the brightness does not fall on all sides of it."""
    return not FIRST_STRIP <= feature.instance < MASKED


Known = tuple[int, Compact, Seed]
Sure = tuple[int, Compact, float]


def _lamps_and_strips(
    shine: Singles, seeds: Sequence[Seed], varying: Sequence[float] = VARYING
) -> tuple[list[Known], list[Body]]:
    """The compact lamps, with the numbers of their detections, and the strips that stand out in a picture of what
    shines."""
    joined = any(len(seed.parts) > 1 for seed in seeds)
    compact = [(seed.number, lamp, seed) for seed in seeds for lamp in compacts_of(shine, seed, joined)]
    compact_numbers = {number for number, _, _ in compact}
    return compact, strips(shine, [seed for seed in seeds if seed.number not in compact_numbers], varying)


def _numbers(compact: Sequence[Known], lit: Sequence[Body]) -> set[int]:
    return {number for number, _, _ in compact} | {number for body in lit for number in body.numbers}


def _glaring(
    view: View, detections: Sequence[Detection], glare: Glare, grey: Singles
) -> tuple[set[int], list[Feature]]:
    """In an overexposed picture: the detections that are left, and the features of lamps, and of their likes, beside
    which it glares."""
    compact, lit = _lamps_and_strips(glare.outlines, seeds_of(glare.outlines, detections), EVEN)
    bodies = with_likes(glare.last, lit, [lamp for _, lamp, _ in compact])
    bodies = [body for body in bodies if body.instance < FIRST_FAINT or beside_strip(glare.last, body)]
    sure = [(n, compact_again(glare.darkest, lamp), SIGMA_CENTRE_PX) for n, lamp, _ in compact]
    alike = ((n, other) for n, lamp, _ in sure for other in compact_likes(glare.last, lamp))
    faint = ((n, compact_again(glare.darkest, other), FAINT_PX) for n, other in alike)
    lamps = _distinct(lamp for lamp in (*sure, *faint) if beside_compact(glare.last, lamp[1]))
    features = _compact(view, detections, lamps, GLARING)
    for body in bodies:
        sigma = SIGMA_END_PX if body.instance < FIRST_FAINT else FAINT_PX
        again = without_hidden_ends(grey, strip_again(glare.darkest, body))
        features += _strip(view, detections, replace(again, instance=GLARING + body.instance), sigma)
    measured = {number for number, _, sigma in lamps if sigma < FAINT_PX}
    measured |= {number for body in bodies if body.instance < FIRST_FAINT for number in body.numbers}
    return set(range(len(detections))) - measured, features


def _distinct(lamps: Iterable[Sure]) -> list[Sure]:
    """Compact lamps, each once: with the number of a detection and a standard deviation, px."""
    kept: list[Sure] = []
    for number, lamp, sigma in lamps:
        if all(np.abs(lamp.middle - other.middle).max() > min(lamp.sizes) / 2 for _, other, _ in kept):
            kept.append((number, lamp, sigma))
    return kept


def _compact(view: View, detections: Sequence[Detection], lamps: Sequence[Sure], first: int) -> list[Feature]:
    """Features of compact lamps; a "glimpse" of one of which something may hide a side."""
    features: list[Feature] = []
    for count, (number, lamp, sigma) in enumerate(lamps, 1):
        part = "glimpse" if lamp.covered else "centre"
        points = [(part, lamp.middle), *(("side", side) for side in lamp.sides)]
        instance = first + FIRST_LIKE + count
        features += [point_feature(view, detections[number], instance, *point, sigma) for point in points]
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
