"""Where uprights stand on the floor: the level that gives a map its scale when no beam's height is known.

A foot can be hidden by a guard or by goods, but never be below the floor: uprights whose feet seem clearly higher than
the lowest one's are left out.
"""

from collections.abc import Sequence

import numpy as np

from savmap.types import Feature, Ints, Track
from savmap_shelves.face import Grid
from savmap_shelves.floor import PART

HIDDEN = 0.04
STRAY = 0.02


def foot_tracks(grid: Grid) -> list[Track]:
    """Tracks "upright k / foot" of the uprights whose feet were seen on the floor in three frames or more."""
    states, edges = grid.fit.states, grid.uprights.x
    upright, y = grid.feet.on_face(states, edges)
    usual = np.append(grid.feet.usual(states, edges), np.inf)
    if not np.isfinite(usual).any():
        return []
    height = float(np.ptp(np.concatenate([grid.levels.y.ravel(), y[np.isfinite(y)]])))
    low = usual <= usual.min() + HIDDEN * height
    near = np.abs(y - usual[upright]) <= STRAY * height
    standing = low[upright] & near & np.isfinite(usual[upright])
    found = np.unique(upright[standing]).tolist()
    return [_track(grid.feet.features, np.flatnonzero(standing & (upright == k)), k + 1) for k in found]


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
