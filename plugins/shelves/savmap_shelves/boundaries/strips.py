"""Strips: long thin shapes bounded by two straight edges, from the runs of masks.

A strip lies along u and is crossed along v: u = x, v = y for a beam, u = y, v = x for an upright. Its `upper` edge is
the one at smaller v. Paper, section III.C, step 2.
"""

from dataclasses import dataclass, replace

import numpy as np

from savmap.geometry.lines import Lines, robust_lines, where
from savmap.types import Bools, Floats, Ints
from savmap.vision.masks import Probability, Runs, border_points, enveloped
from savmap_shelves.boundaries.settings import BoundarySettings

LEAST_POINTS = 8
LEAST_SHARE = 0.35
LEAST_THICKNESS_PX = 1.0


@dataclass(frozen=True, eq=False)
class Strips:
    """p strips: lines of both edges; cell, first and last u and number of columns of the mask, mean probability (p,)."""

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

    def replaced(self, index: Ints, others: "Strips") -> "Strips":
        """These, with others (i,) in the place of those at `index` (i,)."""
        order = np.arange(len(self))
        order[index] = len(self) + np.arange(len(index))
        return self.joined(others)[order]

    def joined(self, others: "Strips") -> "Strips":
        """These, then others."""
        upper, lower = self.upper.joined(others.upper), self.lower.joined(others.lower)
        rest = zip(list(vars(self).values())[2:], list(vars(others).values())[2:], strict=True)
        return Strips(upper, lower, *(np.concatenate(pair) for pair in rest))

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
        """The upper edges, or the lower ones where those were not known."""
        return where(self.upper.inliers > 0, self.upper, self.lower)

    @property
    def either_lower(self) -> Lines:
        """The lower edges, or the upper ones where those were not known."""
        return where(self.lower.inliers > 0, self.lower, self.upper)

    @property
    def one_edged(self) -> Bools:
        """Whether strips have an edge at all (p,)."""
        return np.maximum(self.upper.inliers, self.lower.inliers) >= LEAST_POINTS

    @property
    def two_edged(self) -> Bools:
        """Whether strips have two edges that enough of their mask supports (p,); the picture's border cuts the others."""
        return self._supported(self.upper) & self._supported(self.lower) & (self.thickness > LEAST_THICKNESS_PX)

    def _supported(self, lines: Lines) -> Bools:
        return np.asarray(lines.inliers >= np.maximum(LEAST_POINTS, LEAST_SHARE * self.columns))

    def completed(self) -> "Strips":
        """Those with an edge that enough of their mask supports; where the picture's border cuts the other one off, it
        lies as far from that as is usual, without inliers. None where no strip has both."""
        if not self.two_edged.any():
            return self[self.two_edged]
        usual = float(np.median(self.thickness[self.two_edged]))
        strips = self[self.two_edged | (self._supported(self.upper) ^ self._supported(self.lower))]
        above, below = (replace(lines, inliers=0 * lines.inliers) for lines in (strips.upper, strips.lower))
        upper = where(strips._supported(strips.upper), strips.upper, replace(below, offset=below.offset - usual))
        lower = where(strips._supported(strips.lower), strips.lower, replace(above, offset=above.offset + usual))
        return replace(strips, upper=upper, lower=lower)


def strips_of(runs: Runs, part: Ints, cell: Ints, probability: Probability, settings: BoundarySettings) -> Strips:
    """The strips that runs (n,) make: one for each `part` (n,) in each `cell` (n,); edges as robust least-squares
    lines, which leave out the rounded ends."""
    parts = int(part.max(initial=0)) + 1
    keys, index = np.unique(cell * parts + part, return_inverse=True)
    runs, index = enveloped(runs, index)
    count, u = len(keys), runs.column.astype(np.float64)
    first, last = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(first, index, u)
    np.maximum.at(last, index, u)
    trim = np.minimum(settings.end_trim_px, (last - first) / 8)[index]
    inner = (u - first[index] >= trim) & (last[index] - u >= trim)
    v = np.where(inner, border_points(runs, probability), np.nan).ravel()
    finite = np.isfinite(v)
    group = np.concatenate([index, index + count])
    lines = robust_lines(group[finite], np.tile(u, 2)[finite], v[finite], 2 * count, settings.edge_tolerance_px)
    columns = np.bincount(index, minlength=count).astype(np.float64)
    inside = probability[((runs.first + runs.last) // 2), runs.column].astype(np.float64)
    score = np.bincount(index, inside, count) / np.maximum(columns, 1)
    return Strips(lines[:count], lines[count:], keys // parts, first, last, columns, score)
