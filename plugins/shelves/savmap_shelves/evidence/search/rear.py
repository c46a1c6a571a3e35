"""The rack's rear face, seen through the front one: the heights at which its beams appear in the evidence of the front face.

The camera drives along the row at one height and distance. A beam that lies deeper appears nearer to the camera's own height, by the same share
for all levels. Rear beams have the heights and the paint of the front ones, and parallax does not smear them: they are level and parallel to the
camera's path.
"""

from collections.abc import Sequence

import numpy as np

from savmap.types import Floats, PlaneEvidence
from savmap_shelves.evidence.search.strength import heights_of

SHARES = np.arange(0.4, 0.9, 0.01)
"""The shares that are tried, of a front beam's height over the camera at which its rear one appears."""
SHOWN, LEAST_SHARE, LEAST_HEIGHTS = 0.25, 0.4, 3
"""A rear beam shows where the cover is more than the first. The face is there if more than the second, a share of all, show, at so many heights."""
NEAR = 1.5
"""What is nearer to a front beam, in thicknesses, is hidden by it."""
POSSIBLE = (0.45, 0.7)
"""The range of the share for a camera 1 to 2.5 m in front of a rack 1.0 to 1.2 m deep."""


class RearFace:
    """The rear face, by the covers (rows,) of levels in each bay and the levels (k, 2) tracked there. `share`: that of the heights, None where
    no rear face shows."""

    def __init__(
        self, evidence: PlaneEvidence, covers: Sequence[Floats], sections: Sequence[Floats], size: float
    ) -> None:
        self.y, self.size = heights_of(evidence), size
        self.height = float(self.y[evidence.weight.sum(axis=1).argmax()])
        rear_levels = [self._rear_levels(share, covers, sections) for share in SHARES]
        best = int(np.argmax([cover.mean() if len(cover) else 0.0 for _, cover in rear_levels]))
        self.share = float(SHARES[best]) if self._is_face(*rear_levels[best]) else None

    def shows(self, levels: Floats, centre: float) -> bool:
        """Whether the rear one of a bay's levels appears at a height."""
        if self.share is None or not len(levels):
            return False
        return bool(np.abs(self._places(levels, self.share) - centre).min() < self.size)

    def may_show(self, levels: Floats, centre: float) -> bool:
        """As `shows`; where no rear face was found, whether any share in `POSSIBLE` puts a rear level at the height."""
        if self.share is not None or not len(levels):
            return self.shows(levels, centre)
        low, high = np.sort([self._places(levels, share) for share in POSSIBLE], axis=0)
        return bool(((centre > low - self.size / 2) & (centre < high + self.size / 2)).any())

    def _places(self, levels: Floats, share: float) -> Floats:
        """The heights (k,) at which the rear counterparts of levels (k, 2) appear."""
        return np.asarray(self.height + share * (levels.mean(axis=1) - self.height))

    def _rear_levels(self, share: float, covers: Sequence[Floats], sections: Sequence[Floats]) -> tuple[Floats, Floats]:
        """The heights (k,) of rear beams that no front beam hides, and the covers there (k,)."""
        samples: list[tuple[float, float]] = []
        for cover, levels in zip(covers, sections, strict=True):
            for place in self._places(levels, share).tolist():
                if np.abs(levels.mean(axis=1) - place).min() > NEAR * self.size:
                    samples.append((place, float(cover[np.abs(self.y - place).argmin()])))
        places, cover = np.array(samples).reshape(-1, 2).T
        return places, cover

    def _is_face(self, places: Floats, cover: Floats) -> bool:
        """Whether many of the heights have cover, in several storeys: a single storey also continues through all bays."""
        shown = np.sort(places[cover > SHOWN])
        heights = 1 + int((np.diff(shown) > NEAR * self.size).sum()) if len(shown) else 0
        return heights >= LEAST_HEIGHTS and len(shown) > LEAST_SHARE * len(places)
