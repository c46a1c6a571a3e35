"""Strips: long thin things bounded by two straight edges, from mask runs; how they merge, overlap and go askew.

A strip lies along u and is crossed along v: u = x, v = y for a beam, u = y, v = x for an upright. Its `upper` edge is
the one at smaller v. Paper, section III.C, steps 2 and 3.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from savmap.geometry.lines import Lines, convergence, robust_lines, where
from savmap.stages.edges import Ints, Probability, Runs, border_points, enveloped
from savmap.types import Floats
from savmap_shelves.boundary_settings import BoundarySettings

Bools = NDArray[np.bool_]

LEAST_POINTS = 8
LEAST_SHARE = 0.35
LEAST_COMMON = 0.2
LEAST_THICKNESS_PX = 1.0


@dataclass(frozen=True)
class Borders:
    """Border points of strips (n,): part, u, upper and lower v (nan where not seen), probability inside."""

    part: Ints
    u: Floats
    upper: Floats
    lower: Floats
    probability: Floats


@dataclass(frozen=True)
class Strips:
    """p strips: lines of both edges, the cell that each lies in (p,), first and last u of its mask (p,), columns of its
    mask (p,), mean probability (p,)."""

    upper: Lines
    lower: Lines
    cell: Ints
    first: Floats
    last: Floats
    columns: Floats
    score: Floats

    def __len__(self) -> int:
        return len(self.cell)

    def __getitem__(self, index: Ints | Bools) -> "Strips":
        return Strips(*(value[index] for value in vars(self).values()))

    @property
    def length(self) -> Floats:
        """From the first to the last column of the mask (p,)."""
        return self.last - self.first + 1

    @property
    def thickness(self) -> Floats:
        """Between the edges, in the middle of the strip (p,)."""
        middle = (self.first + self.last) / 2
        return self.lower.at(middle) - self.upper.at(middle)

    @property
    def either_upper(self) -> Lines:
        """The upper edges, or the lower ones where those were not seen."""
        return where(self.upper.inliers > 0, self.upper, self.lower)

    @property
    def either_lower(self) -> Lines:
        """The lower edges, or the upper ones where those were not seen."""
        return where(self.lower.inliers > 0, self.lower, self.upper)

    @property
    def one_edged(self) -> Bools:
        """Which have an edge at all (p,)."""
        return np.maximum(self.upper.inliers, self.lower.inliers) >= LEAST_POINTS

    @property
    def two_edged(self) -> Bools:
        """Which have two edges that enough of their mask supports (p,): the picture's border cuts the others."""
        least = np.maximum(LEAST_POINTS, LEAST_SHARE * self.columns)
        return (np.minimum(self.upper.inliers, self.lower.inliers) >= least) & (self.thickness > LEAST_THICKNESS_PX)


