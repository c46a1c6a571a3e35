"""Masks to labelled edges and corners: boundary detection, outlier removal, intersections (paper, section III.C).

Uprights come first: the beams' masks are cut at them, so that each beam is fitted section by section.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from savmap.geometry.lines import Lines, crossing, crossing_covariance
from savmap.types import Axis, Detection, Feature, Floats, Ints, Panorama, View
from savmap.vision.edges.masks import Probability, Runs, separated, union_of_longest
from savmap_shelves.boundary_settings import BoundarySettings
from savmap_shelves.measuring import measured_strips
from savmap_shelves.merging import strips_of
from savmap_shelves.perspective import askew, crossed, paralleled
from savmap_shelves.strips import Bools, Strips

CUT_MARGIN_PX = 2.0
LEAST_SEPARATOR = 0.25
FITTED, LOWEST = 0.9, 0.4


@dataclass(frozen=True)
class Frame:
    """Whose features: the view, its size in pixels, the settings, and the least sigma that its edges may have."""

    view: View
    width: int
    height: int
    settings: BoundarySettings
    least_sigma_px: float


@dataclass(frozen=True)
class Separators:
    """All that may bound a section, left to right: strips (s,), and which are uprights to be reported (s,).

    Too short, cut or askew ones still end beams, but nothing is measured at them.
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
) -> list[Feature]:
    """The edges of uprights and beams of one view, and the beams' corners at the uprights.

    Per upright: edges "left" and "right", extended to the frame's borders, top end first, and a point "foot" where its mask
    ends inside the frame. Per beam of one section: edges "upper" and "lower", extended to the next uprights, left end
    first, with a score that is low where the mask covers little of them, and corners "upper left" ... at the uprights
    that it ends at, which `neighbours` name by role. Covariances px^2.

    With the panorama that the view was cut from, the edges are measured there (savmap.stages.subpixel).
    """
    settings = settings or BoundarySettings()
    least_px = settings.least_sigma_px if panorama is None else settings.least_measured_sigma_px
    frame = Frame(view, view.spec.width, view.spec.height, settings, least_px)
    separators = _separators(frame, detections)
    beams = _beams(frame, detections, separators)
    if panorama is not None:
        kept = np.flatnonzero(separators.kept)
        uprights, beams = measured_strips(panorama, view.spec, separators.strips[kept], beams)
        separators = replace(separators, strips=separators.strips.replaced(kept, uprights))
    return [*upright_edges(frame, separators), *beam_features(frame, beams, separators)]


def _class_mask(
    detections: Sequence[Detection], label: str, turned: bool, overlap: float
) -> tuple[NDArray[np.uint8], Probability] | None:
    """The union of a class's masks, duplicates left out, and its probability; both transposed if `turned`."""
    own = [detection for detection in detections if detection.label == label]
    if not own:
        return None
    union = union_of_longest([detection.mask for detection in own], overlap, int(turned))
    probability = own[0].probability
    return (np.ascontiguousarray(union.T), np.ascontiguousarray(probability.T)) if turned else (union, probability)


def _separators(frame: Frame, detections: Sequence[Detection]) -> Separators:
    found = _class_mask(detections, "upright", True, frame.settings.overlap)
    if found is None:
        return Separators(_no_strips(frame.settings), np.zeros(0, dtype=np.bool_))
    runs, part = separated(found[0], frame.settings.least_run_px, frame.settings.most_thick)
    strips = strips_of(runs, part, np.zeros_like(part), found[1], frame.settings)
    tall = _apparent_height(strips, frame)
    return sorted_separators(frame, strips[strips.one_edged & (strips.length >= LEAST_SEPARATOR * tall)], tall)


def sorted_separators(frame: Frame, strips: Strips, tall: float) -> Separators:
    """Strips left to right, and which are uprights to be reported: long enough for a rack `tall` pixels high, and not askew."""
    strips = strips[np.argsort(strips.either_upper.at(frame.height / 2), kind="stable")]
    kept = (strips.length >= frame.settings.least_upright * tall) & strips.two_edged
    kept[kept] = ~askew(strips[kept], (frame.height, frame.width), frame.settings)
    return Separators(strips, kept)


def _apparent_height(strips: Strips, frame: Frame) -> float:
    """How high the rack is in the picture: all of it where the view was fitted to the height, less where it was widened."""
    longest = float(strips.length.max(initial=0.0)) / FITTED
    return float(np.clip(longest, LOWEST * frame.height, frame.height))


def _no_strips(settings: BoundarySettings) -> Strips:
    none = np.zeros(0, dtype=np.int64)
    return strips_of(Runs(none, none, none), none, none, np.zeros((1, 1), dtype=np.float32), settings)


def _beams(frame: Frame, detections: Sequence[Detection], separators: Separators) -> Strips:
    """Beams, section by section from the left, each from the top."""
    settings = frame.settings
    found = _class_mask(detections, "beam", False, settings.overlap)
    if found is None:
        return _no_strips(settings)
    runs, part = separated(found[0], settings.least_run_px, settings.most_thick)
    cell = _cells(runs, separators.strips)
    inside = cell >= 0
    strips = strips_of(runs[inside], part[inside], cell[inside], found[1], settings)
    return sorted_beams(frame, strips, separators)


def sorted_beams(frame: Frame, strips: Strips, separators: Separators) -> Strips:
    """Those that may be beams, section by section from the left, each from the top."""
    settings = frame.settings
    long = strips.length >= np.maximum(settings.least_beam_px, settings.least_aspect * strips.thickness)
    strips = strips[long & strips.two_edged]
    strips = paralleled(strips[~askew(strips, (frame.width, frame.height), settings)], settings)
    strips = strips[~crossed(strips, _section_ends(strips, separators))]
    return strips[np.lexsort((strips.upper.at(frame.width / 2), strips.cell))]


