"""Several passes along one face: each has a zero and a scale of its own on it until what is found in each is laid on
what is found in the others."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from savmap.types import Bools, Floats, FoundObject, Trajectory

LARGEST_RATIO = 2.5
NEAR = 0.06
"""How far from one another two middles of one object may lie, as a share of the distance from a tall object to the
next."""
LEAST_PAIRS = 2


@dataclass(frozen=True, eq=False)
class Laid:
    """x' = scale x + shift on the face, and the number of objects that then lie on one another, less those that do
    not."""

    scale: float
    shift: Floats
    score: float


def laid_on(reference: Sequence[FoundObject], other: Sequence[FoundObject]) -> Laid | None:
    """The similarity that lays objects on those of another pass with most of them on one another; None where fewer than
    two pairs of tall objects do."""
    first, second = _Middles.of(reference), _Middles.of(other)
    ways = (first.laid(second, *way) for way in _ways(first.tall, second.tall))
    return max((way for way in ways if way is not None), key=lambda way: way.score, default=None)


def moved(path: Trajectory, laid: Laid) -> Trajectory:
    """A path with its places moved as the objects that are seen from it."""
    poses = path.world_from_rig.copy()
    poses[:, :3, 3] *= laid.scale
    poses[:, :2, 3] += laid.shift
    return Trajectory(path.frames, poses)


@dataclass(frozen=True, eq=False)
class _Middles:
    """The objects of a pass: x of the tall ones (k,), middles (m, 2) of the wide ones."""

    tall: Floats
    wide: Floats

    @classmethod
    def of(cls, objects: Sequence[FoundObject]) -> "_Middles":
        middles = np.array([item.outline[:, :2].mean(axis=0) for item in objects if item.is_mapped]).reshape(-1, 2)
        sizes = np.array([np.ptp(item.outline[:, :2], axis=0) for item in objects if item.is_mapped]).reshape(-1, 2)
        is_tall = sizes[:, 1] > sizes[:, 0]
        return cls(np.unique(middles[is_tall, 0]), middles[~is_tall])

    def laid(self, other: "_Middles", scale: float, slide: float) -> Laid | None:
        near = NEAR * float(np.median(np.diff(self.tall)))
        x, wide = scale * other.tall + slide, scale * other.wide + [slide, 0.0]
        matched = _has_near(x, self.tall, near)
        if matched.sum() < LEAST_PAIRS:
            return None
        across = np.abs(wide[:, None, 0] - self.wide[:, 0]) < near
        rises = (self.wide[:, 1] - wide[:, None, 1])[across]
        if not len(rises):
            return Laid(scale, np.array([slide, 0.0]), 2.0 * matched.sum() - _inside(x, self.tall))
        votes = np.abs(rises[:, None] - rises) < near / 2
        rise = float(np.median(rises[votes[votes.sum(axis=1).argmax()]]))
        on = (across & (np.abs(self.wide[:, 1] - wide[:, None, 1] - rise) < near / 2)).any(axis=1)
        score = 2.0 * matched.sum() - _inside(x, self.tall) + 2.0 * on.sum() - across.any(axis=1).sum()
        return Laid(scale, np.array([slide, rise]), float(score))


def _has_near(values: Floats, others: Floats, near: float) -> Bools:
    return np.asarray((np.abs(values[:, None] - others) < near).any(axis=1))


def _inside(values: Floats, others: Floats) -> int:
    room = float(np.median(np.diff(others))) / 4
    return int(((values > others[0] - room) & (values < others[-1] + room)).sum())


def _ways(reference: Floats, other: Floats) -> Iterator[tuple[float, float]]:
    """Scale and slide by two objects of each pass."""
    for (i, j), (k, m) in product(_pairs(len(reference)), _pairs(len(other))):
        scale = float((reference[j] - reference[i]) / (other[m] - other[k]))
        if 1 / LARGEST_RATIO < scale < LARGEST_RATIO:
            yield scale, float(reference[i] - scale * other[k])


def _pairs(count: int) -> Sequence[tuple[int, int]]:
    return [(i, j) for i in range(count) for j in (i + 1, i + 2, count - 1) if i < j < count]
