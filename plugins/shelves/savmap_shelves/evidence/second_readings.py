"""Which second readings of beams' edges are believed: those that all frames together put where one profile has them.

Racks are built of few profiles. A beam that is neither as high as most of the row nor as the others of its section has one edge that is
something else's, or is of another profile. Second readings (savmap_shelves.boundaries.second) say what the pictures show where a beam like the others
would have that edge: its own edge is at one height in all frames, to a few per cent of the profile; other things are at any.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.types import Bools, Floats, Ints, array_record

ALIKE, MOSTLY, LEAST_LEVELS = 0.1, 0.6, 4
"""A row has a usual height where so large a share of so many beams is alike but for this share of it."""
NEAR, SAME = 0.06, 0.025
"""How far from its place an edge may be, and second readings of it from each other, as shares of the usual height."""
LEAST_READINGS, LEAST_SHARE, LEAST_AGREEING = 3, 0.1, 0.7
"""So many second readings agree, in so large a share of the frames that read the edge elsewhere, and so large a share of those that there are."""
LEAST_PAIRS, LEAST_PAIR_SHARE = 4, 0.2
"""So many frames, and so large a share, put both edges of a beam elsewhere than most do."""


@dataclass(frozen=True, eq=False)
@array_record
class Settled:
    """Edges (k, 2), lower and upper, of levels that second readings are believed of; of sightings the first (m, 2) and the second readings (m, 2)
    that show these."""

    edges: Bools
    first: Bools
    second: Bools


def believed(section: Ints, which: Ints, first: Floats, second: Floats) -> Settled:
    """Which second readings are believed. `section` (k,) of the levels; `which` (m,) level each sighting is of, or -1; heights (m, 2) of the lower
    and upper edges by the first and by the second reading, nan where there is none."""
    edges, of_first, of_second = np.zeros((len(section), 2), np.bool_), *np.zeros((2, *second.shape), np.bool_)
    if len(section) >= LEAST_LEVELS and np.isfinite(second).any():
        levels = np.array([np.nanmedian(first[which == k], axis=0) for k in range(len(section))])
        for level, (heights, like) in enumerate(_profiles(section, np.diff(levels, axis=1)[:, 0])):
            mine = np.flatnonzero(which == level)
            edge, same, anew = _best(levels[level], first[mine], second[mine], heights, like)
            if len(anew):
                edges[level, edge], of_first[mine[same], edge], of_second[mine[anew], edge] = True, True, True
                continue
            pair = None if like else _elsewhere(first[mine], second[mine], heights)
            if pair is not None:
                edges[level], (of_first[mine], of_second[mine]) = True, pair
    return Settled(edges, of_first, of_second)


def _best(level: Floats, first: Floats, second: Floats, heights: Sequence[float], like: bool) -> tuple[int, Ints, Ints]:
    """The edge of a level, and its first and second readings, for which most second readings speak; none of these where too few do. Of a level
    that is not `like` the others first readings count, too, and these agree less closely among themselves."""
    votes = [*_votes(level, first, second, heights, like, SAME)]
    best = max(votes, key=lambda vote: len(vote[2]), default=None)
    if best is not None and len(best[2]) >= LEAST_READINGS:
        return best
    votes = [] if like else [*_votes(level, first, second, heights, like, 2 * SAME)]
    enough = [vote for vote in votes if len(vote[2]) and len(vote[1]) + len(vote[2]) > LEAST_READINGS]
    none = np.zeros(0, np.int64)
    return max(enough, key=lambda vote: len(vote[1]) + len(vote[2]), default=(0, none, none))


def _votes(
    level: Floats, first: Floats, second: Floats, heights: Sequence[float], like: bool, same: float
) -> Iterator[tuple[int, Ints, Ints]]:
    """For either edge of a level at (2,), and each height that it may have, which first (n, 2) and second readings (n, 2) agree. What is `like` the
    others of its section has the row's height only where the first readings of that edge disagree among themselves.

    An edge is looked for from the other one. Where a frame read that far off the level's, its second reading is of another place, and is
    no reading that disagrees; elsewhere edges agree by their distance from it, for the frame's own error moves both.
    """
    for edge, side in ((0, -1.0), (1, 1.0)):
        off = first[:, 1 - edge] - level[1 - edge]
        for height in heights:
            there = np.abs(np.nan_to_num(off, nan=np.inf)) < 2 * NEAR * height
            own, again = (readings[:, edge] - np.where(there, off, 0.0) for readings in (first, second))
            if height == heights[0] or not like or not _steady(own[there], height):
                yield edge, *_agreeing(own, again, there, float(level[1 - edge]) + side * height, height, same)


def _elsewhere(first: Floats, second: Floats, heights: Sequence[float]) -> tuple[Bools, Bools] | None:
    """Which first and second readings (n, 2) show a beam of one of the heights where neither edge is the level's: what stands on the beam or hangs
    before it was taken for it by most frames. None where too few frames show the beam, or second readings are of several minds."""
    told = np.isfinite(second).sum()
    for height in heights:
        for edge in (0, 1):
            size = np.abs(second[:, edge] - first[:, 1 - edge])
            fits = np.flatnonzero(np.abs(np.nan_to_num(size, nan=np.inf) - height) < NEAR * height)
            alike = np.abs(first[fits][:, None, 1 - edge] - first[fits, 1 - edge]) < 2 * NEAR * height
            own = fits[alike[alike.sum(axis=1).argmax()]] if len(fits) else fits
            if len(own) < max(LEAST_PAIRS, LEAST_PAIR_SHARE * len(first), LEAST_AGREEING * told):
                continue
            at = np.where(np.arange(2) == edge, np.median(second[own], axis=0), np.median(first[own], axis=0))
            same = np.abs(np.nan_to_num(first - at, nan=np.inf)) < NEAR * height
            anew = np.zeros_like(same)
            anew[own, edge] = True
            return same & ~anew, anew
    return None


def _steady(readings: Floats, height: float) -> bool:
    """Whether most of an edge's readings (n,) agree."""
    known = readings[np.isfinite(readings)]
    alike = np.abs(known[:, None] - known) < SAME * height
    return bool(alike.mean(axis=1).max(initial=0.0) >= LEAST_AGREEING)


