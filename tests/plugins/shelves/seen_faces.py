"""The evidence of a face with four posts and three levels, and whether a grid is that of it."""

from itertools import pairwise

import numpy as np
import pytest

from savmap.types import PlaneEvidence
from savmap_shelves.evidence import Grid, face_patch

POSTS = np.array([[0.0, 0.1], [2.7, 2.8], [5.4, 5.5], [8.1, 8.2]])
LEVELS = np.array([[0.4, 0.52], [1.9, 2.02], [3.4, 3.52]])
WHOLE = Grid(POSTS, [LEVELS] * 3)


def seen(*changes: tuple[int, tuple[float, float], tuple[float, float], float]) -> PlaneEvidence:
    """Evidence of the whole grid, changed within rectangles (class, x, y) to values."""
    patch = face_patch(WHOLE)
    assert patch is not None
    mean = np.zeros((2, *patch.shape), np.float32)
    x, y = patch.origin[0] + patch.across, patch.origin[1] + patch.heights
    posts = [(0, (low, high), (0.0, 4.0), 0.9) for low, high in POSTS.tolist()]
    beams = [
        (1, (left[1], right[0]), (low, high), 0.9) for left, right in pairwise(POSTS) for low, high in LEVELS.tolist()
    ]
    for label, across, up, value in (*posts, *beams, *changes):
        mean[label][np.ix_((y > up[0]) & (y < up[1]), (x > across[0]) & (x < across[1]))] = value
    weight, picture = np.ones(patch.shape, np.float32), np.zeros((*patch.shape, 3), np.uint8)
    return PlaneEvidence(patch, ("upright", "beam"), mean, weight, picture)


def is_whole(grid: Grid | None) -> bool:
    """Whether a grid has all posts and levels, each at its place within 3 cm."""
    assert grid is not None
    posts, levels = POSTS.mean(axis=1), LEVELS.mean(axis=1)
    return grid.posts.mean(axis=1) == pytest.approx(posts, abs=0.03) and all(
        own.mean(axis=1) == pytest.approx(levels, abs=0.03) for own in grid.sections
    )
