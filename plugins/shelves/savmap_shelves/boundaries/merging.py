"""From the runs of a class's mask to its strips: fragments are merged, duplicates dropped (paper, section III.C, step 3)."""

from dataclasses import replace

import numpy as np

from savmap.types import Bools, Floats, Ints
from savmap.vision.masks import Probability, Runs
from savmap_shelves.boundaries.perspective import steadied
from savmap_shelves.boundaries.settings import BoundarySettings
from savmap_shelves.boundaries.strips import Strips, borders_of, fitted

LEAST_COMMON = 0.2


def strips_of(runs: Runs, part: Ints, cell: Ints, probability: Probability, settings: BoundarySettings) -> Strips:
    """The strips that runs (n,) make: one for each region `part` (n,) in each `cell` (n,), fragments in line merged."""
    if not len(part):
        return fitted(borders_of(runs, part, probability, settings), np.zeros(0, dtype=np.int64), settings)
    parts = int(part.max()) + 1
    keys, index = np.unique(cell * parts + part, return_inverse=True)
    borders = borders_of(runs, index, probability, settings)
    strips = fitted(borders, keys // parts, settings)
    group = _grouped(strips, settings)
    if (group != np.arange(len(group))).any():
        numbers, merged = np.unique(group, return_inverse=True)
        borders = replace(borders, part=merged[borders.part])
        strips = fitted(borders, strips.cell[numbers], settings)
    return longest_only(steadied(strips, borders, settings))


def _grouped(pieces: Strips, settings: BoundarySettings) -> Ints:
    """For each piece (p,) the longest piece of its cell that it continues, or itself (goods in front split a strip)."""
    group = np.arange(len(pieces))
    fits = _continues(pieces, settings) & (pieces.cell[:, None] == pieces.cell)
    free = np.ones(len(pieces), dtype=np.bool_)
    for leader in np.argsort(-pieces.length, kind="stable"):
        if free[leader]:
            members = fits[leader] & free
            group[members] = leader
            free[members] = False
            free[leader] = False
    return group


def _continues(pieces: Strips, settings: BoundarySettings) -> Bools:
    """Whether the edges of piece i, extended, go along those of piece j (i, j), beside it and not over or under it."""
    apart, sigma = np.zeros((2, len(pieces), len(pieces)))
    for lines in (pieces.upper, pieces.lower):
        for end in (pieces.first, pieces.last):
            apart = np.maximum(apart, np.abs(lines.column.at(end) - lines.at(end)))
            sigma = np.maximum(sigma, np.sqrt(lines.column.variance_at(end) + lines.variance_at(end)))
    thickness = np.minimum(pieces.thickness[:, None], pieces.thickness)
    most = np.maximum(settings.merge_tolerance_px, thickness / 2)
    in_line = apart <= np.minimum(settings.merge_tolerance_px + 3 * sigma, most)
    return np.asarray(in_line & ~_side_by_side(pieces))


def longest_only(strips: Strips) -> Strips:
    """Strips without those that overlap longer ones (paper: keep only the longest)."""
    first, last = _common_span(strips)
    upper, lower = (lines.column.at((first + last) / 2) for lines in (strips.upper, strips.lower))
    overlap = (np.maximum(upper, upper.T) < np.minimum(lower, lower.T)) & _side_by_side(strips)
    overlap &= strips.cell[:, None] == strips.cell
    kept = np.zeros(len(strips), dtype=np.bool_)
    for index in np.argsort(-strips.length, kind="stable"):
        kept[index] = not (overlap[index] & kept).any()
    return strips[kept]


def _side_by_side(strips: Strips) -> Bools:
    """Which pairs (p, p) share more than a bit of their extent along u."""
    first, last = _common_span(strips)
    return np.asarray(last - first >= LEAST_COMMON * np.minimum(strips.length[:, None], strips.length))


def _common_span(strips: Strips) -> tuple[Floats, Floats]:
    """First and last u (p, p) that pairs have in common; the last is smaller where they have none."""
    return np.maximum(strips.first[:, None], strips.first), np.minimum(strips.last[:, None], strips.last)
