"""The rack's rear face, seen through the front one: where its beams appear on the front face, in which they do not lie.

From a camera that drives along the row at one height and distance, what lies deeper appears nearer to the camera's own height, by the same share for
all levels. Rear beams stand as high as the front ones and are painted like them: parallax does not smear what is level and goes the way
the camera goes.
"""

from collections.abc import Sequence

import numpy as np

from savmap.types import Floats, PlaneEvidence

SHARES = np.arange(0.4, 0.9, 0.01)
SHOWN, LEAST_SHARE, LEAST_HEIGHTS = 0.25, 0.4, 3
NEAR = 1.5
POSSIBLE = (0.45, 0.7)
"""From a camera 1 to 2.5 m before a rack 1.0 to 1.2 m deep, levels of the rear face appear at so much of their way from the camera's height."""


class RearFace:
    """Where the rear face's beams appear, by the covers (rows,) of levels in each section and the levels (k, 2) that were tracked there."""

    def __init__(
        self, evidence: PlaneEvidence, covers: Sequence[Floats], sections: Sequence[Floats], size: float
    ) -> None:
        self.y, self.size = evidence.patch.origin[1] + evidence.patch.heights, size
        self.height = float(self.y[evidence.weight.sum(axis=1).argmax()])
        found = [self._found(share, covers, sections) for share in SHARES]
        best = int(np.argmax([cover.mean() if len(cover) else 0.0 for _, cover in found]))
        self.share = float(SHARES[best]) if self._is_face(*found[best]) else None

    def shows(self, levels: Floats, centre: float) -> bool:
        """Whether the rear one of a section's levels appears at a height."""
        if self.share is None or not len(levels):
            return False
        return bool(np.abs(self._places(levels, self.share) - centre).min() < self.size)

    def may_show(self, levels: Floats, centre: float) -> bool:
        """Whether the rear one of a section's levels appears at a height, or could, where it is not known where the rear face appears."""
        if self.share is not None or not len(levels):
            return self.shows(levels, centre)
        low, high = np.sort([self._places(levels, share) for share in POSSIBLE], axis=0)
        return bool(((centre > low - self.size / 2) & (centre < high + self.size / 2)).any())

    def _places(self, levels: Floats, share: float) -> Floats:
        """The heights (k,) at which the rear ones of levels (k, 2) appear: a cell weighs most at the camera's own height."""
        return np.asarray(self.height + share * (levels.mean(axis=1) - self.height))

    def _found(self, share: float, covers: Sequence[Floats], sections: Sequence[Floats]) -> tuple[Floats, Floats]:
        """Rear beams' places (k,), but for those that front beams hide, and the covers there (k,)."""
        found: list[tuple[float, float]] = []
        for cover, levels in zip(covers, sections, strict=True):
            for place in self._places(levels, share).tolist():
                if np.abs(levels.mean(axis=1) - place).min() > NEAR * self.size:
                    found.append((place, float(cover[np.abs(self.y - place).argmin()])))
        places, cover = np.array(found).reshape(-1, 2).T
        return places, cover

    def _is_face(self, places: Floats, cover: Floats) -> bool:
        """Whether many of the places show something, at several heights: a single storey goes through all sections, too."""
        shown = np.sort(places[cover > SHOWN])
        heights = 1 + int((np.diff(shown) > NEAR * self.size).sum()) if len(shown) else 0
        return heights >= LEAST_HEIGHTS and len(shown) > LEAST_SHARE * len(places)
