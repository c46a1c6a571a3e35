"""What is detected in a frame of the objects that all frames together show there: also what is too faint to be seen in it alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Detection, Expected, Feature, Floats, View, ViewSpec
from savmap.vision.evidence.colours import colour_probability
from savmap.vision.evidence.planes import outline_in
from savmap.vision.networks.adapter import regions
from savmap.vision.networks.segmenter import Segmentation

Singles = NDArray[np.float32]
Outlined = tuple[Expected, Floats]
"""An expected object and its outline (m, 2) px in a view."""

LIKELY_QUANTILE = 80.0
AROUND_PX = 64.0


def outlines_in(view: ViewSpec, world_from_rig: Floats, expected: Sequence[Expected]) -> list[Outlined]:
    """The objects that a view shows a part of, each with its outline in it."""
    outlines = [(thing, outline_in(view, world_from_rig, thing.outline)) for thing in expected]
    return [(thing, outline) for thing, outline in outlines if outline is not None]


@dataclass(frozen=True)
class DetectionSettings:
    """How expected objects are detected in a frame.

    An object's pixels are those within `margin` of its outline, as a share of its lesser thickness (and `margin_px` more), whose probability
    is above half of the object's usual one, the 80th percentile inside it. This must be at least `faintest`. Connected regions of fewer than
    `least_px` pixels are left out.
    """

    margin: float = 0.35
    margin_px: float = 2.0
    faintest: float = 0.06
    least_px: int = 12


USUAL = DetectionSettings()


def expected_detections(
    view: View,
    segmentation: Segmentation,
    expected: Sequence[Outlined],
    settings: DetectionSettings = DetectionSettings(),
) -> list[Detection]:
    """The regions of a view in which a network sees one of the objects that are outlined there, also faintly, and no other regions.

    Probabilities are scaled so that half of an object's usual one becomes 0.5, the level of a mask's border. An object that is `in_pieces`,
    and of which the network sees nothing, gets its probabilities from colours (`colour_probability`).
    """
    detections: list[Detection] = []
    for label, probability in zip(segmentation.classes, segmentation.maps[1:], strict=True):
        raised = np.zeros_like(probability)
        for target, outline in expected:
            if target.label == label:
                scaled = _raised(probability, outline, settings)
                if target.in_pieces and not scaled.any():
                    scaled = _probability_by_colour(view, probability, outline)
                np.maximum(raised, scaled, out=raised)
        detections += regions(label, raised, 0.5, settings.least_px)
    return detections


def features_of(features: Sequence[Feature], outlines: Sequence[Outlined]) -> list[Feature]:
    """The features of those instances of a view that do not lie at an absent object's outline, farther inside of it than of any other's."""
    if not any(thing.absent for thing, _ in outlines):
        return [*features]
    exact = [(thing, outline.astype(np.float32)) for thing, outline in outlines]
    pixels: dict[tuple[str, int], list[Floats]] = {}
    for feature in features:
        pixels.setdefault((feature.label, feature.instance), []).append(feature.pixels)
    absent = {key for key, own in pixels.items() if _is_absent(key[0], np.concatenate(own).mean(axis=0), exact)}
    return [feature for feature in features if (feature.label, feature.instance) not in absent]


def _is_absent(label: str, place: Floats, outlines: Sequence[tuple[Expected, NDArray[np.float32]]]) -> bool:
    """Whether a place (2,) px is nearer to an absent object of a class, to a pixel, than to all that are there."""
    inside = {True: -np.inf, False: -np.inf}
    for thing, outline in outlines:
        if thing.label == label:
            depth = cv2.pointPolygonTest(outline, (float(place[0]), float(place[1])), True)
            inside[thing.absent] = max(inside[thing.absent], depth)
    return inside[True] > max(inside[False], -1.0)


def _raised(probability: Singles, outline: Floats, settings: DetectionSettings) -> Singles:
    shown = within_picture(outline, probability.shape)
    core = _filled(shown, probability.shape)
    usual = float(np.percentile(probability[core], LIKELY_QUANTILE)) if core.any() else 0.0
    if usual < settings.faintest:
        return np.zeros_like(probability)
    width = round(settings.margin * _thickness(shown) + settings.margin_px)
    kernel = np.ones((2 * width + 1, 2 * width + 1), np.uint8)
    near = np.asarray(cv2.dilate(core.view(np.uint8), kernel), np.bool_)
    return np.asarray(np.where(near, np.minimum(probability / min(usual, 1.0), 1.0), 0.0), np.float32)


def _probability_by_colour(view: View, probability: Singles, outline: Floats) -> Singles:
    """The probability by colour (height, width) of the pixels in an outline (n, 2), or within a pixel of it; 0 elsewhere."""
    inside = _filled(within_picture(outline, probability.shape), probability.shape)
    near = np.asarray(cv2.dilate(inside.view(np.uint8), np.ones((3, 3), np.uint8)), np.bool_)
    return np.asarray(np.where(near, colour_probability(view.image, probability), 0.0), np.float32)


def _thickness(outline: Floats) -> float:
    """The lesser side, px, of the smallest rectangle around an outline (n, 2)."""
    return float(min(cv2.minAreaRect(outline.astype(np.float32))[1]))


def _filled(outline: Floats, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    mask = np.zeros(shape, np.uint8)
    if len(outline):
        cv2.fillPoly(mask, [np.round(16 * outline).astype(np.int32)], 1, shift=4)
    return mask.view(np.bool_)


def within_picture(outline: Floats, shape: tuple[int, ...]) -> Floats:
    """The part (m, 2) of a convex outline (n, 2) px that lies in a picture (height, width) or `AROUND_PX` around it; none where (0, 2).

    In a wide view the ends of what passes beside the camera lie thousands of pixels away: moved to the border they would bend it.
    """
    for axis, last in ((0, shape[1] - 1), (1, shape[0] - 1)):
        for side, border in ((1.0, -AROUND_PX), (-1.0, -(last + AROUND_PX))):
            outline = _cut(outline, side * outline[:, axis] - border)
    return outline


def _cut(outline: Floats, inside: Floats) -> Floats:
    """The part (m, 2) of an outline (n, 2) where `inside` (n,), which is linear along its sides, is not negative."""
    kept: list[Floats] = []
    ends = zip(outline, np.roll(outline, -1, axis=0), inside, np.roll(inside, -1), strict=True)
    for first, second, here, there in ends:
        if here >= 0:
            kept.append(first)
        if (here >= 0) != (there >= 0):
            kept.append(first + here / (here - there) * (second - first))
    return np.array(kept).reshape(-1, 2)
