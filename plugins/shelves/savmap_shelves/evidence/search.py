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
from savmap_shelves.evidence.paint import Paint
from savmap_shelves.evidence.pieces import Pieces
from savmap_shelves.evidence.rear import RearFace
from savmap_shelves.evidence.wide_steps import EVEN, wide_steps

Singles = NDArray[np.float32]

BODY = (0.12, 0.92)
APART, FOOT, FAINT, SUNK = 1.5, 0.4, 0.52, 0.25
ALIKE, NEITHER, STRONG, WHOLE, SURE = 0.95, 0.8, 0.6, 0.9, 0.95
ALIKE_BELOW = 0.85
GAP = 0.3
QUARTER = 0.25


@dataclass(frozen=True)
class EvidenceSettings:
    """When evidence is believed.

    An object's cover is the share of its length along which the evidence stands out of its surroundings by `clear` of what is usual
    for those that were tracked: one that is faint all along is covered, a strong thing that is shorter is not. `post`, `level`: the
    cover that a new one must have; `post_in_gap`: one in a bay so wide that one is missing; `lost`: what was tracked with less is
    dropped. `faint`: evidence below this says nothing. `wide`: such a multiple of the narrowest bay may miss a post; `narrow`: posts nearer
    to one another than this share of it are one.

    Where paint tells beams from the rest (`Paint.tells`), 1 is as like the other beams' as theirs is one another's, 0 as the rest of the
    face: what is `strange` is no level, nor what is `doubted`, unless it shows all along or is `plain` (its cover times its
    strength); `painted` is the cover that is enough, in its own section or in half of them, for one that is like the others. Of what the
    network is sure all along, in all frames, paint says nothing: the lowest beams stand in the shade.
    """

    clear: float = 0.2
    post: float = 0.7
    post_in_gap: float = 0.45
    level: float = 0.8
    lost: float = 0.1
    faint: float = 0.05
    wide: float = 1.6
    narrow: float = 0.3
    strange: float = 0.3
    doubted: float = 0.6
    plain: float = 0.3
    painted: float = 0.4


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
        self.evidence, self.tracked, self.settings, self.cell = evidence, grid, settings, evidence.patch.cell
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
        return self._with_pieces(Grid(posts, [self._levels(pair) for pair in pairwise(posts)]))

    def _with_pieces(self, grid: Grid) -> Grid:
        """The grid with levels of which goods leave a few pieces, where the steps between those that the network sees say that one is hidden."""
        spans = [(float(left[1]), float(right[0])) for left, right in pairwise(grid.posts)]
        seen = [self._seen(span, levels) for span, levels in zip(spans, grid.sections, strict=True)]
        sections, found = [*grid.sections], list[tuple[int, Floats]]()
        for section, lower, usual in wide_steps([levels.mean(axis=1) for levels in seen]):
            below, above = seen[section][lower : lower + 2]
            level = self.pieces.level_between(spans[section], below, above, room=usual / EVEN)
            if level is None or self.rear.may_show(seen[section], float(level.mean())):
                continue
            own = sections[section]
            same = own[np.abs(own.mean(axis=1) - level.mean()) < self.tracked.thickness]
            level = same[0] if len(same) else level
            if not len(same):
                sections[section] = np.sort(np.concatenate([own, level[None]]), axis=0)
            found.append((section, level))
        pieces = frozenset((k, int(np.abs(sections[k][:, 0] - level[0]).argmin())) for k, level in found)
        return Grid(grid.posts, sections, pieces)

    def _seen(self, span: tuple[float, float], levels: Floats) -> Floats:
        """Those of levels (m, 2) between two posts that the network sees along a quarter of their length, or more."""
        return np.asarray(levels[_greatest(self._level_cover(*span), self.y, levels) >= QUARTER])

    @cached_property
    def pieces(self) -> Pieces:
        """The colours of what was tracked, and of the rest."""
        return Pieces(self.evidence, self.tracked)

    @cached_property
    def paint(self) -> Paint:
        """The paint of what was tracked."""
        return Paint(self.evidence, self.tracked)

    @cached_property
    def rear(self) -> RearFace:
        """Where the rear face's beams appear."""
        return RearFace(self.evidence, self.covers, self.tracked.sections, self.tracked.thickness)

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
        return _mean(self._standing_out(seen, weight, size, around, limit), weight, 1)

    def _standing_out(self, seen: Singles, weight: Singles, size: float, around: float, limit: float) -> Singles:
        """By how much, from 0 to 1, each cell of `seen` (n, m) stands out of what is usual in the rows around."""
        smooth = gaussian_filter1d(seen, size / 4 / self.cell, axis=0)
        usual = median_filter(_mean(smooth, weight, 1), max(3, round(0.7 * around / self.cell)))
        return np.asarray(np.clip((smooth - usual[:, None]) / max(limit, self.settings.faint), 0.0, 1.0), np.float32)

    def _shown(self, left: float, right: float, level: Floats) -> Floats:
        """Which columns (columns,), from 0 to 1, show a level between two posts: the others are hidden by goods, whose paint is their own."""
        columns, thickness = self._inside(left, right), self.tracked.thickness
        limit, where = self.settings.clear * self.usual_level, np.zeros(len(self.x))
        seen, weight = self.beam[:, columns], self.weight[:, columns]
        rows = (self.y > level[0]) & (self.y < level[1])
        where[columns] = self._standing_out(seen, weight, thickness, 8 * thickness, limit)[rows].max(
            axis=0, initial=0.0
        )
        return where

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
        """y (m, 2) of a section's beams: those that were tracked between the same posts and are not lost, and new ones. Between two racks that stand
        end to end, with a gap, there are none."""
        left, right = float(posts[0][1]), float(posts[1][0])
        cover, tracked = self._level_cover(left, right), self._tracked_between(*posts)
        if not len(tracked) and right - left < GAP * _usual_bay(self.tracked.posts):
            return tracked
        kept = [level for level in tracked if self._stays(cover, left, right, level)]
        taken = tracked.mean(axis=1).tolist()
        for row in _peaks(cover, self.settings.painted / 4):
            centre = float(self.y[row])
            near = min((abs(centre - other) for other in taken), default=np.inf) <= APART * self.tracked.thickness
            if not near and self._is_level(float(cover[row]), left, right, centre):
                taken.append(centre)
                kept.append(self._edges(cover, row, left, right))
        levels = np.array(kept).reshape(-1, 2)
        return levels[np.argsort(levels[:, 0])]

    def _stays(self, cover: Floats, left: float, right: float, level: Floats) -> bool:
        """Whether the evidence lets a level be that was tracked between two posts."""
        shown = float(_greatest(cover, self.y, level[None])[0])
        seen = self._level_strength(left, right, *level)
        strength, sure = seen / self.usual_level, shown > WHOLE and seen > SURE
        sunk = strength < FAINT and level.mean() < self.floor + SUNK * self.tracked.thickness
        like, plain = self._storey_likeness(left, right, level), shown > WHOLE or shown * strength > self.settings.plain
        strange = like < self.settings.strange or (like < self.settings.doubted and not plain)
        return shown >= self.settings.lost and not sunk and (sure or not strange)

    def _is_level(self, cover: float, left: float, right: float, centre: float) -> bool:
        """Whether a height at which nothing was tracked is a level's: by its cover, its paint, and where it is.

        Below the posts' feet are goods and markings; but a guard hides feet, and what is as strong there as the beams and painted like
        them in most sections is a beam: the paint of one section alone is judged by what the light and the goods there leave of it.
        """
        half, like = self.tracked.thickness / 2, self._likeness(left, right, centre)
        strong = self._level_strength(left, right, centre - half, centre + half) > STRONG * self.usual_level
        if centre <= self.floor + half:
            return cover > self.settings.level and self._usual_likeness(centre) >= ALIKE_BELOW and strong
        behind = not strong and self.rear.shows(self._tracked_beside(left, right), centre)
        if centre >= self.ceiling + half or like < self.settings.strange or behind:
            return False
        if cover >= self.settings.level:
            return self.paint.tells or self._is_plain(cover, left, right, centre)
        return like >= ALIKE and max(cover, self._usual_cover(centre)) >= self.settings.painted

    def _likeness(self, left: float, right: float, centre: float) -> float:
        """How like the tracked beams' the paint at a height is between two posts; neither like nor unlike where paint does not tell."""
        return self.paint.likeness(left, right, centre) if self.paint.tells else NEITHER

    def _storey_likeness(self, left: float, right: float, level: Floats) -> float:
        """How like the others' a level's paint is where it shows, in its own section, or usually in those where one was tracked at its height:
        goods shade a level in one of them."""
        centre, thickness = float(level.mean()), self.tracked.thickness
        spans = [(float(before[1]), float(after[0])) for before, after in pairwise(self.tracked.posts)]
        alike = [
            self._shown_likeness(*span, level)
            for span, levels in zip(spans, self.tracked.sections, strict=True)
            if len(levels) and np.abs(levels.mean(axis=1) - centre).min() < thickness
        ]
        return max(self._shown_likeness(left, right, level), float(np.median(alike)))

    def _shown_likeness(self, left: float, right: float, level: Floats) -> float:
        """As `_likeness`, of the columns that show a level between two posts."""
        if not self.paint.tells:
            return NEITHER
        return self.paint.likeness(left, right, float(level.mean()), self._shown(left, right, level))

    def _usual_likeness(self, centre: float) -> float:
        """How like the tracked beams' the paint at a height is in half of the sections at least."""
        spans = [(float(before[1]), float(after[0])) for before, after in pairwise(self.tracked.posts)]
        return float(np.median([self._likeness(*span, centre) for span in spans]))

    def _usual_cover(self, centre: float) -> float:
        """The cover at a height that half of the tracked sections have: levels often go on from bay to bay."""
        around = centre + self.tracked.thickness * np.array([[-0.5, 0.5]])
        return float(np.quantile([_greatest(cover, self.y, around)[0] for cover in self.covers], 0.5, method="higher"))

    def _is_plain(self, cover: float, left: float, right: float, centre: float) -> bool:
        """Whether a level shows all along, or is not faint for those that were tracked: stripes of other racks, seen through this, are."""
        half = self.tracked.thickness / 2
        strength = self._level_strength(left, right, centre - half, centre + half) / self.usual_level
        return cover > WHOLE or cover * strength > self.settings.plain

    @cached_property
    def covers(self) -> list[Floats]:
        """The covers (rows,) of levels in the sections that were tracked."""
        return [self._level_cover(float(left[1]), float(right[0])) for left, right in pairwise(self.tracked.posts)]

    def _edges(self, cover: Floats, row: int, left: float, right: float) -> Floats:
        """y (2,) of the edges of a level whose cover is greatest at a row: those of its paint where that is like the others', else where the
        cover is down to half, within reason."""
        centre, usual = float(self.y[row]), self.tracked.thickness
        if self._likeness(left, right, centre) >= ALIKE:
            low, high = self.paint.extent(left, right, centre)
        else:
            below = np.flatnonzero(cover < cover[row] / 2)
            first, last = below[below < row].max(initial=row - 1), below[below > row].min(initial=row + 1)
            low, high = centre + self.cell * (last - first - 1) / 2 * np.array([-1.0, 1.0])
        half = float(np.clip(high - low, 0.6 * usual, 1.4 * usual)) / 2
        return np.asarray((low + high) / 2 + half * np.array([-1.0, 1.0]))

    def _tracked_beside(self, left: float, right: float) -> Floats:
        """The levels of the tracked section that the middle between two posts lies in; none beyond the ends."""
        section = int(np.searchsorted(self.tracked.posts.mean(axis=1), (left + right) / 2)) - 1
        inside = 0 <= section < len(self.tracked.sections)
        return self.tracked.sections[section] if inside else np.zeros((0, 2))

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