def strips_of(runs: Runs, part: Ints, cell: Ints, probability: Probability, settings: BoundarySettings) -> Strips:
    """The strips that runs (n,) of regions `part` (n,) in `cell` (n,) make: one a region and cell, but fragments in line
    are one."""
    if not len(part):
        return _fitted(_borders(runs, part, probability, settings), np.zeros(0, dtype=np.int64), settings)
    parts = int(part.max()) + 1
    keys, index = np.unique(cell * parts + part, return_inverse=True)
    borders = _borders(runs, index, probability, settings)
    pieces = _fitted(borders, keys // parts, settings)
    group = _grouped(pieces, settings)
    if (group == np.arange(len(group))).all():
        return _longest_only(pieces)
    numbers, merged = np.unique(group, return_inverse=True)
    whole = replace(borders, part=merged[borders.part])
    return _longest_only(_fitted(whole, pieces.cell[numbers], settings))


def askew(strips: Strips, shape: tuple[float, float], settings: BoundarySettings) -> Bools:
    """Which strips' edges, extended, meet within the picture plane enlarged by `plane_margin` in each dimension (p,).

    `shape` is the picture's size along u and along v. Published, but for two allowances: edges may meet as far as their
    fit's noise explains it, and what converges as all strips of the picture do is perspective, not askew.
    """
    slack = settings.plane_margin / 2
    ends = np.array([[-slack], [1 + slack]]) * shape[0]
    middle = (strips.first + strips.last) / 2
    gap = strips.lower.at(ends) - strips.upper.at(ends)
    in_perspective = gap - _slope_apart(strips) * (ends - middle)
    noise = np.sqrt(strips.lower.variance_at(ends) + strips.upper.variance_at(ends))
    meets = np.maximum(gap, in_perspective) < -settings.askew_sigmas * noise
    nearer = strips.thickness / np.maximum(strips.thickness - gap, 1e-9)
    at = strips.upper.at(middle + nearer * (ends - middle))
    in_plane = (at > -slack * shape[1]) & (at < (1 + slack) * shape[1])
    return np.asarray((meets & in_plane).any(axis=0))


def paralleled(strips: Strips, settings: BoundarySettings) -> Strips:
    """Strips whose edges' slopes differ as the picture's perspective wants it, as far as they are not known better.

    A prior of `parallel_sigma` on the difference: it steadies short strips, and long ones do not feel it.
    """
    upper, lower = strips.upper, strips.lower
    total = upper.slope_var + lower.slope_var + settings.parallel_sigma**2
    surprise = (lower.slope - upper.slope - _slope_apart(strips)) / total
    steady = [
        replace(line, slope=line.slope + sign * line.slope_var * surprise, slope_var=line.slope_var - line.slope_var**2 / total)
        for line, sign in ((upper, 1), (lower, -1))
    ]
    return replace(strips, upper=steady[0], lower=steady[1])


def _slope_apart(strips: Strips) -> Floats:
    """The slope of lower less that of upper edges (p,) that the common vanishing point of all strips asks for."""
    return convergence(_middle(strips)) * (strips.lower.at_zero - strips.upper.at_zero)


def _middle(strips: Strips) -> Lines:
    upper, lower = strips.upper, strips.lower
    slope = (upper.slope + lower.slope) / 2
    zero = np.zeros(len(strips))
    return Lines(zero, slope, (upper.at_zero + lower.at_zero) / 2, zero, zero, strips.first, strips.last, strips.columns)


def _borders(runs: Runs, part: Ints, probability: Probability, settings: BoundarySettings) -> Borders:
    runs, part = enveloped(runs, part)
    upper, lower = border_points(runs, probability)
    u = runs.column.astype(np.float64)
    inside = probability[((runs.first + runs.last) // 2), runs.column].astype(np.float64)
    first, last = _spans(part, u, int(part.max(initial=-1)) + 1)
    trim = np.minimum(settings.end_trim_px, (last - first) / 8)[part] if len(part) else u
    ending = (u - first[part] < trim) | (last[part] - u < trim)
    return Borders(part, u, np.where(ending, np.nan, upper), np.where(ending, np.nan, lower), inside)


def _spans(part: Ints, u: Floats, count: int) -> tuple[Floats, Floats]:
    first, last = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(first, part, u)
    np.maximum.at(last, part, u)
    return first, last


def _fitted(borders: Borders, cell: Ints, settings: BoundarySettings) -> Strips:
    count = len(cell)
    group = np.concatenate([borders.part, borders.part + count])
    u, v = np.tile(borders.u, 2), np.concatenate([borders.upper, borders.lower])
    seen = np.isfinite(v)
    lines = robust_lines(group[seen], u[seen], v[seen], 2 * count, settings.edge_tolerance_px)
    columns = np.bincount(borders.part, minlength=count).astype(np.float64)
    score = np.bincount(borders.part, borders.probability, count) / np.maximum(columns, 1)
    return Strips(lines[:count], lines[count:], cell, *_spans(borders.part, borders.u, count), columns, score)


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


def _longest_only(strips: Strips) -> Strips:
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
