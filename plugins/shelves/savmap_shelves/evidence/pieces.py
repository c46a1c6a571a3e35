"""Levels that show in pieces between goods: stripes along a face whose colours change from bottom to top as those of the next beams do.

A network may see nothing of a beam of which goods leave a few short pieces. In the orthophoto each column of such a piece still has what the next beams
of the section have: the edge of the deck, the face, the shadow beneath, in this order and these colours. Nothing else has that at one height at
several places.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from savmap.types import Bools, Floats, Ints, PlaneEvidence
from savmap_shelves.evidence.face_grid import Grid

REACH = 0.8
"""A profile reaches so many thicknesses up and down from a beam's middle."""
SEEN, LEAST_COLUMNS = 0.5, 10
CORRELATED, LEAST_CONTRAST, MOST_CONTRAST, COLOUR, BRIGHTNESS = 0.75, 0.5, 2.0, 6.0, 35.0
"""A column is like a profile where its brightness goes up and down alike, by half to twice as much, and colours and brightness are as near."""
LEAST_SHARE, LEAST_PIECES, ALONE = 0.12, 2, 0.5
"""Of the columns between two posts so many are like one, in so many pieces, and at any other height at most half as many."""


class Pieces:
    """The colours of a face."""

    def __init__(self, evidence: PlaneEvidence, grid: Grid) -> None:
        patch = evidence.patch
        self.x, self.y = patch.origin[0] + patch.across, patch.origin[1] + patch.heights
        self.colour = cv2.cvtColor(np.ascontiguousarray(evidence.picture), cv2.COLOR_RGB2LAB).astype(np.float64)
        self.beam, self.known = evidence.of("beam"), evidence.weight > 0
        self.thickness, self.rows = grid.thickness, max(2, round(REACH * grid.thickness / patch.cell))

    def level_between(self, span: tuple[float, float], below: Floats, above: Floats, room: float) -> Floats | None:
        """y (2,) of a level that shows in pieces between two posts and two others (2,), further than `room` from these; None where none does."""
        margin = min(self.thickness, 0.1 * (span[1] - span[0]))
        columns = np.flatnonzero((self.x > span[0] + margin) & (self.x < span[1] - margin))
        profiles = [profile for level in (below, above) if (profile := self._profile(columns, level)) is not None]
        heights = np.flatnonzero((self.y > below.mean() + room) & (self.y < above.mean() - room))
        if not profiles or not len(heights):
            return None
        like = np.array([self._like(columns, row, profiles) for row in heights.tolist()])
        share, y = like.mean(axis=1), self.y[heights]
        best = int(share.argmax())
        if share[best] < LEAST_SHARE or self._count(like[best]) < LEAST_PIECES:
            return None
        centre = float(np.average(y, weights=share * (np.abs(y - y[best]) < self.thickness)))
        if share[np.abs(y - centre) > self.thickness].max(initial=0.0) > ALONE * share[best]:
            return None
        return centre + self.thickness * np.array([-0.5, 0.5])

    def _profile(self, columns: Ints, level: Floats) -> Floats | None:
        """The usual colours (rows, 3) of a level and what is beside it, from the top, where the network sees it; None where it hardly does."""
        row = int(np.abs(self.y - level.mean()).argmin())
        strip, seen = self._strip(columns, row), self.beam[row, columns] > SEEN
        return np.median(strip[:, seen], axis=1) if strip is not None and seen.sum() > LEAST_COLUMNS else None

    def _strip(self, columns: Ints, row: int) -> Floats:
        """The colours (rows, columns, 3) around a row; those of the border go on beyond it."""
        rows = np.clip(np.arange(row - self.rows, row + self.rows + 1), 0, len(self.y) - 1)
        return np.asarray(self.colour[rows][:, columns])

    def _like(self, columns: Ints, row: int, profiles: Sequence[Floats]) -> Bools:
        """Which columns (n,) have one of the profiles around a row."""
        strip = self._strip(columns, row)
        like = np.any([_alike(strip, profile) for profile in profiles], axis=0)
        return np.asarray(like & self.known[row, columns])

    def _count(self, like: Bools) -> int:
        """How many pieces (n,) are, not much shorter than a beam is thick."""
        least = self.rows / 2
        edges = np.flatnonzero(np.diff(np.concatenate([[False], like, [False]]).astype(np.int8)))
        return int((edges[1::2] - edges[::2] >= least).sum())


def _alike(strip: Floats, profile: Floats) -> Bools:
    """Which columns (n,) of a strip (rows, n, 3) have a profile (rows, 3)."""
    light, own = strip[..., 0] - strip[..., 0].mean(axis=0), profile[:, 0] - profile[:, 0].mean()
    size, usual = np.linalg.norm(light, axis=0), float(np.linalg.norm(own))
    together = (light * own[:, None]).sum(axis=0) > CORRELATED * size * usual
    contrast = (size > LEAST_CONTRAST * usual) & (size < MOST_CONTRAST * usual)
    colour = np.abs(strip[..., 1:] - profile[:, None, 1:]).mean(axis=(0, 2)) < COLOUR
    bright = np.abs(strip[..., 0].mean(axis=0) - profile[:, 0].mean()) < BRIGHTNESS
    return np.asarray(together & contrast & colour & bright)
