"""Several passes along one row: each has its own zero and scale on the face plane until they are laid on one another."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from savmap.types import Floats, Ints
from savmap_shelves.tracking.density import nearest

LARGEST_RATIO = 2.5
UPRIGHT_REACH = 0.08
LEVEL_REACH = 0.04


@dataclass(frozen=True, eq=False)
class PassGrid:
    """The grid that a pass showed: uprights' centres x (k,) from the left, levels' bay (m,) and y (m,)."""

    x: Floats
    section: Ints
    y: Floats


@dataclass(frozen=True)
class Similarity:
    """x' = scale x + slide and y' = scale y + rise."""

    scale: float
    slide: float
    rise: float


def laid_on(reference: PassGrid, other: PassGrid) -> Similarity | None:
    """The similarity that lays `other` on `reference` with the most uprights and levels on one another; None if none does."""
    best, best_score = None, 1.0
    for scale, slide in _candidates(reference.x, other.x):
        similarity, score = _scored(reference, other, scale, slide)
        if score > best_score:
            best, best_score = similarity, score
    return best


def transformed(states: Floats, similarity: Similarity) -> Floats:
    """States (n, 3) of a path in the other frame after its scene has been moved by `similarity`."""
    changed = states.copy()
    changed[:, 0] = states[:, 0] / similarity.scale
    changed[:, 1] = states[:, 1] + similarity.slide * changed[:, 0]
    changed[:, 2] = states[:, 2] + similarity.rise * changed[:, 0]
    return changed


def _candidates(reference: Floats, other: Floats) -> Iterator[tuple[float, float]]:
    for (i, j), (k, m) in product(_pairs(len(reference)), _pairs(len(other))):
        scale = (reference[j] - reference[i]) / (other[m] - other[k])
        if 1 / LARGEST_RATIO < scale < LARGEST_RATIO:
            yield scale, reference[i] - scale * other[k]


def _pairs(count: int) -> Sequence[tuple[int, int]]:
    return [(i, j) for i in range(count) for j in (i + 1, i + 2, count - 1) if i < j < count]


def _scored(reference: PassGrid, other: PassGrid, scale: float, slide: float) -> tuple[Similarity, float]:
    x = scale * other.x + slide
    spacing = float(np.median(np.diff(reference.x)))
    match = nearest(x, reference.x, UPRIGHT_REACH * spacing)
    inside = (x > reference.x[0] - spacing / 4) & (x < reference.x[-1] + spacing / 4)
    both = np.flatnonzero((match[:-1] >= 0) & (match[1:] == match[:-1] + 1))
    uprights = 2.0 * (match >= 0).sum() - inside.sum()
    steps, offsets = [], []
    for section in both:
        heights = scale * other.y[other.section == section]
        reference_heights = reference.y[reference.section == match[section]]
        steps.append(min(len(heights), len(reference_heights)) - max(len(heights), len(reference_heights)))
        offsets.append((reference_heights[:, None] - heights).ravel())
    if not offsets or not len(votes := np.concatenate(offsets)):
        return Similarity(scale, slide, 0.0), uprights - 2.0
    near = np.abs(votes[:, None] - votes) < LEVEL_REACH * spacing / 2
    rise = float(np.median(votes[near[near.sum(axis=1).argmax()]]))
    levels = int((np.abs(votes - rise) < LEVEL_REACH * spacing).sum())
    total = sum(len(other.y[other.section == section]) for section in both)
    return Similarity(scale, slide, rise), uprights + 2.0 * levels - total + sum(steps)
