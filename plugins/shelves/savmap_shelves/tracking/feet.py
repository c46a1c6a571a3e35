"""Where uprights stand: their feet on the face plane, and the floor that no beam lies below.

The floor gives a map its scale when no beam's height is known. A foot can be hidden by a guard or by goods, but never be
below the floor: uprights whose feet seem clearly higher than the lowest one's are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.types import Feature, Floats, Ints, Track
from savmap_shelves.tracking.sightings import FaceSightings, Tangents, feature_points, tangents

PART = "foot"
LEAST_SIGHTINGS = 3
HIDDEN = 0.02
STRAY = 0.02


@dataclass(frozen=True, eq=False)
class Feet:
    """Sighted feet (m,) of uprights: their features and frames, and their tangents on the face."""

    features: tuple[Feature, ...]
    frame: Ints
    face: Tangents

    def on_face(self, states: Floats, uprights: Floats) -> tuple[Ints, Floats]:
        """Which of the uprights, by x (k, 2), each is of (m,), -1 for none; its y (m,), tilts left aside."""
        state = states[self.frame]
        x, y = (self.face.p + state[:, 1]) / state[:, 0], (self.face.q + state[:, 2]) / state[:, 0]
        return _nearest(x, uprights), y

    def usual(self, states: Floats, uprights: Floats) -> Floats:
        """The usual height (k,) of each upright's foot, inf where it was hardly sighted."""
        upright, y = self.on_face(states, uprights)
        heights = [y[(upright == k) & np.isfinite(y)] for k in range(len(uprights))]
        return np.array([np.median(values) if len(values) >= LEAST_SIGHTINGS else np.inf for values in heights])

    def floor(self, states: Floats, uprights: Floats) -> float:
        """The least height that a beam should have: the lowest foot's less what feet differ by, for goods and guards hide
        them. -inf where fewer than two feet are known."""
        usual = self.usual(states, uprights)
        known = usual[np.isfinite(usual)]
        return float(known.min() - np.ptp(known)) if len(known) >= 2 else -np.inf

    def tracks(self, states: Floats, uprights: Floats, levels: Floats) -> list[Track]:
        """Tracks "upright k / foot" of the uprights whose feet were sighted on the floor in three frames or more.

        levels (n, 2): y of the beams' edges, which say how high the rack is.
        """
        upright, y = self.on_face(states, uprights)
        usual = np.append(self.usual(states, uprights), np.inf)
        if not np.isfinite(usual).any():
            return []
        height = float(np.ptp(np.concatenate([levels.ravel(), y[np.isfinite(y)]])))
        low = usual <= usual.min() + HIDDEN * height
        near = np.abs(y - usual[upright]) <= STRAY * height
        standing = low[upright] & near & np.isfinite(usual[upright])
        numbers = np.unique(upright[standing]).tolist()
        return [self._track(np.flatnonzero(standing & (upright == k)), k + 1) for k in numbers]

    def _track(self, index: Ints, upright: int) -> Track:
        feet = sorted((self.features[i] for i in index.tolist()), key=lambda f: (f.frame, f.view))
        return Track(
            f"upright {upright} / foot",
            feet[0].label,
            {"upright": upright, "side": "middle", "end": PART},
            np.array([f.frame for f in feet], dtype=np.int64),
            tuple(f.view for f in feet),
            np.concatenate([f.pixels for f in feet]),
            np.concatenate([f.covariance for f in feet]),
        )


def feet_of(features: Sequence[Feature], sightings: FaceSightings) -> Feet:
    """The feet among features, with the attitudes of the sightings."""
    feet = tuple(f for f in features if f.part == PART and f.view in sightings.names)
    points = feature_points(feet, sightings.names)
    face = tangents(points, sightings.views, sightings.world_from_rig, np.zeros(len(feet), dtype=np.bool_))
    return Feet(feet, points.frame, face)


def _nearest(x: Floats, edges: Floats) -> Ints:
    """The upright (n,) that x (n,) lies on, widened by half its width to both sides; -1 for none."""
    middle, reach = edges.mean(axis=1), np.diff(edges, axis=1)[:, 0]
    number = np.abs(np.nan_to_num(x, nan=np.inf)[:, None] - middle).argmin(axis=1)
    return np.where(np.abs(x - middle[number]) <= reach[number], number, -1)
