"""Uprights and beams in the evidence of all frames: posts where columns of the face show one, levels where rows between posts do.

This is the published density estimate (paper, III.D) over every pixel of every frame instead of over edges that single frames found.
What was tracked sets the scale: its own evidence says how strong the others' should be.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, median_filter

from savmap.types import Bools, Floats, PlaneEvidence
from savmap_shelves.evidence.face_grid import BEYOND, Grid

Singles = NDArray[np.float32]

BODY = (0.12, 0.92)
APART, FOOT, FAINT, SUNK = 1.5, 0.4, 0.52, 0.25


@dataclass(frozen=True)
class EvidenceSettings:
    """When evidence is believed.

    An object's cover is the share of its length along which the evidence stands out of its surroundings by `clear` of what is usual
    for those that were tracked: one that is faint all along is covered, a strong thing that is shorter is not. `post`, `level`: the
    cover that a new one must have; `post_in_gap`: one in a bay so wide that one is missing; `lost`: what was tracked with less is
    dropped. `faint`: evidence below this says nothing. `wide`: such a multiple of the narrowest bay may miss a post; `narrow`: posts nearer
    to one another than this share of it are one.
    """

    clear: float = 0.2
    post: float = 0.7
    post_in_gap: float = 0.45
    level: float = 0.8
    lost: float = 0.1
    faint: float = 0.05
    wide: float = 1.6
    narrow: float = 0.3


def expected_grid(evidence: PlaneEvidence, grid: Grid, settings: EvidenceSettings | None = None) -> Grid | None:
    """The grid that the evidence shows; None where it is the one that was tracked."""
    found = GridSearch(evidence, grid, settings or EvidenceSettings()).grid()
    posts = len(found.posts) == len(grid.posts) and np.allclose(found.posts, grid.posts)
    same = posts and all(
        len(a) == len(b) and np.allclose(a, b) for a, b in zip(found.sections, grid.sections, strict=True)
    )
    return None if same else found


class GridSearch:
    """Looks for posts and levels in a face's evidence."""

    def __init__(self, evidence: PlaneEvidence, grid: Grid, settings: EvidenceSettings) -> None:
        self.tracked, self.settings, self.cell = grid, settings, evidence.patch.cell
        self.x = evidence.patch.origin[0] + evidence.patch.across
        self.y = evidence.patch.origin[1] + evidence.patch.heights
        self.upright, self.beam, self.weight = evidence.of("upright"), evidence.of("beam"), evidence.weight
        self.usual_post = self._usual([self._post_strength(*post) for post in grid.posts])
        self.usual_level = self._usual(
            [
                self._level_strength(float(left[1]), float(right[0]), *level)
                for (left, right), levels in zip(pairwise(grid.posts), grid.sections, strict=True)
                for level in levels
            ]
        )

    def grid(self) -> Grid:
        """What the evidence shows."""
        posts = self._with_ends(self._posts())
        return Grid(posts, [self._levels(pair) for pair in pairwise(posts)])

    @cached_property
    def floor(self) -> float:
        """Where the posts end at the bottom: goods and markings on the floor may look like a level. A guard hides some posts' feet."""
        return float(np.quantile([self._reach(*post)[0] for post in self.tracked.posts], 0.25))

    @cached_property
    def ceiling(self) -> float:
        """Where the posts end at the top: what lies above is the roof's. Goods hide some posts' tops."""
        return float(np.quantile([self._reach(*post)[1] for post in self.tracked.posts], 0.75))

    def _reach(self, low: float, high: float) -> tuple[float, float]:
        """Lowest and highest y at which a post shows; it reaches to the highest level that was tracked at least."""
        columns = (self.x > low) & (self.x < high)
        along = gaussian_filter1d(_mean(self.upright[:, columns], self.weight[:, columns], 1), 1.0)
        shown = self.y[along >= FOOT * self.usual_post]
        return float(shown.min(initial=self.tracked.top)), float(shown.max(initial=self.tracked.top))

    def _usual(self, strengths: Sequence[float]) -> float:
        return max(float(np.median(strengths)), self.settings.faint)

    def _post_strength(self, low: float, high: float) -> float:
        rows, columns = self._body(), (self.x > low) & (self.x < high)
        return float(_mean(self.upright[rows], self.weight[rows], 0)[columns].max(initial=0.0))

    def _level_strength(self, left: float, right: float, low: float, high: float) -> float:
        room = self.tracked.thickness / 4
        rows, columns = (self.y > low - room) & (self.y < high + room), self._inside(left, right)
        return float(_mean(self.beam[:, columns], self.weight[:, columns], 1)[rows].max(initial=0.0))

    def _body(self) -> Bools:
        """The rows between the lowest and the highest beams."""
        bottom = min(float(levels.min()) for levels in self.tracked.sections if len(levels))
        low, high = bottom + np.array(BODY) * (self.tracked.top - bottom)
        return np.asarray((self.y > low) & (self.y < high))

    def _inside(self, left: float, right: float) -> Bools:
        """The columns between two posts, but for what is close to them."""
        margin = min(self.tracked.width, 0.1 * (right - left))
        return np.asarray((self.x > left + margin) & (self.x < right - margin))

    def _post_cover(self) -> Floats:
        """The cover (columns,) of a post at each column."""
        rows, limit = self._body(), self.settings.clear * self.usual_post
        return self._cover(self.upright[rows].T, self.weight[rows].T, self.tracked.width, self.tracked.bay, limit)

    def _level_cover(self, left: float, right: float) -> Floats:
        """The cover (rows,) of a level at each row between two posts."""
        columns, thickness = self._inside(left, right), self.tracked.thickness
        limit = self.settings.clear * self.usual_level
        return self._cover(self.beam[:, columns], self.weight[:, columns], thickness, 8 * thickness, limit)

    def _cover(self, seen: Singles, weight: Singles, size: float, around: float, limit: float) -> Floats:
        """The share of the cells in each row of `seen` (n, m) that stand out by a limit, for objects of some size."""
        smooth = gaussian_filter1d(seen, size / 4 / self.cell, axis=0)
        usual = median_filter(_mean(smooth, weight, 1), max(3, round(0.7 * around / self.cell)))
        return _mean(np.clip((smooth - usual[:, None]) / max(limit, self.settings.faint), 0.0, 1.0), weight, 1)

    def _posts(self) -> Floats:
        """x (k, 2) of the posts between the first and the last that were tracked: those that were and are not lost, new ones, and in
        bays so wide that one is missing less sure ones."""
        cover, posts = self._post_cover(), self.tracked.posts
        kept = posts[_greatest(cover, self.x, posts) >= self.settings.lost]
        posts = kept if len(kept) >= 2 else posts
        inner = (self.x > posts[0, 1]) & (self.x < posts[-1, 0])
        posts = self._joined(posts, self._candidates(cover, inner, self.settings.post))
        for _ in range(2):
            gap, narrowest = np.zeros_like(inner), float(np.diff(posts.mean(axis=1)).min())
            for left, right in pairwise(posts):
                if right.mean() - left.mean() > self.settings.wide * narrowest:
                    gap |= (self.x > left[1]) & (self.x < right[0])
            posts = self._joined(posts, self._candidates(cover, gap, self.settings.post_in_gap))
        return posts

    def _candidates(self, cover: Floats, within: Bools, least: float) -> Floats:
        """Centres (k,) of the columns where the cover is greatest, the best first."""
        columns = [column for column in _peaks(cover, least) if within[column]]
        return np.asarray(self.x[columns])

    def _joined(self, posts: Floats, centres: Floats) -> Floats:
        """Posts with new ones, which are as wide as usual, where none is near."""
        apart = max(self.settings.narrow * _usual_bay(posts), 2 * self.tracked.width)
        for centre in centres:
            if np.abs(posts.mean(axis=1) - centre).min() > apart:
                post = centre + self.tracked.width * np.array([-0.5, 0.5])
                posts = np.concatenate([posts, post[None]])
        return posts[np.argsort(posts[:, 0])]

    def _with_ends(self, posts: Floats) -> Floats:
        """Posts with one more at either end, where most levels of the outermost section go on to it."""
        cover = self._post_cover()
        for end, beyond in ((-1, self.x > posts[-1, 1]), (0, self.x < posts[0, 0])):
            bay, inner, levels = _usual_bay(posts), float(posts[end].mean()), self.tracked.sections[end]
            for centre in self._candidates(cover, beyond, self.settings.post):
                near = 0.4 * bay < abs(centre - inner) < BEYOND * bay
                if near and len(levels) and self._goes_on(levels, *sorted((float(centre), inner))):
                    posts = self._joined(posts, np.array([centre]))
                    break
        return posts

    def _goes_on(self, levels: Floats, left: float, right: float) -> bool:
        there = _greatest(self._level_cover(left, right), self.y, levels) > self.settings.level
        return float(there.mean()) > 0.5

    def _levels(self, posts: tuple[Floats, Floats]) -> Floats:
        """y (m, 2) of a section's beams: those that were tracked between the same posts and are not lost, and new ones."""
        left, right = float(posts[0][1]), float(posts[1][0])
        cover, levels = self._level_cover(left, right), self._tracked_between(*posts)
        faint = np.array([self._level_strength(left, right, *level) for level in levels]) < FAINT * self.usual_level
        sunk = faint & (levels.mean(axis=1) < self.floor + SUNK * self.tracked.thickness)
        levels = levels[(_greatest(cover, self.y, levels) >= self.settings.lost) & ~sunk]
        for row in _peaks(cover, self.settings.level):
            centre, half = self.y[row], self._half(cover, row)
            if not self.floor + self.tracked.thickness / 2 < centre < self.ceiling + self.tracked.thickness / 2:
                continue
            if not len(levels) or np.abs(levels.mean(axis=1) - centre).min() > APART * self.tracked.thickness:
                levels = np.concatenate([levels, [[centre - half, centre + half]]])
        return levels[np.argsort(levels[:, 0])]

    def _half(self, cover: Floats, row: int) -> float:
        """Half the thickness of a level whose cover is greatest at a row: down to half of it on either side, within reason."""
        below = np.flatnonzero(cover < cover[row] / 2)
        first, last = below[below < row].max(initial=row - 1), below[below > row].min(initial=row + 1)
        thickness = self.cell * (last - first - 1)
        return float(np.clip(thickness, 0.6 * self.tracked.thickness, 1.4 * self.tracked.thickness) / 2)

    def _tracked_between(self, left: Floats, right: Floats) -> Floats:
        for own, levels in zip(pairwise(self.tracked.posts), self.tracked.sections, strict=True):
            if np.allclose(own[0], left) and np.allclose(own[1], right):
                return levels
        return np.zeros((0, 2))


