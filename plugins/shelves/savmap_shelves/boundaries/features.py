"""Masks to labelled edges and corners: boundary detection, outlier removal, intersections (paper, section III.C).

Uprights come first: the beams' masks are cut at them, so that each beam is fitted section by section.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from savmap.geometry.lines import Lines, crossing, crossing_covariance
from savmap.types import Axis, Bools, Detection, Feature, Floats, Ints, Panorama, View
from savmap.vision.masks import Probability, Runs, numbered_runs, numbers_of_longest
from savmap_shelves.boundaries.measuring import MeasuredParts, measured_parts, measured_strips
from savmap_shelves.boundaries.settings import BoundarySettings
from savmap_shelves.boundaries.strips import Strips, strips_of

CUT_MARGIN_PX = 2.0
LEAST_SEPARATOR = 0.25
FITTED, LOWEST = 0.9, 0.4


@dataclass(frozen=True, eq=False)
class Extraction:
    """What features are extracted with: the view, the settings, and the least sigma that its edges may have."""

    view: View
    settings: BoundarySettings
    least_sigma_px: float

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the view, px."""
        return self.view.spec.width, self.view.spec.height

    def feature(
        self,
        name: tuple[str, str, int],
        pixels: Floats,
        covariance: Floats,
        axis: Axis | None,
        score: float,
        neighbours: Mapping[str, int] | None = None,
    ) -> Feature:
        """The feature of this name: label, part and instance."""
        frame, view = self.view.frame, self.view.spec.name
        return Feature(frame, view, *name, pixels, covariance, axis, min(score, 1.0), neighbours or {})


@dataclass(frozen=True, eq=False)
class Separators:
    """What may bound a bay, left to right: strips (s,), and which are uprights to be reported (s,).

    Strips that are too short or cut still end beams, but nothing is measured at them.
    """

    strips: Strips
    kept: Bools

    @property
    def instance(self) -> Ints:
        """Numbers (s,) of the reported uprights, -1 for the others."""
        return np.where(self.kept, np.cumsum(self.kept) - 1, -1)


def extract_features(
    view: View,
    detections: Sequence[Detection],
    settings: BoundarySettings | None = None,
    panorama: Panorama | None = None,
    parts: bool = False,
) -> list[Feature]:
    """The edges of uprights and beams of one view, and the beams' corners at the uprights.

    Per upright: edges "left" and "right", extended to the frame's borders, top end first, and, of masks, a point "foot" where it ends
    inside the frame. Per beam of a bay: edges "upper" and "lower", extended to the next uprights, left end
    first, with a score that is low where the mask covers little of them, and corners "upper left" ... at the uprights
    that it ends at, which `neighbours` name by role. Covariances px^2.

    With the panorama that the view was cut from, the edges are measured there (savmap.vision.subpixel), and, if asked
    for, `parts` of each by themselves: points "left part", "upper part" ..., with a score of 0.
    """
    settings = settings or BoundarySettings()
    least_px = settings.least_sigma_px if panorama is None else settings.least_measured_sigma_px
    extraction = Extraction(view, settings, least_px)
    separators = _separators(extraction, detections)
    beams = _beams(extraction, detections, separators, panorama is not None)
    of_parts: Iterable[Feature] = ()
    if panorama is not None:
        kept = np.flatnonzero(separators.kept)
        uprights, beams = measured_strips(panorama, view.spec, separators.strips[kept], beams)
        separators = replace(separators, strips=separators.strips.replaced(kept, uprights))
        if parts:
            of_parts = _part_features(extraction, measured_parts(panorama, view.spec, uprights, beams))
    feet = _feet(extraction, separators.strips[separators.kept]) if panorama is None else ()
    return [*upright_edges(extraction, separators), *feet, *beam_features(extraction, beams, separators), *of_parts]


