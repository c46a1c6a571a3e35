"""Detections in a frame of what all frames together show: also of what is too faint to be seen in it alone."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Detection, Feature, Floats, FoundObject, View, ViewSpec
from savmap.vision.evidence.planes import outline_in
from savmap.vision.networks.segmenter import Segmentation

Singles = NDArray[np.float32]
Outlined = tuple[FoundObject, Floats]
"""A found object and its outline (m, 2) px in a view."""

LIKELY_QUANTILE, FAINTEST, LEAST_PX = 80.0, 0.06, 12
"""A network sees an object where this percentile of the scores inside of it, over so many pixels at least, is no fainter."""
AROUND_PX, OUTSIDE_PX, HALF, BAND = 64.0, 2.0, 0.5, 0.15


def outlines_in(view: ViewSpec, world_from_rig: Floats, objects: Sequence[FoundObject]) -> list[Outlined]:
    """The objects that a view shows a part of, each with its outline in it."""
    outlines = [(item, outline_in(view, world_from_rig, item.outline)) for item in objects]
    return [(item, outline) for item, outline in outlines if outline is not None]


def found_detections(
    view: View, segmentation: Segmentation, world_from_rig: Floats, objects: Sequence[FoundObject]
) -> list[Detection]:
    """The regions of a view in which a network sees what is found, their borders no further from its outline's than `BAND` of its lesser
    thickness: beyond it is something else, and what is hidden within it is filled."""
    detections: list[Detection] = []
    for label, probability in zip(segmentation.classes, segmentation.maps[1:], strict=True):
        union, drawn = np.zeros_like(probability), list[tuple[float, NDArray[np.bool_]]]()
        for item in (item for item in objects if item.label == label):
            outer, inner = (_shown(view.spec, world_from_rig, grown(item.outline, by)) for by in (BAND, -BAND))
            part = _part_around(outer, probability.shape)
            if part is None:
                continue
            around, within = (_covered(band, part) for band in (outer, inner))
            core = probability[part][within > HALF]
            usual = float(np.percentile(core, LIKELY_QUANTILE)) if len(core) >= LEAST_PX else 0.0
            if usual > FAINTEST:
                raised = np.minimum(np.maximum(np.minimum(probability[part] / usual / 2, 1.0), within), around)
                mask = np.zeros(probability.shape, np.bool_)
                mask[part] = raised >= HALF
                drawn.append((float(core.mean(dtype=np.float64)), mask))
                np.maximum(union[part], raised, out=union[part])
        detections += [Detection(label, score, mask, union) for score, mask in drawn]
    return detections


def grown(outline: Floats, share: float) -> Floats:
    """An outline (n, 3) that reaches so much further on both sides across it, as a share of its lesser thickness."""
    centred = outline - outline.mean(axis=0)
    across = np.linalg.svd(centred, full_matrices=False)[2][1]
    return np.asarray(outline + 2 * share * (centred @ across)[:, None] * across)


def _shown(spec: ViewSpec, world_from_rig: Floats, outline: Floats) -> Floats:
    """What a view shows (n, 2) px of an outline."""
    pixels = outline_in(spec, world_from_rig, outline)
    return within_picture(pixels, (spec.height, spec.width)) if pixels is not None else np.zeros((0, 2))


def _part_around(outline: Floats, shape: tuple[int, ...]) -> tuple[slice, slice] | None:
    """Rows and columns of a picture (height, width) around an outline (n, 2) px; None where they are none."""
    if not len(outline):
        return None
    low = np.maximum(np.floor(outline.min(axis=0)).astype(int) - 1, 0).tolist()
    high = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + 2, shape[::-1]).tolist()
    return (slice(low[1], high[1]), slice(low[0], high[0])) if low[0] < high[0] and low[1] < high[1] else None


def _covered(outline: Floats, part: tuple[slice, slice]) -> Singles:
    """How much of each pixel of a part of a picture an outline (n, 2) px covers."""
    rows, columns = part
    covered = np.zeros((rows.stop - rows.start, columns.stop - columns.start), np.uint8)
    if len(outline):
        corners = np.round(16 * (outline - [columns.start, rows.start])).astype(np.int32)
        cv2.fillConvexPoly(covered, corners, 255, cv2.LINE_AA, 4)
    return np.asarray(covered, np.float32) / np.float32(255)


def features_of(
    features: Sequence[Feature],
    outlines: Sequence[Outlined],
    outside_px: float = OUTSIDE_PX,
    inwards_px: float = float("inf"),
) -> list[Feature]:
    """The features of a view with the object of each: that of its class whose outline its instance lies farthest inside
    of. With `inwards_px`, each feature of an instance is looked up by itself, so much nearer to the instance's middle
    than it is: one instance may show several objects."""
    exact = [(item, outline.astype(np.float32)) for item, outline in outlines]
    pixels: dict[tuple[str, int], list[Floats]] = {}
    for feature in features:
        pixels.setdefault((feature.label, feature.instance), []).append(feature.pixels)
    middles = {key: np.concatenate(pixel_groups).mean(axis=0) for key, pixel_groups in pixels.items()}
    placed = list[Feature]()
    for feature in features:
        place = feature.pixels.mean(axis=0)
        way = middles[feature.label, feature.instance] - place
        place = place + min(1.0, inwards_px / max(float(np.linalg.norm(way)), 1e-9)) * way
        placed.append(replace(feature, object=_object_at(feature.label, place, exact, outside_px)))
    return placed


def _object_at(
    label: str, place: Floats, outlines: Sequence[tuple[FoundObject, NDArray[np.float32]]], outside_px: float
) -> str:
    """The id of the object of a class whose outline a place (2,) px is farthest inside of; empty where it is outside of all."""
    best, name = -outside_px, ""
    for item, outline in outlines:
        if item.label == label:
            inside = cv2.pointPolygonTest(outline, (float(place[0]), float(place[1])), True)
            if inside > best:
                best, name = inside, item.id
    return name


def within_picture(outline: Floats, shape: tuple[int, ...]) -> Floats:
    """The part (m, 2) of a convex outline (n, 2) px that lies in a picture (height, width) or `AROUND_PX` around it; none where (0, 2).

    In a wide view the ends of what passes beside the camera lie thousands of pixels away: moved to the border they would bend it.
    """
    size = np.array(shape[::-1])
    if (outline >= -AROUND_PX).all() and (outline <= size - 1 + AROUND_PX).all():
        return outline
    for axis, last in ((0, shape[1] - 1), (1, shape[0] - 1)):
        for side, border in ((1.0, -AROUND_PX), (-1.0, -(last + AROUND_PX))):
            outline = _cut(outline, side * outline[:, axis] - border)
    return outline


def _cut(outline: Floats, inside: Floats) -> Floats:
    """The part (m, 2) of an outline (n, 2) where `inside` (n,), which is linear along its sides, is not negative."""
    kept: list[Floats] = []
    ends = zip(outline, np.roll(outline, -1, axis=0), inside, np.roll(inside, -1), strict=True)
    for first, second, before, after in ends:
        if before >= 0:
            kept.append(first)
        if (before >= 0) != (after >= 0):
            kept.append(first + before / (before - after) * (second - first))
    return np.array(kept).reshape(-1, 2)
