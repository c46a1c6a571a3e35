"""Where uprights stand: the feet of one row on the face plane, and the floor that no beam lies below."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.types import Feature, Floats, Ints
from savmap_shelves.sightings import Catalogue, Pixels, Tangents, tangents

PART = "foot"
LEAST_SEEN = 3


@dataclass(frozen=True)
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
        """The usual height (k,) of every upright's foot, inf where it was hardly seen."""
        upright, y = self.on_face(states, uprights)
        own = [y[(upright == k) & np.isfinite(y)] for k in range(len(uprights))]
        return np.array([np.median(each) if len(each) >= LEAST_SEEN else np.inf for each in own])

    def floor(self, states: Floats, uprights: Floats) -> float:
        """The least height that a beam should have: the lowest foot's less what feet differ by, for goods and guards hide
        them. -inf where fewer than two feet are known."""
        usual = self.usual(states, uprights)
        known = usual[np.isfinite(usual)]
        if len(known) < 2:
            return -np.inf
        return float(known.min() - np.ptp(known))


def feet_of(features: Sequence[Feature], seen: Catalogue, world_from_rig: Floats) -> Feet:
    """The feet among features, as seen with attitudes world_from_rig (n, 3, 3)."""
    feet = tuple(f for f in features if f.part == PART and f.view in seen.names)
    points = Pixels(
        np.array([f.frame for f in feet], dtype=np.int64),
        np.array([seen.names.index(f.view) for f in feet], dtype=np.int64),
        np.concatenate([np.zeros((0, 2)), *(f.pixels for f in feet)]),
        np.concatenate([np.zeros((0, 2, 2)), *(f.covariance for f in feet)]),
        np.array([f.score for f in feet], dtype=np.float64),
    )
    return Feet(feet, points.frame, tangents(points, seen.views, world_from_rig, np.zeros(len(feet), dtype=np.bool_)))


def _nearest(x: Floats, edges: Floats) -> Ints:
    """The upright (n,) that x (n,) lies on, widened by half its width to both sides; -1 for none."""
    middle, reach = edges.mean(axis=1), np.diff(edges, axis=1)[:, 0]
    number = np.abs(np.nan_to_num(x, nan=np.inf)[:, None] - middle).argmin(axis=1)
    return np.where(np.abs(x - middle[number]) <= reach[number], number, -1)
