"""A face as all frames show it: the evidence, what was tracked on it, and what both say of its floor, its posts' reach, and its paint."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from savmap.types import Bools, Floats, PlaneEvidence
from savmap_shelves.evidence.face_grid import Grid, Span
from savmap_shelves.evidence.search.covers import cover_of, greatest, peaks, standing_out
from savmap_shelves.evidence.search.overhead import POST_SHOWN, POSTS_TOP, overhead_levels, without_overhead
from savmap_shelves.evidence.search.paint import Paint
from savmap_shelves.evidence.search.pieces import Pieces
from savmap_shelves.evidence.search.rear import RearFace
from savmap_shelves.evidence.search.settings import EvidenceSettings
from savmap_shelves.evidence.search.strength import across_of, heights_of, level_strength, post_heights, seen_mean

BODY = (0.12, 0.92)
"""The rows between the lowest and the highest beams that tell of posts, as shares."""
NEITHER = 0.8
"""The similarity of any paint where paint does not tell."""


class Face:
    """A face's evidence and the grid `tracked` on it, without what runs overhead. `x` (columns,), `y` (rows,): places of its cells."""

    def __init__(
        self, evidence: PlaneEvidence, grid: Grid, settings: EvidenceSettings, floor: float | None = None
    ) -> None:
        self.evidence, self.tracked, self.settings, self.cell = evidence, grid, settings, evidence.patch.cell
        self.measured_floor = floor
        self.x, self.y = across_of(evidence), heights_of(evidence)
        self.upright, self.beam, self.weight = evidence.of("upright"), evidence.of("beam"), evidence.weight
        self.usual_post = self._usual([self._post_strength(*post) for post in grid.posts])
        strengths = [
            self.level_strength(span, *level)
            for span, levels in zip(grid.spans, grid.sections, strict=True)
            for level in levels
        ]
        self.usual_level = self._usual(strengths)
        self.overhead = overhead_levels(evidence, grid, self.usual_level, self.usual_post)
        self.tracked = without_overhead(grid, self.overhead)

    @cached_property
    def pieces(self) -> Pieces:
        """The colours of the face, with the tracked grid."""
        return Pieces(self.evidence, self.tracked)

    @cached_property
    def paint(self) -> Paint:
        """The paint of the tracked beams."""
        return Paint(self.evidence, self.tracked)

    @cached_property
    def rear(self) -> RearFace:
        """Where the rear face's beams appear."""
        return RearFace(self.evidence, self.covers, self.tracked.sections, self.tracked.thickness)

    @cached_property
    def feet(self) -> float:
        """y of the posts' feet. A quantile, because a guard hides some feet."""
        return float(np.quantile([self._reach(*post)[0] for post in self.tracked.posts], 0.25, method="lower"))

    @property
    def floor(self) -> float:
        """y of the floor: goods and markings below may look like a level. Guards may hide all feet."""
        return self.feet if self.measured_floor is None else min(self.feet, self.measured_floor)

    @cached_property
    def ceiling(self) -> float:
        """y of the posts' tops: what lies above is of the roof. A quantile, because goods hide some tops."""
        return float(np.quantile([self._reach(*post)[1] for post in self.tracked.posts], POSTS_TOP))

    @cached_property
    def lowest(self) -> list[float]:
        """y of the lowest level of each tracked bay, inf for one without any. Where guards hide the feet, what shows between these and the floor is one."""
        found = [float(levels.mean(axis=1).min()) if len(levels) else np.inf for levels in self.tracked.sections]
        hidden = (self.y > self.floor + self.tracked.thickness) & (self.y < self.feet)
        for section, cover in enumerate(self.covers):
            places = [float(self.y[row]) for row in peaks(cover, self.settings.partly) if hidden[row]]
            found[section] = min([found[section], *places])
        return found

    @cached_property
    def covers(self) -> list[Floats]:
        """The covers (rows,) of levels in the tracked bays."""
        return [self.level_cover(span) for span in self.tracked.spans]

    def post_cover(self) -> Floats:
        """The cover (columns,) of a post at each column."""
        rows, width = self._body(), self.tracked.width / self.cell
        return cover_of(
            self.upright[rows].T, self.weight[rows].T, width, self.tracked.bay / self.cell, self._limit(self.usual_post)
        )

    def level_cover(self, span: Span) -> Floats:
        """The cover (rows,) of a level at each row between two posts."""
        columns, thickness = self._inside(span), self.tracked.thickness / self.cell
        return cover_of(
            self.beam[:, columns], self.weight[:, columns], thickness, 8 * thickness, self._limit(self.usual_level)
        )

    def level_strength(self, span: Span, low: float, high: float) -> float:
        """The greatest mean evidence of a beam between two posts, of the rows from `low` to `high` and a little beside."""
        room = self.tracked.thickness / 4
        return level_strength(self.evidence, self._inside(span), low - room, high + room)

    def similarity(self, span: Span, centre: float) -> float:
        """The similarity of the paint at a height between two posts to the tracked beams'; `NEITHER` where paint is not informative."""
        return self.paint.similarity(*span, centre) if self.paint.is_informative else NEITHER

    def usual_similarity(self, centre: float) -> float:
        """The median over the bays of the similarity of the paint at a height to the tracked beams'."""
        return float(np.median([self.similarity(span, centre) for span in self.tracked.spans]))

    def storey_similarity(self, span: Span, level: Floats) -> float:
        """The similarity of a level's paint where it shows: the greater of that in its own bay and the median of the bays with a tracked
        level at its height. Goods may shade a level in one bay."""
        centre, thickness = float(level.mean()), self.tracked.thickness
        similarities = [
            self._shown_similarity(other, level)
            for other, levels in zip(self.tracked.spans, self.tracked.sections, strict=True)
            if len(levels) and np.abs(levels.mean(axis=1) - centre).min() < thickness
        ]
        return max(self._shown_similarity(span, level), float(np.median(similarities)))

    def usual_cover(self, centre: float) -> float:
        """The upper median over the tracked bays of the cover at a height: levels often continue from bay to bay."""
        around = centre + self.tracked.thickness * np.array([[-0.5, 0.5]])
        return float(np.quantile([greatest(cover, self.y, around)[0] for cover in self.covers], 0.5, method="higher"))

    def _shown_similarity(self, span: Span, level: Floats) -> float:
        """As `similarity`, over the columns that show a level between two posts."""
        if not self.paint.is_informative:
            return NEITHER
        return self.paint.similarity(*span, float(level.mean()), self._shown(span, level))

    def _shown(self, span: Span, level: Floats) -> Floats:
        """The weight (columns,), from 0 to 1, of the columns that show a level between two posts. Goods, with a paint of their own, hide the others."""
        columns, thickness = self._inside(span), self.tracked.thickness / self.cell
        excess = standing_out(
            self.beam[:, columns], self.weight[:, columns], thickness, 8 * thickness, self._limit(self.usual_level)
        )
        where = np.zeros(len(self.x))
        where[columns] = excess[(self.y > level[0]) & (self.y < level[1])].max(axis=0, initial=0.0)
        return where

    def _limit(self, usual: float) -> float:
        """What the evidence must stand out by."""
        return max(self.settings.clear * usual, self.settings.faint)

    def _reach(self, low: float, high: float) -> tuple[float, float]:
        """Lowest and highest y at which a post shows. The highest is at least the top of the tracked levels."""
        shown = post_heights(self.evidence, np.array([low, high]), POST_SHOWN * self.usual_post)
        return float(shown.min(initial=self.tracked.top)), float(shown.max(initial=self.tracked.top))

    def _usual(self, strengths: Sequence[float]) -> float:
        return max(float(np.median(strengths)), self.settings.faint)

    def _post_strength(self, low: float, high: float) -> float:
        rows, columns = self._body(), (self.x > low) & (self.x < high)
        return float(seen_mean(self.upright[rows], self.weight[rows], 0)[columns].max(initial=0.0))

    def _body(self) -> Bools:
        """The rows between the lowest and the highest beams."""
        bottom = min(float(levels.min()) for levels in self.tracked.sections if len(levels))
        low, high = bottom + np.array(BODY) * (self.tracked.top - bottom)
        return np.asarray((self.y > low) & (self.y < high))

    def _inside(self, span: Span) -> Bools:
        """The columns between two posts, without a margin beside them."""
        left, right = span
        margin = min(self.tracked.width, 0.1 * (right - left))
        return np.asarray((self.x > left + margin) & (self.x < right - margin))
