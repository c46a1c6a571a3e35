"""Uprights and beams in the evidence of all frames: columns of the face are searched for posts, rows between posts for levels.

This is the published density estimate (paper, III.D), over every pixel of every frame instead of over edges of single frames. The evidence
of the tracked posts and levels sets the scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter

from savmap.types import Bools, Floats, PlaneEvidence
from savmap_shelves.evidence.face_grid import BEYOND, Grid
from savmap_shelves.evidence.overhead import POST_SHOWN, overhead_levels, without_overhead
from savmap_shelves.evidence.paint import CORE, Paint
from savmap_shelves.evidence.pieces import Pieces
from savmap_shelves.evidence.rear import RearFace
from savmap_shelves.evidence.strength import (
    Singles,
    across_of,
    heights_of,
    level_strength,
    post_heights,
    seen_mean,
)
from savmap_shelves.evidence.wide_steps import EVEN, wide_steps

BODY = (0.12, 0.92)
APART, FAINT, SUNK, THIN, TWO = 1.5, 0.52, 0.25, 0.8, 1.6
SIMILAR, NEITHER, STRONG, WHOLE, SURE = 0.95, 0.8, 0.6, 0.9, 0.95
SIMILAR_BELOW = 0.85
GAP = 0.3
ROOM = 3.0
"""Two beams of a section are at least so many thicknesses apart: nothing fits between nearer ones."""
QUARTER = 0.25
UNEVEN = 0.4
"""The height of a stripe of paint may differ by this share from that of the beams."""


@dataclass(frozen=True)
class EvidenceSettings:
    """Thresholds of the evidence.

    The cover of a post or level is the share of its length along which the evidence exceeds that of its surroundings by `clear` times the
    usual strength of the tracked ones. A faint object along the whole length has full cover. A strong but shorter one has not.

    - `post`, `level`: least cover of a new post or level. `post_in_gap`: that of a post in a bay so wide that one is missing.
    - `lowest`: that of a new level where its section has none as low as those of the other sections are.
    - `lost`: a tracked post or level with less cover is dropped.
    - `faint`: the least strength that counts as usual.
    - `wide`: a bay of this multiple of the narrowest one may lack a post. `narrow`: posts nearer than this share of a bay are one.

    The others apply where paint is informative (`Paint.is_informative`). Similarity is 1 for the paint of beams, 0 for the rest of the face.

    - `strange`: below this similarity there is no level.
    - `doubted`: below this one there is none, unless it has cover along the whole length, or cover times strength above `plain`.
    - `painted`: the cover, in its own section or in half of the sections, that suffices for a level with the paint of the beams.

    Paint does not count where the network is sure along the whole length: the lowest beams stand in the shade.
    """

    clear: float = 0.2
    post: float = 0.7
    post_in_gap: float = 0.45
    level: float = 0.8
    lowest: float = 0.5
    lost: float = 0.1
    faint: float = 0.05
    wide: float = 1.6
    narrow: float = 0.3
    strange: float = 0.3
    doubted: float = 0.6
    plain: float = 0.3
    painted: float = 0.4


def expected_grid(
    evidence: PlaneEvidence, grid: Grid, settings: EvidenceSettings | None = None, floor: float | None = None
) -> Grid | None:
    """The grid by the evidence. None where it is the tracked one. `floor`: the y of the floor; None where the pictures do not tell it."""
    expected = GridSearch(evidence, grid, settings or EvidenceSettings(), floor).grid()
    same_posts = len(expected.posts) == len(grid.posts) and np.allclose(expected.posts, grid.posts)
    is_same = same_posts and all(
        len(a) == len(b) and np.allclose(a, b) for a, b in zip(expected.sections, grid.sections, strict=True)
    )
    return None if is_same else expected


class GridSearch:
    """The search for posts and levels in a face's evidence."""

    def __init__(
        self, evidence: PlaneEvidence, grid: Grid, settings: EvidenceSettings, floor: float | None = None
    ) -> None:
        self.evidence, self.tracked, self.settings, self.cell = evidence, grid, settings, evidence.patch.cell
        self.measured_floor = floor
        self.x, self.y = across_of(evidence), heights_of(evidence)
        self.upright, self.beam, self.weight = evidence.of("upright"), evidence.of("beam"), evidence.weight
        self.usual_post = self._usual([self._post_strength(*post) for post in grid.posts])
        self.usual_level = self._usual(
            [
                self._level_strength(float(left[1]), float(right[0]), *level)
                for (left, right), levels in zip(pairwise(grid.posts), grid.sections, strict=True)
                for level in levels
            ]
        )
        self.overhead = overhead_levels(evidence, grid, self.usual_level, self.usual_post)
        self.tracked = without_overhead(grid, self.overhead)

    def grid(self) -> Grid:
        """The grid by the evidence."""
        posts = self._with_ends(self._posts())
        found = Grid(posts, [self._levels(pair) for pair in pairwise(posts)])
        overhead = overhead_levels(self.evidence, found, self.usual_level, self.usual_post, self.tracked)
        return self._with_pieces(without_overhead(found, overhead))

    def _with_pieces(self, grid: Grid) -> Grid:
        """The grid, with levels of which goods leave only a few pieces visible. These are searched where a step between visible levels is too wide."""
        spans = [(float(left[1]), float(right[0])) for left, right in pairwise(grid.posts)]
        visible = [self._visible_levels(span, levels) for span, levels in zip(spans, grid.sections, strict=True)]
        sections, in_pieces = [*grid.sections], list[tuple[int, Floats]]()
        for section, lower, usual in wide_steps([levels.mean(axis=1) for levels in visible]):
            below, above = visible[section][lower : lower + 2]
            level = self.pieces.level_between(spans[section], below, above, room=usual / EVEN)
            if level is None or self.rear.may_show(visible[section], float(level.mean())):
                continue
            section_levels = sections[section]
            coincident = section_levels[np.abs(section_levels.mean(axis=1) - level.mean()) < self.tracked.thickness]
            level = coincident[0] if len(coincident) else level
            if not len(coincident):
                sections[section] = np.sort(np.concatenate([section_levels, level[None]]), axis=0)
            in_pieces.append((section, level))
        pieces = frozenset((k, int(np.abs(sections[k][:, 0] - level[0]).argmin())) for k, level in in_pieces)
        return Grid(grid.posts, sections, pieces)

    def _visible_levels(self, span: tuple[float, float], levels: Floats) -> Floats:
        """Those of levels (m, 2) between two posts that have a cover of `QUARTER` or more."""
        return np.asarray(levels[_greatest(self._level_cover(*span), self.y, levels) >= QUARTER])

    @cached_property
    def pieces(self) -> Pieces:
        """The colours of the face, with the tracked grid."""
        return Pieces(self.evidence, self.tracked)

    @cached_property
    def paint(self) -> Paint:
        """The paint of the tracked beams."""
        return Paint(self.evidence, self.tracked)

    @cached_property
    def rear(self) -> RearFace:
        """Where the rear face's beams appear."""
        return RearFace(self.evidence, self.covers, self.tracked.sections, self.tracked.thickness)

    @cached_property
    def feet(self) -> float:
        """y of the posts' feet. A quantile, because a guard hides some feet."""
        return float(np.quantile([self._reach(*post)[0] for post in self.tracked.posts], 0.25, method="lower"))

    @property
    def floor(self) -> float:
        """y of the floor: goods and markings below may look like a level. Guards may hide all feet."""
        return self.feet if self.measured_floor is None else min(self.feet, self.measured_floor)

    @cached_property
    def lowest(self) -> list[float]:
        """y of the lowest level of each tracked section, inf for one without any. Where guards hide the feet, what shows between these and the floor is one."""
        found = [float(levels.mean(axis=1).min()) if len(levels) else np.inf for levels in self.tracked.sections]
        hidden = (self.y > self.floor + self.tracked.thickness) & (self.y < self.feet)
        for section, cover in enumerate(self.covers):
            peaks = [float(self.y[row]) for row in _peaks(cover, self.settings.lowest) if hidden[row]]
            found[section] = min([found[section], *peaks])
        return found

    @cached_property
    def ceiling(self) -> float:
        """y of the posts' tops: what lies above is of the roof. A quantile, because goods hide some tops."""
        return float(np.quantile([self._reach(*post)[1] for post in self.tracked.posts], 0.75))

    def _reach(self, low: float, high: float) -> tuple[float, float]:
        """Lowest and highest y at which a post shows. The highest is at least the top of the tracked levels."""
        shown = post_heights(self.evidence, np.array([low, high]), POST_SHOWN * self.usual_post)
        return float(shown.min(initial=self.tracked.top)), float(shown.max(initial=self.tracked.top))

    def _usual(self, strengths: Sequence[float]) -> float:
        return max(float(np.median(strengths)), self.settings.faint)

    def _post_strength(self, low: float, high: float) -> float:
        rows, columns = self._body(), (self.x > low) & (self.x < high)
        return float(seen_mean(self.upright[rows], self.weight[rows], 0)[columns].max(initial=0.0))

    def _level_strength(self, left: float, right: float, low: float, high: float) -> float:
        room = self.tracked.thickness / 4
        return level_strength(self.evidence, self._inside(left, right), low - room, high + room)

    def _body(self) -> Bools:
        """The rows between the lowest and the highest beams."""
        bottom = min(float(levels.min()) for levels in self.tracked.sections if len(levels))
        low, high = bottom + np.array(BODY) * (self.tracked.top - bottom)
        return np.asarray((self.y > low) & (self.y < high))

    def _inside(self, left: float, right: float) -> Bools:
        """The columns between two posts, without a margin beside them."""
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

    def _cover(self, evidence: Singles, weight: Singles, size: float, around: float, limit: float) -> Floats:
        """The cover (n,) of each row of `evidence` (n, m), for objects of a size and a limit that the evidence must stand out by."""
        return seen_mean(self._standing_out(evidence, weight, size, around, limit), weight, 1)

    def _standing_out(self, evidence: Singles, weight: Singles, size: float, around: float, limit: float) -> Singles:
        """The excess (n, m), from 0 to 1 at the limit, of each cell of `evidence` over the median of the rows around."""
        smooth = gaussian_filter1d(evidence, size / 4 / self.cell, axis=0)
        usual = median_filter(seen_mean(smooth, weight, 1), max(3, round(0.7 * around / self.cell)))
        return np.asarray(np.clip((smooth - usual[:, None]) / max(limit, self.settings.faint), 0.0, 1.0), np.float32)

    def _shown(self, left: float, right: float, level: Floats) -> Floats:
        """The weight (columns,), from 0 to 1, of the columns that show a level between two posts. Goods, with a paint of their own, hide the others."""
        columns, thickness = self._inside(left, right), self.tracked.thickness
        limit, where = self.settings.clear * self.usual_level, np.zeros(len(self.x))
        evidence, weight = self.beam[:, columns], self.weight[:, columns]
        rows = (self.y > level[0]) & (self.y < level[1])
        where[columns] = self._standing_out(evidence, weight, thickness, 8 * thickness, limit)[rows].max(
            axis=0, initial=0.0
        )
        return where

    def _posts(self) -> Floats:
        """x (k, 2) of the posts between the first and the last tracked one: tracked ones that are not lost, new ones, and less certain ones in
        bays so wide that a post is missing."""
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
        """x (k,) of the local maxima of the cover, the greatest first."""
        columns = [column for column in _peaks(cover, least) if within[column]]
        return np.asarray(self.x[columns])

    def _joined(self, posts: Floats, centres: Floats) -> Floats:
        """Posts, and new ones of the usual width at those centres where no post is near."""
        apart = max(self.settings.narrow * _usual_bay(posts), 2 * self.tracked.width)
        for centre in centres:
            if np.abs(posts.mean(axis=1) - centre).min() > apart:
                post = centre + self.tracked.width * np.array([-0.5, 0.5])
                posts = np.concatenate([posts, post[None]])
        return posts[np.argsort(posts[:, 0])]

    def _with_ends(self, posts: Floats) -> Floats:
        """Posts, and one more at either end, if most levels of the outermost section continue to it."""
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
        covered = _greatest(self._level_cover(left, right), self.y, levels) > self.settings.level
        return float(covered.mean()) > 0.5

    def _levels(self, posts: tuple[Floats, Floats]) -> Floats:
        """y (m, 2) of a section's beams: those tracked between the same posts that are not lost, and new ones. None in the gap between two racks
        that stand end to end."""
        left, right = float(posts[0][1]), float(posts[1][0])
        cover, tracked = self._level_cover(left, right), self._tracked_between(*posts)
        if not len(tracked) and right - left < GAP * _usual_bay(self.tracked.posts):
            return tracked
        kept = [self._at_its_paint(left, right, level) for level in tracked if self._stays(cover, left, right, level)]
        kept = [level for level in kept if not self._is_double(cover, left, right, level, kept)]
        taken = [*tracked.mean(axis=1).tolist(), *np.concatenate(self.overhead).mean(axis=1).tolist()]
        for row in _peaks(cover, self.settings.painted / 4):
            centre = float(self.y[row])
            near = min((abs(centre - other) for other in taken), default=np.inf) <= APART * self.tracked.thickness
            if not near and self._is_level(float(cover[row]), left, right, centre):
                taken.append(centre)
                kept.append(self._edges(cover, row, left, right))
        levels = np.array(kept).reshape(-1, 2)
        return levels[np.argsort(levels[:, 0])]

    def _stays(self, cover: Floats, left: float, right: float, level: Floats) -> bool:
        """Whether a level that was tracked between two posts is kept."""
        shown = float(_greatest(cover, self.y, level[None])[0])
        beam_strength = self._level_strength(left, right, *level)
        strength, sure = beam_strength / self.usual_level, shown > WHOLE and beam_strength > SURE
        sunk = strength < FAINT and level.mean() < self.floor + SUNK * self.tracked.thickness
        similarity = self._storey_similarity(left, right, level)
        plain = shown > WHOLE or shown * strength > self.settings.plain
        strange = similarity < self.settings.strange or (similarity < self.settings.doubted and not plain)
        behind = strength < FAINT and self._is_behind(left, right, level)
        return shown >= self.settings.lost and not sunk and not behind and (sure or not strange)

    def _at_its_paint(self, left: float, right: float, level: Floats) -> Floats:
        """y (2,) of a level that was tracked between two posts: where none of its own rows has the paint of beams, and a stripe of this paint as high as
        a beam adjoins, that stripe. What lies right below or above a beam, such as a wall in its shade, was tracked instead."""
        if not self.paint.is_informative:
            return level
        centre, height = float(level.mean()), float(np.ptp(level))
        if self.paint.similarity(left, right, centre, reach=CORE / 2 * height) >= self.settings.strange:
            return level
        stripe = self._stripe(left, right, centre, height / 2 + self.tracked.thickness)
        return level if stripe is None else stripe

    def _stripe(self, left: float, right: float, centre: float, reach: float) -> Floats | None:
        """y (2,) of the stripe of beams' paint within `reach` of a height between two posts; None where there is none, or it is not as high as a beam."""
        if self.paint.similarity(left, right, centre, reach=reach) < self.settings.doubted:
            return None
        stripe = self.paint.extent(left, right, centre, reach)
        return stripe if np.abs(np.ptp(stripe) / self.tracked.thickness - 1) < UNEVEN else None

    def _is_behind(self, left: float, right: float, level: Floats) -> bool:
        """Whether a level that was tracked is thin, as what is farther away looks, and at a height where the rear one of another level of its section appears."""
        levels = self._tracked_beside(left, right)
        others = levels[np.abs(levels.mean(axis=1) - level.mean()) > self.tracked.thickness]
        thin = level[1] - level[0] < THIN * self.tracked.thickness
        return bool(thin and self.rear.shows(others, float(level.mean())))

    def _is_double(self, cover: Floats, left: float, right: float, level: Floats, levels: Sequence[Floats]) -> bool:
        """Whether a level that shows in part is so near to a stronger one of its section that one beam was taken for two: goods hid a part of it,
        and their edge was taken for the rest."""
        room = ROOM * self.tracked.thickness
        near = [other for other in levels if 0 < abs(other.mean() - level.mean()) < room]
        if not near or _greatest(cover, self.y, level[None])[0] > WHOLE:
            return False
        strengths = [self._level_strength(left, right, *other) for other in near]
        return max(strengths) > self._level_strength(left, right, *level)

    def _is_level(self, cover: float, left: float, right: float, centre: float) -> bool:
        """Whether there is a level at a height where none was tracked: by its cover, its paint, and its height.

        Below the posts' feet are goods and markings. But guards may hide feet: a stripe there that is as strong as the beams, and painted like
        them in half of the sections, is a beam. One section alone does not decide, because goods and shade change its paint. So is one that is seen along
        the whole length where the section lacks its lowest beam.
        """
        half, similarity = self.tracked.thickness / 2, self._paint_similarity(left, right, centre)
        strong = self._level_strength(left, right, centre - half, centre + half) > STRONG * self.usual_level
        if centre <= self.floor + half:
            painted = cover > self.settings.level and self._usual_similarity(centre) >= SIMILAR_BELOW
            return strong and (painted or (cover > WHOLE and self._lacks_lowest(left, right, centre)))
        behind = not strong and self.rear.shows(self._tracked_beside(left, right), centre)
        if centre >= self.ceiling + half or similarity < self.settings.strange or behind:
            return False
        if cover >= self.settings.lowest and self._lacks_lowest(left, right, centre):
            return True
        if cover >= self.settings.level:
            return self.paint.is_informative or self._is_plain(cover, left, right, centre)
        return similarity >= SIMILAR and max(cover, self._usual_cover(centre)) >= self.settings.painted

    def _lacks_lowest(self, left: float, right: float, centre: float) -> bool:
        """Whether a level between two posts would be the lowest of its section, where the other sections have theirs."""
        own, section = self._tracked_beside(left, right), self._section_at(left, right)
        if not len(own):
            return False
        others = np.array([y for number, y in enumerate(self.lowest) if number != section and np.isfinite(y)])
        step, room = float(own.mean(axis=1).min()) - centre, ROOM * self.tracked.thickness
        near = np.abs(others - centre) < max(room, QUARTER * step)
        return len(near) > 1 and step > room and bool(near.mean() >= 0.5)

    def _paint_similarity(self, left: float, right: float, centre: float) -> float:
        """The similarity of the paint at a height between two posts to the tracked beams'; `NEITHER` where paint is not informative."""
        return self.paint.similarity(left, right, centre) if self.paint.is_informative else NEITHER

    def _storey_similarity(self, left: float, right: float, level: Floats) -> float:
        """The similarity of a level's paint where it shows: the greater of that in its own section and the median of the sections with a tracked
        level at its height. Goods may shade a level in one section."""
        centre, thickness = float(level.mean()), self.tracked.thickness
        spans = [(float(before[1]), float(after[0])) for before, after in pairwise(self.tracked.posts)]
        similarities = [
            self._shown_similarity(*span, level)
            for span, levels in zip(spans, self.tracked.sections, strict=True)
            if len(levels) and np.abs(levels.mean(axis=1) - centre).min() < thickness
        ]
        return max(self._shown_similarity(left, right, level), float(np.median(similarities)))

    def _shown_similarity(self, left: float, right: float, level: Floats) -> float:
        """As `_paint_similarity`, over the columns that show a level between two posts."""
        if not self.paint.is_informative:
            return NEITHER
        return self.paint.similarity(left, right, float(level.mean()), self._shown(left, right, level))

    def _usual_similarity(self, centre: float) -> float:
        """The median over the sections of the similarity of the paint at a height to the tracked beams'."""
        spans = [(float(before[1]), float(after[0])) for before, after in pairwise(self.tracked.posts)]
        return float(np.median([self._paint_similarity(*span, centre) for span in spans]))

    def _usual_cover(self, centre: float) -> float:
        """The upper median over the tracked sections of the cover at a height: levels often continue from bay to bay."""
        around = centre + self.tracked.thickness * np.array([[-0.5, 0.5]])
        return float(np.quantile([_greatest(cover, self.y, around)[0] for cover in self.covers], 0.5, method="higher"))

    def _is_plain(self, cover: float, left: float, right: float, centre: float) -> bool:
        """Whether a level has cover along the whole length, or is not faint against the tracked ones. Stripes of racks behind are faint."""
        half = self.tracked.thickness / 2
        strength = self._level_strength(left, right, centre - half, centre + half) / self.usual_level
        return cover > WHOLE or cover * strength > self.settings.plain

    @cached_property
    def covers(self) -> list[Floats]:
        """The covers (rows,) of levels in the sections that were tracked."""
        return [self._level_cover(float(left[1]), float(right[0])) for left, right in pairwise(self.tracked.posts)]

    def _edges(self, cover: Floats, row: int, left: float, right: float) -> Floats:
        """y (2,) of the edges of a level whose cover has its maximum at a row: those of its paint where that is similar, 0.6 to 1.4 of the usual height
        apart, or as high as a beam; else around the row, 0.6 of it apart, which is surely of the level. What shows as high as two, one of which lies behind, is the other one.
        What is painted alike and higher than three goes on into something else, such as a grey floor."""
        centre, usual = float(self.y[row]), self.tracked.thickness
        if self._paint_similarity(left, right, centre) >= SIMILAR:
            low, high = self.paint.extent(left, right, centre)
            half = float(np.clip(high - low, (1 - UNEVEN) * usual, (1 + UNEVEN) * usual)) / 2
            if high - low < ROOM * usual:
                return np.asarray((low + high) / 2 + half * np.array([-1.0, 1.0]))
        elif self.paint.is_informative and (stripe := self._stripe(left, right, centre, usual)) is not None:
            return stripe
        front = self._before_the_rear(cover, row, self._tracked_beside(left, right))
        return np.asarray(centre + 0.6 * usual / 2 * np.array([-1.0, 1.0])) if front is None else front

    def _before_the_rear(self, cover: Floats, row: int, levels: Floats) -> Floats | None:
        """y (2,) of the level in a stripe around a row that is as high as two, where the other one is the rear beam of one of a section's levels; None where
        neither is, or both are."""
        shown = cover >= cover[row] / 2
        around = self.y[np.flatnonzero(np.cumsum(~shown) == np.cumsum(~shown)[row])]
        low, high, size = float(around.min()), float(around.max()), np.array([0.0, self.tracked.thickness])
        if high - low < TWO * self.tracked.thickness:
            return None
        front = [level for level in (low + size, high - size[::-1]) if not self.rear.shows(levels, float(level.mean()))]
        return front[0] if len(front) == 1 else None

    def _tracked_beside(self, left: float, right: float) -> Floats:
        """The levels of the tracked section in which the middle between two posts lies; none beyond the ends."""
        section = self._section_at(left, right)
        inside = 0 <= section < len(self.tracked.sections)
        return self.tracked.sections[section] if inside else np.zeros((0, 2))

    def _section_at(self, left: float, right: float) -> int:
        """The number of the tracked section in which the middle between two posts lies, beyond the range of these outside of the row."""
        return int(np.searchsorted(self.tracked.posts.mean(axis=1), (left + right) / 2)) - 1

    def _tracked_between(self, left: Floats, right: Floats) -> Floats:
        for posts, levels in zip(pairwise(self.tracked.posts), self.tracked.sections, strict=True):
            if np.allclose(posts[0], left) and np.allclose(posts[1], right):
                return levels
        return np.zeros((0, 2))


def _greatest(cover: Floats, places: Floats, intervals: Floats) -> Floats:
    """The greatest cover (k,) within intervals (k, 2) of places, or beside them by half their length."""
    margin = np.diff(intervals, axis=1) / 2
    inside = (places > intervals[:, :1] - margin) & (places < intervals[:, 1:] + margin)
    return np.asarray(np.where(inside, cover, 0.0).max(axis=1, initial=0.0))


def _peaks(cover: Floats, least: float) -> list[int]:
    """The indices of the smoothed cover's local maxima where the cover is at least `least`, the greatest first."""
    rounded = np.round(gaussian_filter1d(cover, 1.0), 6)
    inner = (rounded[1:-1] >= rounded[:-2]) & (rounded[1:-1] > rounded[2:])
    peaks = np.flatnonzero(inner & (cover[1:-1] >= least)) + 1
    return [int(k) for k in peaks[np.argsort(-rounded[peaks], kind="stable")]]


def _usual_bay(posts: Floats) -> float:
    return float(np.median(np.diff(posts.mean(axis=1))))
