"""What runs along the row above a rack and was tracked as the highest beams: a pipe, a cable tray, a girder.

No post reaches it; or it goes on beyond the row's ends, where the beams below it end.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from savmap.types import Bools, Floats, PlaneEvidence
from savmap_shelves.evidence.face_grid import Grid
from savmap_shelves.evidence.search.strength import Singles, across_of, heights_of, level_strength, post_heights

BESIDE = 0.5
"""How much of a bay is looked at beyond each end of the row."""
SEEN = 0.5
"""Some cells tell something if more than this share of them was seen."""
GOES_ON, ENDS = 0.15, 0.1
"""A level goes on if its evidence beyond each end is at least this share of the usual level's. Others end: at most the other share."""
LEAST_BELOW = 2
"""How many levels below the posts' tops must tell that the row ends."""
POST_SHOWN = 0.4
"""A post shows at heights where it has at least this share of its usual evidence."""
HELD = 0.3
"""A post reaches a level if it shows so large a share of its usual evidence there."""
POSTS_TOP = 0.75
"""The quantile of the posts' tops that stands for all: goods hide some."""


def overhead_levels(
    evidence: PlaneEvidence, grid: Grid, usual_level: float, usual_post: float, tracked: Grid | None = None
) -> list[Floats]:
    """The levels y (n, 2) of each bay that are no beams: they run overhead, or along the posts' tops. Below one of them there may be another one.

    usual_level, usual_post: the usual evidence of a level and of a post. tracked: a level of the grid that is not in this one was found in the evidence
    alone; all were tracked where it is not given. Where nothing would be left, the last ones stay.
    """
    known = np.concatenate((tracked or grid).sections)
    found, left = [np.zeros((0, 2)) for _ in grid.sections], grid
    while any(len(own) for own in left.sections):
        along = _along_the_row(evidence, left, usual_level, POST_SHOWN * usual_post, known)
        ends = np.cumsum([len(own) for own in left.sections])[:-1]
        overhead = [
            own[is_along | is_unheld]
            for own, is_along, is_unheld in zip(
                left.sections, np.split(along, ends), _unheld(evidence, left, usual_post), strict=True
            )
        ]
        count = sum(len(own) for own in overhead)
        if count in (0, sum(len(own) for own in left.sections)):
            break
        found = [np.concatenate(both) for both in zip(found, overhead, strict=True)]
        left = without_overhead(left, overhead)
    return found


def _unheld(evidence: PlaneEvidence, grid: Grid, usual_post: float) -> list[Bools]:
    """Which level of each bay is its highest, and reached by neither of its posts."""

    def is_unheld(posts: Sequence[Floats], level: Floats) -> bool:
        return max(_post_at(evidence, post, level, grid.thickness) for post in posts) < HELD * usual_post

    return [
        np.array([level[1] == own[:, 1].max() and is_unheld(posts, level) for level in own], np.bool_)
        for posts, own in zip(pairwise(grid.posts), grid.sections, strict=True)
    ]


def _post_at(evidence: PlaneEvidence, post: Floats, level: Floats, thickness: float) -> float:
    """The evidence of a post, x (2,), at the height of a level, y (2,), and right above it; infinite where these are not in sight."""
    x, y = across_of(evidence), heights_of(evidence)
    cells = np.ix_((y > level[0]) & (y < level[1] + thickness), (x > post[0]) & (x < post[1]))
    return float(evidence.of("upright")[cells].max(axis=1).mean()) if _is_seen(evidence.weight[cells]) else np.inf


def _is_seen(weight: Singles) -> bool:
    """Whether enough of some cells is in sight, by their weights."""
    return weight.size > 0 and float((weight > 0).mean()) > SEEN


def _along_the_row(evidence: PlaneEvidence, grid: Grid, usual_level: float, post_shown: float, known: Floats) -> Bools:
    """Which levels (n,), bay after bay, go on beyond the row's ends, and either no post reaches beyond them, or they are their bay's highest and
    not `known`. A post shows where its own evidence is at least `post_shown`.

    None do where the row's ends do not tell: where neither is in sight, or where the beams below go on, too, for instance into a
    bay that was not tracked.
    """
    tops = [float(post_heights(evidence, post, post_shown).max(initial=-np.inf)) for post in grid.posts]
    top, levels = float(np.quantile(tops, POSTS_TOP)), np.concatenate(grid.sections)
    highest = np.concatenate([own[:, 1] == own[:, 1].max(initial=-np.inf) for own in grid.sections])
    highest &= np.abs(levels.mean(axis=1)[:, None] - known.mean(axis=1)).min(axis=1, initial=np.inf) > grid.thickness
    above, beyond = highest | (levels[:, 1] >= top), _strengths_beyond(evidence, grid, levels) / usual_level
    below = beyond[~above & np.isfinite(beyond)]
    end_with_row = len(below) >= LEAST_BELOW and np.median(below) <= ENDS
    return np.asarray(above & (beyond >= GOES_ON) & end_with_row)


def without_overhead(grid: Grid, overhead: Sequence[Floats]) -> Grid:
    """The grid without levels (n, 2) of each bay."""
    sections = [own[~np.isin(own[:, 0], others[:, 0])] for own, others in zip(grid.sections, overhead, strict=True)]
    return Grid(grid.posts, sections, grid.pieces)


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
    return level_strength(evidence, columns, low, high) if _is_seen(weight) else np.nan