def _profiles(section: Ints, heights: Floats) -> Iterator[tuple[list[float], bool]]:
    """For each level of height (k,) the heights that it may have, the likelier first: that of most of the row, and that of the others of its section;
    and whether it is like these. A section may have a profile of its own: what is like either has no other, but where its section has beams of the
    row's height, too. None where the row has no usual height."""
    usual = float(np.median(heights))
    beside = [_of_the_others(heights, section, level, usual) for level in range(len(heights))]
    off = np.minimum(np.abs(heights - usual), np.abs(heights - beside))
    regular = bool(np.mean(off < ALIKE * usual) >= MOSTLY)
    common = set(section[np.abs(heights - usual) < ALIKE * usual].tolist())
    for number, height, own, apart in zip(section.tolist(), beside, heights.tolist(), off.tolist(), strict=True):
        both = sorted({usual, height}, key=lambda likely: abs(likely - own))
        like = bool(apart < NEAR * usual)
        alone = like and (number not in common or abs(own - usual) < NEAR * usual)
        yield (both[:1] if alone else both) if regular else [], like


def _of_the_others(heights: Floats, section: Ints, level: int, usual: float) -> float:
    others = heights[(section == section[level]) & (np.arange(len(heights)) != level)]
    return float(np.median(others)) if len(others) > 1 else usual


def _agreeing(
    first: Floats, second: Floats, there: Bools, place: float, height: float, same: float
) -> tuple[Ints, Ints]:
    """The numbers of the first (n,) and of the second readings (n,) of an edge that agree near a place to the share `same` of the height;
    none where second readings that were looked for `there` (n,) are of several minds, or all are too few for how often the edge was read elsewhere."""
    both = np.concatenate([first, second])
    near = np.flatnonzero(np.abs(np.nan_to_num(both, nan=np.inf) - place) < NEAR * height)
    none = near[:0]
    if not len(near):
        return none, none
    alike = np.abs(both[near][:, None] - both[near]) < same * height
    best = near[alike[alike.sum(axis=1).argmax()]]
    agreed, anew = best[best < len(first)], best[best >= len(first)] - len(first)
    anew = np.setdiff1d(anew, agreed)
    elsewhere = np.isfinite(first).sum() - len(agreed)
    voices = np.isfinite(second) & there
    voices[anew] = True
    doubtful = len(anew) < LEAST_AGREEING * np.delete(voices, agreed).sum()
    few = len(agreed) + len(anew) < LEAST_SHARE * elsewhere
    return (none, none) if doubtful or few else (agreed, anew)