def _section_ends(beams: Strips, separators: Separators) -> Floats:
    """First and last x (p, 2) of beams that are extended to the uprights next to them."""
    kept = np.append(separators.kept, False)
    row = beams.upper.at((beams.first + beams.last) / 2)
    ends = np.stack([beams.first, beams.last], axis=-1)
    for end, number in ((0, beams.cell - 1), (1, np.minimum(beams.cell, len(separators.kept)))):
        at = np.flatnonzero(kept[number])
        edges = separators.strips.lower if end == 0 else separators.strips.upper
        ends[at, end] = edges[number[at]].at(row[at])
    return ends


def _cells(runs: Runs, separators: Strips) -> Ints:
    """Which gap between separators each run is in (n,), from 0 left of the first; -1 on a separator."""
    rows = runs.middle[:, None]
    left, right = separators.either_upper.at(rows), separators.either_lower.at(rows)
    column = runs.column[:, None]
    covered = ((column > left - CUT_MARGIN_PX) & (column < right + CUT_MARGIN_PX)).any(axis=1)
    return np.where(covered, -1, (column > (left + right) / 2).sum(axis=1))


def upright_edges(frame: Frame, separators: Separators) -> Iterator[Feature]:
    """Features of the uprights that are to be reported."""
    strips = separators.strips[separators.kept]
    borders = np.broadcast_to([-0.5, frame.height - 0.5], (len(strips), 2))
    for part, lines in (("left", strips.upper), ("right", strips.lower)):
        across, covariances = _line_ends(lines, borders, frame)
        pixels = np.stack([across, borders], axis=-1)
        for index in range(len(strips)):
            name, score = ("upright", part, index), float(strips.score[index])
            yield _feature(frame, name, pixels[index], covariances[index][:, ::-1, ::-1], "y", score, {})
    yield from _feet(frame, strips)


def _feet(frame: Frame, strips: Strips) -> Iterator[Feature]:
    """Where uprights that end inside the frame end below: a point between their edges."""
    settings = frame.settings
    row = strips.last + 0.5
    middle = (strips.upper.at(row) + strips.lower.at(row)) / 2
    covariance = np.diag([settings.foot_across_px**2, settings.foot_along_px**2])[None]
    for index in np.flatnonzero(row < frame.height - settings.foot_margin_px).tolist():
        name, pixel = ("upright", "foot", index), np.array([[middle[index], row[index]]])
        yield _feature(frame, name, pixel, covariance, None, float(strips.score[index]), {})


def _line_ends(lines: Lines, u: Floats, frame: Frame) -> tuple[Floats, Floats]:
    """v (n, 2) of lines at `u` (n, 2), and the covariance (n, 2, 2, 2) px^2 of (u, v) there: long along the line."""
    column = lines.column
    along = np.concatenate([np.ones_like(column.slope), column.slope], axis=1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    variance = np.maximum(column.variance_at(u) * along[:, :1] ** 2, frame.least_sigma_px**2)
    stretch = frame.settings.along_sigma_px**2 * along[:, :, None] * along[:, None, :]
    squeeze = across[:, :, None] * across[:, None, :]
    return column.at(u), stretch[:, None] + variance[..., None, None] * squeeze[:, None]


def beam_features(frame: Frame, beams: Strips, separators: Separators) -> Iterator[Feature]:
    """Features of beams, which `sorted_beams` gives."""
    instance = np.append(separators.instance, -1)
    left, right = instance[beams.cell - 1], instance[np.minimum(beams.cell, len(instance) - 1)]
    uprights = separators.strips[separators.kept]
    touching = [_neighbours(int(one), int(other)) for one, other in zip(left, right, strict=True)]
    for part, lines in (("lower", beams.lower), ("upper", beams.upper)):
        ends = np.stack([beams.first, beams.last], axis=-1)
        for end, role, edges, number in ((0, "left", uprights.lower, left), (1, "right", uprights.upper, right)):
            at = np.flatnonzero(number >= 0)
            points, covariances = _corners(lines[at], edges[number[at]], frame.least_sigma_px)
            ends[at, end] = points[:, 0]
            for index, point, covariance in zip(at.tolist(), points, covariances, strict=True):
                name, score = ("beam", f"{part} {role}", index), float(beams.score[index])
                yield _feature(frame, name, point[None], covariance[None], None, score, touching[index])
        across, spread = _line_ends(lines, ends, frame)
        pixels = np.stack([ends, across], axis=-1)
        cover = np.clip(beams.columns / np.maximum(ends[:, 1] - ends[:, 0], 1.0), 0.0, 1.0)
        for index in range(len(beams)):
            name, score = ("beam", part, index), float(beams.score[index] * cover[index])
            yield _feature(frame, name, pixels[index], spread[index], "x", score, touching[index])


def _neighbours(left: int, right: int) -> dict[str, int]:
    return {role: number for role, number in (("left", left), ("right", right)) if number >= 0}


def _corners(lines: Lines, edges: Lines, least_sigma_px: float) -> tuple[Floats, Floats]:
    """Points (n, 2) where beams' lines meet the uprights' inner edges, and their covariances (n, 2, 2) px^2."""
    points = crossing(lines, edges)
    return points, crossing_covariance(lines, edges, points, least_sigma_px)


def _feature(
    frame: Frame,
    name: tuple[str, str, int],
    pixels: Floats,
    covariance: Floats,
    axis: Axis | None,
    score: float,
    neighbours: Mapping[str, int],
) -> Feature:
    label, part, instance = name
    view = frame.view
    return Feature(
        view.frame, view.spec.name, label, part, instance, pixels, covariance, axis, min(score, 1.0), neighbours
    )
