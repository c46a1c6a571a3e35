"""Paint: how like the tracked beams' a colour is, and how unlike the rest of the face's.

A network knows racks in general; the pictures of a row show how this one is painted. Colours of the levels that were tracked and of the whole
face between the posts are counted in the orthophoto. A level is judged by the paint of the other storeys only: what is no beam often goes on
through the whole row, and would vouch for itself.
"""

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter1d

from savmap.types import Bools, Floats, PlaneEvidence
from savmap_shelves.evidence.face_grid import Grid

BIN, BINS = 8, 32
CORE, BESIDE, SAME = 0.6, 1.0, 1.5
LEAST_STOREYS, TELLING = 2, 0.5

EVERY, LEAST = -1, 1e-7

Span = tuple[float, float]
Table = NDArray[np.float64]


class Paint:
    """The paint of a face's beams, by the levels that were tracked."""

    def __init__(self, evidence: PlaneEvidence, grid: Grid) -> None:
        patch = evidence.patch
        self.x, self.y = patch.origin[0] + patch.across, patch.origin[1] + patch.heights
        self.colour = np.asarray(cv2.cvtColor(np.ascontiguousarray(evidence.picture), cv2.COLOR_RGB2LAB) // BIN)
        self.seen, self.thickness, self.cell = evidence.weight > 0, grid.thickness, patch.cell
        spans = [(float(left[1]), float(right[0])) for left, right in pairwise(grid.posts)]
        levels = np.concatenate(grid.sections)
        owners = [spans[k] for k, section in enumerate(grid.sections) for _ in section]
        self.centres = levels.mean(axis=1)
        self.storeys = _storeys(self.centres, SAME * grid.thickness)
        self.tables = self._tables(levels, owners, spans)
        middle, half = (levels.min() + levels.max()) / 2, float(np.ptp(levels)) / 2
        likely = [self.likely(*span, centre) for span, centre in zip(owners, self.centres.tolist(), strict=True)]
        rows = [self._rows(span, self.tables[EVERY])[np.abs(self.y - middle) < half] for span in spans]
        self.usual, self.elsewhere = float(np.median(likely)), float(np.median(np.concatenate(rows)))

    def _tables(self, levels: Floats, owners: Sequence[Span], spans: Sequence[Span]) -> list[Table]:
        """By colour, how likely it is beams' paint rather than any: by the paint of all storeys but the first, second, ..., and of all."""
        count = int(self.storeys.max()) + 1
        painted = np.zeros((count, *(BINS,) * 3))
        for level, storey, span in zip(levels, self.storeys, owners, strict=True):
            painted[storey] += self._counted(span, level.mean(), CORE / 2 * float(np.ptp(level)))
        middle, half = (levels.min() + levels.max()) / 2, float(np.ptp(levels)) / 2
        anything = _density(np.sum([self._counted(span, middle, half) for span in spans], axis=0))
        beams = np.array([_density(counts) for counts in painted])
        without = [np.delete(beams, storey, axis=0).sum(axis=0) / max(count - 1, 1) for storey in range(count)]
        return [mean / (mean + anything + LEAST) for mean in (*without, beams.mean(axis=0))]

    @property
    def tells(self) -> bool:
        """Whether beams differ from the rest of the face by their paint, as far as several storeys show."""
        return len(self.tables) > LEAST_STOREYS and self.usual - self.elsewhere > TELLING

    def likeness(self, left: float, right: float, centre: float, where: Floats | None = None) -> float:
        """How like the others' a level's paint is between two posts: about 1 as like as theirs are one another's, 0 as the rest of the face.
        `where` (columns,): how much each column counts, all of them alike unless given."""
        return (self.likely(left, right, centre, where) - self.elsewhere) / (self.usual - self.elsewhere)

    def likely(self, left: float, right: float, centre: float, where: Floats | None = None) -> float:
        """The greatest mean probability of beams' paint along the rows beside a height, by the paint of the other storeys."""
        rows = self._rows((left, right), self._table_at(centre), where)
        return float(rows[np.abs(self.y - centre) < BESIDE * self.thickness].max(initial=0.0))

    def extent(self, left: float, right: float, centre: float) -> Floats:
        """y (2,) of the lower and upper edge of the stripe that is most like the others' paint beside a height: down to half of it."""
        rows = self._rows((left, right), self._table_at(centre))
        beside = np.abs(self.y - centre) < BESIDE * self.thickness
        best = int(np.where(beside, rows, -1.0).argmax())
        below = np.flatnonzero(rows < rows[best] / 2)
        first, last = below[below < best].max(initial=-1) + 1, below[below > best].min(initial=len(rows)) - 1
        return np.array([self.y[last] - self.cell / 2, self.y[first] + self.cell / 2])

    def _table_at(self, centre: float) -> Table:
        """The probabilities by the paint of the storeys that a height is not one of."""
        near = int(np.abs(self.centres - centre).argmin())
        own = abs(self.centres[near] - centre) < SAME * self.thickness
        return self.tables[self.storeys[near] if own else EVERY]

    def _rows(self, span: Span, table: Table, where: Floats | None = None) -> Floats:
        """The mean probability (rows,) of beams' paint between two posts, over half a beam's thickness."""
        columns = (self.x > span[0]) & (self.x < span[1])
        seen = self.seen[:, columns] * (np.ones(len(self.x)) if where is None else where)[columns]
        likely = table[tuple(np.moveaxis(self.colour[:, columns], -1, 0))] * seen
        mean = likely.sum(axis=1) / np.maximum(seen.sum(axis=1), 1e-6)
        return np.asarray(uniform_filter1d(mean, max(1, round(self.thickness / 2 / self.cell))))

    def _counted(self, span: Span, centre: float, reach: float) -> Table:
        """How often colours appear between two posts within `reach` of a height."""
        rows = np.abs(self.y - centre) < max(reach, self.cell)
        cells: Bools = rows[:, None] & (self.x > span[0]) & (self.x < span[1]) & self.seen
        counts = np.zeros((BINS,) * 3)
        np.add.at(counts, tuple(np.moveaxis(self.colour[cells], -1, 0)), 1.0)
        return np.asarray(gaussian_filter(counts, 1.0))


def _density(counts: Table) -> Table:
    return np.asarray(counts / max(float(counts.sum()), 1.0))


def _storeys(centres: Floats, apart: float) -> NDArray[np.int64]:
    """Numbers (k,) of the storeys that heights belong to, where a gap wider than `apart` parts storeys."""
    order = np.argsort(centres)
    numbers = np.cumsum(np.diff(centres[order], prepend=centres[order[0]]) > apart)
    return np.asarray(numbers[np.argsort(order)])
