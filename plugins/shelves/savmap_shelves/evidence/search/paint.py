"""Paint: the probability that a colour is that of the tracked beams, and not that of the rest of the face.

A network knows racks in general. The pictures of a row show the paint of this rack. Two histograms of colour are counted in the orthophoto:
of the levels that were tracked, and of the whole face between the posts. A level is compared with the other storeys only. An object that was
wrongly tracked as a beam often runs through the whole row, and would confirm itself.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter1d

from savmap.types import Bools, Floats, PlaneEvidence
from savmap_shelves.evidence.face_grid import Grid, Span
from savmap_shelves.evidence.search.strength import across_of, heights_of

BIN, BINS = 8, 32
"""The step of the histograms in each coordinate of the colour (L*a*b*, 0 to 255), and their number."""
CORE = 0.6
"""The share of a level's height, in its middle, that is surely of it."""
SAME_STOREY = 1.5
"""Levels farther apart than so many thicknesses are of different storeys."""
LEAST_STOREYS, LEAST_DIFFERENCE = 2, 0.5
"""Paint is informative where more storeys than that were tracked, and the probability of beams' paint differs so much between beams and the face."""
ALL_STOREYS = -1
LEAST_DENSITY = 1e-7
"""Colours rarer than that are nobody's paint."""

Table = NDArray[np.float64]


class Paint:
    """The paint of a face's beams, by the levels that were tracked."""

    def __init__(self, evidence: PlaneEvidence, grid: Grid) -> None:
        patch = evidence.patch
        self.x, self.y = across_of(evidence), heights_of(evidence)
        self.colour = np.asarray(cv2.cvtColor(np.ascontiguousarray(evidence.picture), cv2.COLOR_RGB2LAB) // BIN)
        self.visible, self.thickness, self.cell = evidence.weight > 0, grid.thickness, patch.cell
        spans, levels = grid.spans, np.concatenate(grid.sections)
        owners = [spans[k] for k, section in enumerate(grid.sections) for _ in section]
        self.centres = levels.mean(axis=1)
        self.storeys = _storeys(self.centres, SAME_STOREY * grid.thickness)
        self.tables = self._tables(levels, owners, spans)
        middle, half = (levels.min() + levels.max()) / 2, float(np.ptp(levels)) / 2
        probabilities = [
            self.beam_probability(*span, centre) for span, centre in zip(owners, self.centres.tolist(), strict=True)
        ]
        rows = [self._rows(span, self.tables[ALL_STOREYS])[np.abs(self.y - middle) < half] for span in spans]
        self.usual_probability = float(np.median(probabilities))
        self.face_probability = float(np.median(np.concatenate(rows)))

    def _tables(self, levels: Floats, owners: Sequence[Span], spans: Sequence[Span]) -> list[Table]:
        """Tables of the probability, by colour, that it is the paint of beams: one table without each storey, and a last one of all storeys."""
        count = int(self.storeys.max()) + 1
        painted = np.zeros((count, *(BINS,) * 3))
        for level, storey, span in zip(levels, self.storeys, owners, strict=True):
            painted[storey] += self._counted(span, level.mean(), CORE / 2 * float(np.ptp(level)))
        middle, half = (levels.min() + levels.max()) / 2, float(np.ptp(levels)) / 2
        anything = _density(np.sum([self._counted(span, middle, half) for span in spans], axis=0))
        beams = np.array([_density(counts) for counts in painted])
        without = [np.delete(beams, storey, axis=0).sum(axis=0) / max(count - 1, 1) for storey in range(count)]
        return [mean / (mean + anything + LEAST_DENSITY) for mean in (*without, beams.mean(axis=0))]

    @property
    def is_informative(self) -> bool:
        """Whether the paint of beams differs from the rest of the face, in `LEAST_STOREYS` storeys or more."""
        return len(self.tables) > LEAST_STOREYS and self.usual_probability - self.face_probability > LEAST_DIFFERENCE

    def similarity(
        self, left: float, right: float, centre: float, column_weights: Floats | None = None, reach: float | None = None
    ) -> float:
        """The similarity of the paint at a height between two posts to that of the beams: about 1 for a beam, 0 for the rest of the face.
        column_weights (columns,): equal if not given. reach: how far from that height; a beam's thickness if not given."""
        probability = self.beam_probability(left, right, centre, column_weights, reach)
        return (probability - self.face_probability) / (self.usual_probability - self.face_probability)

    def beam_probability(
        self, left: float, right: float, centre: float, column_weights: Floats | None = None, reach: float | None = None
    ) -> float:
        """The greatest mean probability of beams' paint in the rows around a height, by the paint of the other storeys."""
        rows = self._rows((left, right), self._table_at(centre), column_weights)
        return float(rows[self._around(centre, reach)].max(initial=0.0))

    def extent(self, left: float, right: float, centre: float, reach: float | None = None) -> Floats:
        """y (2,) of the edges of the stripe of beams' paint around a height: where the probability falls to half of its maximum."""
        rows = self._rows((left, right), self._table_at(centre))
        best = int(np.where(self._around(centre, reach), rows, -1.0).argmax())
        below = np.flatnonzero(rows < rows[best] / 2)
        first, last = below[below < best].max(initial=-1) + 1, below[below > best].min(initial=len(rows)) - 1
        return np.array([self.y[last] - self.cell / 2, self.y[first] + self.cell / 2])

    def _around(self, centre: float, reach: float | None) -> Bools:
        """The rows within `reach` of a height, or a beam's thickness."""
        return np.asarray(np.abs(self.y - centre) < (self.thickness if reach is None else reach))

    def _table_at(self, centre: float) -> Table:
        """The probabilities by the paint of all storeys but that which a height is in."""
        near = int(np.abs(self.centres - centre).argmin())
        in_storey = abs(self.centres[near] - centre) < SAME_STOREY * self.thickness
        return self.tables[self.storeys[near] if in_storey else ALL_STOREYS]

    def _rows(self, span: Span, table: Table, column_weights: Floats | None = None) -> Floats:
        """The mean probability (rows,) of beams' paint between two posts, over half a beam's thickness."""
        columns = (self.x > span[0]) & (self.x < span[1])
        weights = np.ones(len(self.x)) if column_weights is None else column_weights
        weights = self.visible[:, columns] * weights[columns]
        probability = table[tuple(np.moveaxis(self.colour[:, columns], -1, 0))] * weights
        mean = probability.sum(axis=1) / np.maximum(weights.sum(axis=1), 1e-6)
        return np.asarray(uniform_filter1d(mean, max(1, round(self.thickness / 2 / self.cell))))

    def _counted(self, span: Span, centre: float, reach: float) -> Table:
        """The smoothed histogram of colours between two posts, within `reach` of a height."""
        rows = np.abs(self.y - centre) < max(reach, self.cell)
        cells: Bools = rows[:, None] & (self.x > span[0]) & (self.x < span[1]) & self.visible
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
