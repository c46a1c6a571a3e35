"""The choice of second readings of beams' edges: those are accepted that agree, over all frames, with one of the row's beam profiles.

Racks are built of few profiles. If a beam is as high neither as most of the row nor as the others of its bay, then one of its edges
belongs to another object, or the beam is of another profile. A second reading (savmap_shelves.boundaries.second) is the edge that a picture
shows where a beam of the usual height would have it. The beam's own edge is at the same height in all frames, to a few per cent of the profile.
Edges of other objects are at any height.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.types import Bools, Floats, Ints, array_record

ALIKE, MOSTLY, LEAST_LEVELS = 0.1, 0.6, 4
"""Tolerance, least share and least number of beams: a row has a usual height if so many of its beams agree with it."""
NEAR, AGREEMENT = 0.06, 0.025
"""The tolerance of an edge's place, and that between readings of it, as shares of the usual height."""
LEAST_READINGS, LEAST_SHARE, LEAST_AGREEING = 3, 0.1, 0.7
"""Least number of second readings that agree; their least share of the frames that read the edge elsewhere; and of all second readings."""
LEAST_PAIRS, LEAST_PAIR_SHARE = 4, 0.2
"""Least number and share of frames that put both edges of a beam elsewhere than most frames do."""


@dataclass(frozen=True, eq=False)
@array_record
class AcceptedReadings:
    """edges (k, 2): whether second readings of a level's lower and upper edge are accepted. first, second (m, 2): whether a sighting's first or
    second reading shows that edge."""

    edges: Bools
    first: Bools
    second: Bools


def accepted_readings(section: Ints, level_numbers: Ints, first: Floats, second: Floats) -> AcceptedReadings:
    """Accept or refuse the second readings of all levels.

    bay (k,): of each level. level_numbers (m,): the level of each sighting, or -1. first, second (m, 2): heights of the lower and upper
    edges by the first and the second reading, nan where there is none.
    """
    edges, of_first, of_second = np.zeros((len(section), 2), np.bool_), *np.zeros((2, *second.shape), np.bool_)
    if len(section) >= LEAST_LEVELS and np.isfinite(second).any():
        levels = np.array([np.nanmedian(first[level_numbers == k], axis=0) for k in range(len(section))])
        for level, (heights, is_regular) in enumerate(_profiles(section, np.diff(levels, axis=1)[:, 0])):
            sightings = np.flatnonzero(level_numbers == level)
            edge, in_first, in_second = _best(levels[level], first[sightings], second[sightings], heights, is_regular)
            if len(in_second):
                edges[level, edge] = True
                of_first[sightings[in_first], edge] = True
                of_second[sightings[in_second], edge] = True
                continue
            pair = None if is_regular else _elsewhere(first[sightings], second[sightings], heights)
            if pair is not None:
                edges[level], (of_first[sightings], of_second[sightings]) = True, pair
    return AcceptedReadings(edges, of_first, of_second)


def _best(
    level: Floats, first: Floats, second: Floats, heights: Sequence[float], is_regular: bool
) -> tuple[int, Ints, Ints]:
    """The edge of a level with most votes, and the indices of its first and second readings that agree. No indices where there are too few.

    For a level that is not regular, first readings count as votes too, with twice the tolerance.
    """
    votes = [*_votes(level, first, second, heights, is_regular, AGREEMENT)]
    best = max(votes, key=lambda vote: len(vote[2]), default=None)
    if best is not None and len(best[2]) >= LEAST_READINGS:
        return best
    votes = [] if is_regular else [*_votes(level, first, second, heights, is_regular, 2 * AGREEMENT)]
    enough = [vote for vote in votes if len(vote[2]) and len(vote[1]) + len(vote[2]) > LEAST_READINGS]
    none = np.zeros(0, np.int64)
    return max(enough, key=lambda vote: len(vote[1]) + len(vote[2]), default=(0, none, none))


def _votes(
    level: Floats, first: Floats, second: Floats, heights: Sequence[float], is_regular: bool, tolerance: float
) -> Iterator[tuple[int, Ints, Ints]]:
    """For each edge of a level at (2,), and each height that it may have: the edge, and the indices of the first and second readings (n, 2) that
    agree. A regular level is tested for the row's height only where the first readings of that edge disagree among themselves.

    A second reading is searched from the opposite edge. If a frame read that edge far off the level's, its second reading is of another place,
    and is not counted as one that disagrees (not `valid`). Else edges are compared by their distance from the opposite edge: the frame's own
    error moves both.
    """
    for edge, side in ((0, -1.0), (1, 1.0)):
        off = first[:, 1 - edge] - level[1 - edge]
        for height in heights:
            valid = np.abs(np.nan_to_num(off, nan=np.inf)) < 2 * NEAR * height
            first_at_level, second_at_level = (
                readings[:, edge] - np.where(valid, off, 0.0) for readings in (first, second)
            )
            if height == heights[0] or not is_regular or not _steady(first_at_level[valid], height):
                place = float(level[1 - edge]) + side * height
                yield edge, *_agreeing(first_at_level, second_at_level, valid, place, height, tolerance)