def _mean(values: Singles, weight: Singles, axis: int) -> Floats:
    """The mean along an axis over cells that were seen, 0 where there are none."""
    seen = weight > 0
    return np.asarray((values * seen).sum(axis=axis) / np.maximum(seen.sum(axis=axis), 1), np.float64)


def _greatest(cover: Floats, places: Floats, intervals: Floats) -> Floats:
    """The greatest cover (k,) within intervals (k, 2) of places, or beside them by half their length."""
    margin = np.diff(intervals, axis=1) / 2
    inside = (places > intervals[:, :1] - margin) & (places < intervals[:, 1:] + margin)
    return np.asarray(np.where(inside, cover, 0.0).max(axis=1, initial=0.0))


def _peaks(cover: Floats, least: float) -> list[int]:
    """Where the cover is greatest among its neighbours and at least `least`, the best first; the middle of a plateau."""
    rounded = np.round(gaussian_filter1d(cover, 1.0), 6)
    inner = (rounded[1:-1] >= rounded[:-2]) & (rounded[1:-1] > rounded[2:])
    found = np.flatnonzero(inner & (cover[1:-1] >= least)) + 1
    return [int(k) for k in found[np.argsort(-rounded[found], kind="stable")]]


def _usual_bay(posts: Floats) -> float:
    return float(np.median(np.diff(posts.mean(axis=1))))