def _class_runs(extraction: Extraction, detections: Sequence[Detection], label: str) -> tuple[Runs, Ints, Probability]:
    """Runs (n,) of a class's masks, duplicates left out, the mask of each (n,), and the probability. Uprights lie
    transposed."""
    settings, stands = extraction.settings, label == "upright"
    of_class = [detection for detection in detections if detection.label == label]
    numbers, probability = np.zeros(extraction.size[::-1], np.uint16), np.zeros(extraction.size[::-1], np.float32)
    if of_class:
        numbers = numbers_of_longest([detection.mask for detection in of_class], settings.overlap, int(stands))
        probability = of_class[0].probability
    if stands:
        numbers, probability = cv2.transpose(numbers), cv2.transpose(probability)
    return *numbered_runs(numbers, settings.least_run_px, settings.most_thick), probability


def _separators(extraction: Extraction, detections: Sequence[Detection]) -> Separators:
    runs, part, probability = _class_runs(extraction, detections, "upright")
    strips = strips_of(runs, part, np.zeros_like(part), probability, extraction.settings)
    tall = _apparent_height(strips, extraction)
    return sorted_separators(extraction, strips[strips.one_edged & (strips.length >= LEAST_SEPARATOR * tall)], tall)


def sorted_separators(extraction: Extraction, strips: Strips, tall: float) -> Separators:
    """Strips left to right, and which are uprights to be reported: long enough for a rack `tall` pixels high."""
    strips = strips[np.argsort(strips.either_upper.at(extraction.size[1] / 2), kind="stable")]
    return Separators(strips, (strips.length >= extraction.settings.least_upright * tall) & strips.two_edged)


def _apparent_height(strips: Strips, extraction: Extraction) -> float:
    """How high the rack is in the picture, px: the view's height where it was fitted to the rack, less where it was widened."""
    height = extraction.size[1]
    return float(np.clip(float(strips.length.max(initial=0.0)) / FITTED, LOWEST * height, height))


def _beams(extraction: Extraction, detections: Sequence[Detection], separators: Separators, outlined: bool) -> Strips:
    """The beams' strips; of `outlined` ones, which are known, those too of which the picture's border cuts an edge."""
    runs, part, probability = _class_runs(extraction, detections, "beam")
    cell = _cells(runs, separators.strips)
    inside = cell >= 0
    strips = strips_of(runs[inside], part[inside], cell[inside], probability, extraction.settings)
    return sorted_beams(extraction, strips.completed() if outlined else strips[strips.two_edged])


def sorted_beams(extraction: Extraction, strips: Strips) -> Strips:
    """The strips that may be beams, bay by bay from the left, each from the top."""
    settings = extraction.settings
    long = strips.length >= np.maximum(settings.least_beam_px, settings.least_aspect * strips.thickness)
    strips = strips[long]
    return strips[np.lexsort((strips.upper.at(extraction.size[0] / 2), strips.cell))]


def _cells(runs: Runs, separators: Strips) -> Ints:
    """The gap between separators that each run is in (n,), 0 left of the first; -1 on a separator."""
    rows = runs.middle[:, None]
    left, right = separators.either_upper.at(rows), separators.either_lower.at(rows)
    column = runs.column[:, None]
    covered = ((column > left - CUT_MARGIN_PX) & (column < right + CUT_MARGIN_PX)).any(axis=1)
    return np.where(covered, -1, (column > (left + right) / 2).sum(axis=1))


def upright_edges(extraction: Extraction, separators: Separators) -> Iterator[Feature]:
    """Features of the uprights that are to be reported."""
    strips = separators.strips[separators.kept]
    borders = np.broadcast_to([-0.5, extraction.size[1] - 0.5], (len(strips), 2))
    for part, lines in (("left", strips.upper), ("right", strips.lower)):
        across, covariances = _line_ends(lines, borders, extraction)
        pixels = np.stack([across, borders], axis=-1)
        for index in range(len(strips)):
            name, score = ("upright", part, index), float(strips.score[index])
            yield extraction.feature(name, pixels[index], covariances[index][:, ::-1, ::-1], "y", score)