def _elsewhere(first: Floats, second: Floats, heights: Sequence[float]) -> tuple[Bools, Bools] | None:
    """Whether first and second readings (n, 2) show a beam of one of the heights, neither edge of which is the level's. Most frames took an object
    on the beam, or in front of it, for the beam. None where too few frames show the beam, or where second readings disagree."""
    readings = np.isfinite(second).sum()
    for height in heights:
        for edge in (0, 1):
            size = np.abs(second[:, edge] - first[:, 1 - edge])
            fits = np.flatnonzero(np.abs(np.nan_to_num(size, nan=np.inf) - height) < NEAR * height)
            agreement = np.abs(first[fits][:, None, 1 - edge] - first[fits, 1 - edge]) < 2 * NEAR * height
            agreeing = fits[agreement[agreement.sum(axis=1).argmax()]] if len(fits) else fits
            if len(agreeing) < max(LEAST_PAIRS, LEAST_PAIR_SHARE * len(first), LEAST_AGREEING * readings):
                continue
            edges = np.where(
                np.arange(2) == edge, np.median(second[agreeing], axis=0), np.median(first[agreeing], axis=0)
            )
            shows_first = np.abs(np.nan_to_num(first - edges, nan=np.inf)) < NEAR * height
            shows_second = np.zeros_like(shows_first)
            shows_second[agreeing, edge] = True
            return shows_first & ~shows_second, shows_second
    return None


def _steady(readings: Floats, height: float) -> bool:
    """Whether a share `LEAST_AGREEING` of an edge's readings (n,) agree."""
    known = readings[np.isfinite(readings)]
    agreement = np.abs(known[:, None] - known) < AGREEMENT * height
    return bool(agreement.mean(axis=1).max(initial=0.0) >= LEAST_AGREEING)


def _profiles(section: Ints, heights: Floats) -> Iterator[tuple[list[float], bool]]:
    """For each level of heights (k,): the heights that it may have, the likelier first, and whether it is regular, which is to agree with one of them.

    The heights are that of most of the row and that of the others of its bay, for a bay may have a profile of its own. A regular
    level has one height only, unless it differs from the row's and its bay has beams of that. No heights where the row has no usual height.
    """
    usual = float(np.median(heights))
    beside = [_median_of_others(heights, section, level, usual) for level in range(len(heights))]
    off = np.minimum(np.abs(heights - usual), np.abs(heights - beside))
    regular = bool(np.mean(off < ALIKE * usual) >= MOSTLY)
    common = set(section[np.abs(heights - usual) < ALIKE * usual].tolist())
    for number, height, level_height, deviation in zip(
        section.tolist(), beside, heights.tolist(), off.tolist(), strict=True
    ):
        candidates = sorted({usual, height}, key=lambda likely: abs(likely - level_height))
        is_regular = bool(deviation < NEAR * usual)
        has_one_height = is_regular and (number not in common or abs(level_height - usual) < NEAR * usual)
        yield (candidates[:1] if has_one_height else candidates) if regular else [], is_regular


def _median_of_others(heights: Floats, section: Ints, level: int, usual: float) -> float:
    others = heights[(section == section[level]) & (np.arange(len(heights)) != level)]
    return float(np.median(others)) if len(others) > 1 else usual


def _agreeing(
    first: Floats, second: Floats, valid: Bools, place: float, height: float, tolerance: float
) -> tuple[Ints, Ints]:
    """The indices of the first (n,) and second readings (n,) of an edge that agree near a place, to a share `tolerance` of the height.

    None where `valid` (n,) second readings disagree, or where there are too few against those first readings that put the edge elsewhere.
    """
    both = np.concatenate([first, second])
    near = np.flatnonzero(np.abs(np.nan_to_num(both, nan=np.inf) - place) < NEAR * height)
    none = near[:0]
    if not len(near):
        return none, none
    agreement = np.abs(both[near][:, None] - both[near]) < tolerance * height
    best = near[agreement[agreement.sum(axis=1).argmax()]]
    agreed_first, agreed_second = best[best < len(first)], best[best >= len(first)] - len(first)
    agreed_second = np.setdiff1d(agreed_second, agreed_first)
    elsewhere = np.isfinite(first).sum() - len(agreed_first)
    voices = np.isfinite(second) & valid
    voices[agreed_second] = True
    doubtful = len(agreed_second) < LEAST_AGREEING * np.delete(voices, agreed_first).sum()
    few = len(agreed_first) + len(agreed_second) < LEAST_SHARE * elsewhere
    return (none, none) if doubtful or few else (agreed_first, agreed_second)
