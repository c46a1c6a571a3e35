"""Evidence of a face as the networks' mean scores would show it: posts, beams, and what a test adds or hides."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from savmap.types import Floats, PlaneEvidence, PlanePatch

DISTANCE, HEIGHT = 1.5, 1.7
"""The camera's, m, from the face and above the patch's lower side."""
CELL = 0.0125 * DISTANCE
POSTS = ((0.6, 0.7), (3.3, 3.4), (6.0, 6.1), (8.7, 8.8))
LEVELS = ((0.4, 0.52), (1.9, 2.02), (3.4, 3.52))
PATCH = PlanePatch("face", np.zeros(3), np.eye(3)[0], np.eye(3)[1], np.array([9.4, 4.4]), CELL)
FAINT, PAINTED = 0.01, (200, 90, 30)
Band = tuple[float, float]


@dataclass
class PaintedFace:
    """Scores of both classes and the colours of the cells of a patch; heights of posts 0.2 to 4 m. Borders are where the scores fall to half."""

    posts: tuple[Band, ...] = POSTS
    sections: tuple[tuple[Band, ...], ...] = (LEVELS,) * 3
    patch: PlanePatch = PATCH
    score: float = 0.9
    maps: Floats = field(init=False)
    colours: Floats = field(init=False)

    def __post_init__(self) -> None:
        self.maps = np.full((2, *self.patch.shape), FAINT)
        self.colours = np.full((*self.patch.shape, 3), 120.0)
        for post in self.posts:
            self.draw("upright", post, (0.2, 4.0), self.score)
        for (left, right), levels in zip(pairwise(self.posts), self.sections, strict=True):
            for level in levels:
                self.draw("beam", (left[1], right[0]), level, self.score)

    def draw(
        self, label: str, x: Band, y: Band, score: float, colour: tuple[int, int, int] | None = None
    ) -> "PaintedFace":
        """What covers a cell in part counts for its part of it."""
        along = _covered(self.patch.origin[0] + self.patch.across, x)
        up = _covered(self.patch.origin[1] + self.patch.heights, y)
        share = up[:, None] * along
        own = self.maps[("upright", "beam").index(label)]
        own[:] = own + share * (score - own)
        if colour is not None:
            self.colours += share[..., None] * (np.array(colour) - self.colours)
        return self

    def evidence(self) -> PlaneEvidence:
        weight = np.ones(self.patch.shape, np.float32)
        picture = np.round(self.colours).astype(np.uint8)
        return PlaneEvidence(self.patch, ("upright", "beam"), self.maps.astype(np.float32), weight, picture, weight)


def _covered(middles: Floats, band: Band) -> Floats:
    """The share of each cell that lies in a band."""
    low, high = np.maximum(middles - CELL / 2, band[0]), np.minimum(middles + CELL / 2, band[1])
    return np.clip((high - low) / CELL, 0.0, 1.0)
