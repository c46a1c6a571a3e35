"""What runs along the row above a rack and was tracked as the highest beams: a pipe, a cable tray, a girder.

No post reaches beyond it, and it goes on beyond the row's ends, where the beams below it end.
"""

from collections.abc import Sequence

import numpy as np

from savmap.types import Bools, Floats, PlaneEvidence
from savmap_shelves.evidence.face_grid import Grid
from savmap_shelves.evidence.strength import across_of, heights_of, level_strength, post_heights

BESIDE = 0.5
"""How much of a bay is looked at beyond each end of the row."""
SEEN = 0.5
"""An end tells something of a level if this share of what lies beyond it, at the level's height, was seen."""
GOES_ON, ENDS = 0.15, 0.1
"""A level goes on if its evidence beyond each end is at least this share of the usual level's. Others end: at most the other share."""
LEAST_BELOW = 2
"""How many levels below the posts' tops must tell that the row ends."""
POSTS_TOP = 0.75
"""The quantile of the posts' tops that stands for all: goods hide some."""


def overhead_levels(evidence: PlaneEvidence, grid: Grid, usual_level: float, post_shown: float) -> Floats:
    """The levels y (n, 2) of a grid that run overhead, or along the posts' tops. `usual_level`: the usual evidence of a level. A post shows where its own is at
    least `post_shown`.

    There are none where the row's ends do not tell: where neither is in sight, or where the beams below go on, too, for instance into a
    bay that was not tracked.
    """
    tops = [float(post_heights(evidence, post, post_shown).max(initial=-np.inf)) for post in grid.posts]
    top, levels = float(np.quantile(tops, POSTS_TOP)), np.concatenate(grid.sections)
    above, beyond = levels[:, 1] >= top, _strengths_beyond(evidence, grid, levels) / usual_level
    below = beyond[~above & np.isfinite(beyond)]
    end_with_row = len(below) >= LEAST_BELOW and np.median(below) <= ENDS
    return np.asarray(levels[above & (beyond >= GOES_ON) & end_with_row])


def without_overhead(grid: Grid, overhead: Floats) -> Grid:
    """The grid without levels (n, 2)."""
    return Grid(grid.posts, [own[~np.isin(own[:, 0], overhead[:, 0])] for own in grid.sections], grid.pieces)


def _strengths_beyond(evidence: PlaneEvidence, grid: Grid, levels: Floats) -> Floats:
    """The evidence (n,) of levels (n, 2) beyond the row's ends, at that end where it is less; NaN where neither is in sight."""
    ends = _beyond(evidence, grid)
    strengths = np.array(
        [[_strength(evidence, columns, level, grid.thickness) for columns in ends] for level in levels]
    )
    seen = np.isfinite(strengths)
    return np.where(seen.any(axis=1), np.where(seen, strengths, np.inf).min(axis=1), np.nan)


def _beyond(evidence: PlaneEvidence, grid: Grid) -> Sequence[Bools]:
    """The columns beyond the left and the right end of the row."""
    x, reach = across_of(evidence), BESIDE * grid.bay
    left, right = grid.posts[0, 0] - grid.width, grid.posts[-1, 1] + grid.width
    return [(x < left) & (x > left - reach), (x > right) & (x < right + reach)]


def _strength(evidence: PlaneEvidence, columns: Bools, level: Floats, thickness: float) -> float:
    """The evidence of a level in some columns; NaN where they are not in sight."""
    low, high = float(level[0]) - thickness / 4, float(level[1]) + thickness / 4
    y = heights_of(evidence)
    weight = evidence.weight[np.ix_((y > low) & (y < high), columns)]
    seen = weight.size > 0 and float((weight > 0).mean()) > SEEN
    return level_strength(evidence, columns, low, high) if seen else np.nan