def _part_features(extraction: Extraction, parts: MeasuredParts) -> Iterator[Feature]:
    """A point in the middle of each part of an edge that was measured."""
    for label, sides, groups in zip(("upright", "beam"), (("left", "right"), ("upper", "lower")), parts, strict=True):
        for lines, middle, seen in groups:
            across, covariances = _line_ends(lines, middle[:, None], extraction)
            pixels = np.stack([middle, across[:, 0]], axis=-1)
            if label == "upright":
                pixels, covariances = pixels[:, ::-1], covariances[:, :, ::-1, ::-1]
            count = len(lines) // 2
            for index in np.flatnonzero(seen).tolist():
                name = label, f"{sides[index // count]} part", index % count
                yield extraction.feature(name, pixels[index][None], covariances[index], None, 0.0)


def _feet(extraction: Extraction, strips: Strips) -> Iterator[Feature]:
    """The feet of uprights that end inside the frame: a point between their edges."""
    settings = extraction.settings
    row = strips.last + 0.5
    middle = (strips.upper.at(row) + strips.lower.at(row)) / 2
    covariance = np.diag([settings.foot_across_px**2, settings.foot_along_px**2])[None]
    for index in np.flatnonzero(row < extraction.size[1] - settings.foot_margin_px).tolist():
        name, pixel = ("upright", "foot", index), np.array([[middle[index], row[index]]])
        yield extraction.feature(name, pixel, covariance, None, float(strips.score[index]))


def _line_ends(lines: Lines, u: Floats, extraction: Extraction) -> tuple[Floats, Floats]:
    """v (n, 2) of lines at `u` (n, 2), and the covariance (n, 2, 2, 2) px^2 of (u, v) there: long along the line."""
    column = lines.column
    along = np.concatenate([np.ones_like(column.slope), column.slope], axis=1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    variance = np.maximum(column.variance_at(u) * along[:, :1] ** 2, extraction.least_sigma_px**2)
    stretch = extraction.settings.along_sigma_px**2 * along[:, :, None] * along[:, None, :]
    squeeze = across[:, :, None] * across[:, None, :]
    return column.at(u), stretch[:, None] + variance[..., None, None] * squeeze[:, None]


def beam_features(extraction: Extraction, beams: Strips, separators: Separators) -> Iterator[Feature]:
    """Features of beams."""
    instance = np.append(separators.instance, -1)
    left, right = instance[beams.cell - 1], instance[np.minimum(beams.cell, len(instance) - 1)]
    uprights = separators.strips[separators.kept]
    touching = [
        {role: number for role, number in (("left", before), ("right", after)) if number >= 0}
        for before, after in zip(left.tolist(), right.tolist(), strict=True)
    ]
    for part, lines in (("lower", beams.lower), ("upper", beams.upper)):
        ends = np.stack([beams.first, beams.last], axis=-1)
        for end, role, edges, number in ((0, "left", uprights.lower, left), (1, "right", uprights.upper, right)):
            at = np.flatnonzero((number >= 0) & (lines.inliers > 0))
            level, upright = lines[at], edges[number[at]]
            points = crossing(level, upright)
            covariances = crossing_covariance(level, upright, points, extraction.least_sigma_px)
            ends[at, end] = points[:, 0]
            for index, point, covariance in zip(at.tolist(), points, covariances, strict=True):
                name, score = ("beam", f"{part} {role}", index), float(beams.score[index])
                yield extraction.feature(name, point[None], covariance[None], None, score, touching[index])
        across, spread = _line_ends(lines, ends, extraction)
        pixels = np.stack([ends, across], axis=-1)
        cover = np.clip(beams.columns / np.maximum(ends[:, 1] - ends[:, 0], 1.0), 0.0, 1.0)
        for index in np.flatnonzero(lines.inliers > 0).tolist():
            name, score = ("beam", part, index), float(beams.score[index] * cover[index])
            yield extraction.feature(name, pixels[index], spread[index], "x", score, touching[index])
