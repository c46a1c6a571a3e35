"""Levels that show in pieces between goods, found by their colour profile from top to bottom.

A network may miss a beam of which goods leave only a few short pieces visible. In the orthophoto, each column of such a piece has the profile of
the bay's next beams: the edge of the deck, the face, and the shadow beneath, in this order and these colours. Other objects do not have it
at one height at several places.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from savmap.types import Bools, Floats, Ints, PlaneEvidence
from savmap_shelves.evidence.face_grid import Grid, Span
from savmap_shelves.evidence.search.strength import across_of, heights_of

REACH = 0.8
"""Half the height of a profile, in thicknesses of a beam."""
SEEN, LEAST_COLUMNS = 0.5, 10
CORRELATED, LEAST_CONTRAST, MOST_CONTRAST, COLOUR, BRIGHTNESS = 0.75, 0.5, 2.0, 6.0, 35.0
"""A column matches a profile if its brightness correlates with it, has half to twice its contrast, and its colours and mean brightness are
as near."""
LEAST_SHARE, LEAST_PIECES, ALONE = 0.12, 2, 0.5
"""Least share of the columns between two posts that match; least number of pieces; the greatest share at any other height, relative to it."""


class Pieces:
    """The colours of a face."""

    def __init__(self, evidence: PlaneEvidence, grid: Grid) -> None:
        patch = evidence.patch
        self.x, self.y = across_of(evidence), heights_of(evidence)
        self.colour = cv2.cvtColor(np.ascontiguousarray(evidence.picture), cv2.COLOR_RGB2LAB).astype(np.float64)
        self.beam, self.known = evidence.of("beam"), evidence.weight > 0
        self.thickness, self.rows = grid.thickness, max(2, round(REACH * grid.thickness / patch.cell))

    def level_between(self, span: Span, below: Floats, above: Floats, room: float) -> Floats | None:
        """y (2,) of a level that shows in pieces between two posts, between levels `below` and `above` (2,), and farther than `room` from both. None
        where there is none."""
        margin = min(self.thickness, 0.1 * (span[1] - span[0]))
        columns = np.flatnonzero((self.x > span[0] + margin) & (self.x < span[1] - margin))
        profiles = [profile for level in (below, above) if (profile := self._profile(columns, level)) is not None]
        heights = np.flatnonzero((self.y > below.mean() + room) & (self.y < above.mean() - room))
        if not profiles or not len(heights):
            return None
        matching = np.array([self._matching_columns(columns, row, profiles) for row in heights.tolist()])
        share, y = matching.mean(axis=1), self.y[heights]
        best = int(share.argmax())
        if share[best] < LEAST_SHARE or self._count(matching[best]) < LEAST_PIECES:
            return None
        centre = float(np.average(y, weights=share * (np.abs(y - y[best]) < self.thickness)))
        if share[np.abs(y - centre) > self.thickness].max(initial=0.0) > ALONE * share[best]:
            return None
        return centre + self.thickness * np.array([-0.5, 0.5])

    def _profile(self, columns: Ints, level: Floats) -> Floats | None:
        """The median colours (rows, 3) around a level, from the top, over the columns in which the network sees it. None where these are too few."""
        row = int(np.abs(self.y - level.mean()).argmin())
        strip, visible = self._strip(columns, row), self.beam[row, columns] > SEEN
        return np.median(strip[:, visible], axis=1) if strip is not None and visible.sum() > LEAST_COLUMNS else None

    def _strip(self, columns: Ints, row: int) -> Floats:
        """The colours (rows, columns, 3) around a row. The border row is repeated beyond the picture."""
        rows = np.clip(np.arange(row - self.rows, row + self.rows + 1), 0, len(self.y) - 1)
        return np.asarray(self.colour[rows][:, columns])

    def _matching_columns(self, columns: Ints, row: int, profiles: Sequence[Floats]) -> Bools:
        """Whether each column (n,) has one of the profiles around a row."""
        strip = self._strip(columns, row)
        matching = np.any([_matches(strip, profile) for profile in profiles], axis=0)
        return np.asarray(matching & self.known[row, columns])

    def _count(self, matching: Bools) -> int:
        """The number of runs of matching columns (n,) that are at least `REACH / 2` of a beam's thickness long."""
        least = self.rows / 2
        edges = np.flatnonzero(np.diff(np.concatenate([[False], matching, [False]]).astype(np.int8)))
        return int((edges[1::2] - edges[::2] >= least).sum())


def _matches(strip: Floats, profile: Floats) -> Bools:
    """Whether each column (n,) of a strip (rows, n, 3) has a profile (rows, 3)."""
    light, profile_light = strip[..., 0] - strip[..., 0].mean(axis=0), profile[:, 0] - profile[:, 0].mean()
    size, usual = np.linalg.norm(light, axis=0), float(np.linalg.norm(profile_light))
    correlated = (light * profile_light[:, None]).sum(axis=0) > CORRELATED * size * usual
    contrast = (size > LEAST_CONTRAST * usual) & (size < MOST_CONTRAST * usual)
    colour = np.abs(strip[..., 1:] - profile[:, None, 1:]).mean(axis=(0, 2)) < COLOUR
    bright = np.abs(strip[..., 0].mean(axis=0) - profile[:, 0].mean()) < BRIGHTNESS
    return np.asarray(correlated & contrast & colour & bright)
