"""Where uprights stand on the floor: the level that gives a map its scale when no beam's height is known.

A foot can be hidden by a guard or by goods, but never be below the floor: uprights whose feet seem clearly higher than
the lowest one's are left out.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from savmap.types import Feature, Floats, Ints, RowFacts, Track
from savmap_shelves.face import Grid
from savmap_shelves.sightings import Pixels, Tangents, tangents

PART = "foot"
LEAST_SEEN = 3
HIDDEN = 0.04
STRAY = 0.02


def foot_tracks(features: Sequence[Feature], facts: RowFacts, grid: Grid) -> list[Track]:
    """Tracks "upright k / foot" of the uprights whose feet were seen on the floor in three frames or more."""
    feet = [f for f in features if f.part == PART and f.view in grid.seen.names]
    if not feet:
        return []
    points = _points(feet, grid.seen.names)
    face = tangents(points, grid.seen.views, grid.world_from_rig, np.zeros(len(feet), dtype=np.bool_))
    x, y = _on_face(face, grid.fit.states[points.frame])
    upright = _nearest(x, grid.uprights.x)
    height = float(np.ptp(np.concatenate([grid.levels.y.ravel(), y[np.isfinite(y)]])))
    good = _standing(upright, y, len(grid.uprights.x), height)
    return [_track(feet, np.flatnonzero(good & (upright == k)), k + 1) for k in np.unique(upright[good]).tolist()]


def _points(feet: Sequence[Feature], names: Sequence[str]) -> Pixels:
    return Pixels(
        np.array([f.frame for f in feet], dtype=np.int64),
        np.array([names.index(f.view) for f in feet], dtype=np.int64),
        np.concatenate([f.pixels for f in feet]),
        np.concatenate([f.covariance for f in feet]),
        np.array([f.score for f in feet], dtype=np.float64),
    )


def _on_face(face: Tangents, states: Floats) -> tuple[Floats, Floats]:
    """x and y (n,) on the face plane, tilts left aside."""
    return (face.p + states[:, 1]) / states[:, 0], (face.q + states[:, 2]) / states[:, 0]


def _nearest(x: Floats, edges: Floats) -> Ints:
    """The upright (n,) that x (n,) lies on, widened by half its width to both sides; -1 for none."""
    middle, reach = edges.mean(axis=1), np.diff(edges, axis=1)[:, 0]
    number = np.abs(np.nan_to_num(x, nan=np.inf)[:, None] - middle).argmin(axis=1)
    return np.where(np.abs(x - middle[number]) <= reach[number], number, -1)


def _standing(upright: Ints, y: Floats, count: int, height: float) -> NDArray[np.bool_]:
    """Sightings (n,) near their upright's usual foot, of the uprights whose feet are the lowest."""
    usual = np.full(count + 1, np.inf)
    for k in range(count):
        own = y[(upright == k) & np.isfinite(y)]
        usual[k] = np.median(own) if len(own) >= LEAST_SEEN else np.inf
    low = usual <= usual.min() + HIDDEN * height
    near = np.abs(y - usual[upright]) <= STRAY * height
    standing: NDArray[np.bool_] = low[upright] & near & np.isfinite(usual[upright])
    return standing


def _track(feet: Sequence[Feature], index: Ints, upright: int) -> Track:
    own = sorted((feet[i] for i in index.tolist()), key=lambda f: (f.frame, f.view))
    return Track(
        f"upright {upright} / foot",
        own[0].label,
        {"upright": upright, "side": "middle", "end": PART},
        np.array([f.frame for f in own], dtype=np.int64),
        tuple(f.view for f in own),
        np.concatenate([f.pixels for f in own]),
        np.concatenate([f.covariance for f in own]),
    )
