"""The levels of a bay: the rows between two posts are searched for them."""

from collections.abc import Sequence

import numpy as np

from savmap.types import Floats
from savmap_shelves.evidence.face_grid import ROOM, span_of
from savmap_shelves.evidence.search.covers import greatest, peaks
from savmap_shelves.evidence.search.face import Face
from savmap_shelves.evidence.search.paint import CORE

GAP = 0.3
"""What is narrower than this share of a bay is the gap between two racks."""
APART = 1.5
"""New levels are farther than so many thicknesses from others."""
FAINT, SUNK = 0.52, 0.25
"""A level with less than that share of the usual strength is none if it lies behind, or lower than that share of a thickness above the floor."""
THIN, TWO = 0.8, 1.6
"""What is thinner than that share of a beam looks farther away; what is as high as that many is two."""
SIMILAR, SIMILAR_BELOW = 0.95, 0.85
"""The similarity of paint that tells of a beam; below the posts' feet, over all bays."""
STRONG, WHOLE, SURE = 0.6, 0.9, 0.95
"""The share of the usual strength that is a strong one; the cover that is one along the whole length; the evidence that makes sure."""
HALF = 0.5
"""Lowest levels are where the bays have them of which so many do."""
STEP_SHARE = 0.25
"""A level is where the other bays have theirs within such a share of the step to the next one above."""
FEW = 0.25
"""The network sees something of a stripe where its rows have so much cover."""
UNEVEN = 0.4
"""The height of a stripe of paint may differ by this share from that of the beams."""


class Section:
    """What is between two posts (2,) of a face. `cover` (rows,): that of levels. `beside` (m, 2): the levels of the tracked bay in which its middle
    lies, none beyond the ends; `tracked`: these if it has the same posts."""

    def __init__(self, face: Face, posts: tuple[Floats, Floats]) -> None:
        self.face, self.settings, self.thickness = face, face.settings, face.tracked.thickness
        self.span = span_of(posts)
        self.cover = face.level_cover(self.span)
        self.number = int(np.searchsorted(face.tracked.posts.mean(axis=1), sum(self.span) / 2)) - 1
        inside = 0 <= self.number < len(face.tracked.sections)
        self.beside = face.tracked.sections[self.number] if inside else np.zeros((0, 2))
        same = inside and np.allclose(face.tracked.posts[self.number : self.number + 2], posts)
        self.tracked = self.beside if same else np.zeros((0, 2))

    def expected_levels(self) -> Floats:
        """y (m, 2) of the bay's beams: those tracked between the same posts that are not lost, and new ones. None in the gap between two racks
        that stand end to end, and no new ones where something runs overhead in any bay."""
        left, right = self.span
        if not len(self.tracked) and right - left < GAP * self.face.tracked.bay:
            return self.tracked
        kept = [level for level in self.tracked if self._stays(level)]
        kept = self._at_their_paint([level for level in kept if not self._is_double(level, kept)])
        taken = [float(level.mean()) for level in (*self.tracked, *np.concatenate(self.face.overhead), *kept)]
        for row in peaks(self.cover, self.settings.painted / 4):
            centre = float(self.face.y[row])
            near = min((abs(centre - other) for other in taken), default=np.inf) <= APART * self.thickness
            if not near and self._is_level(row, kept):
                taken.append(centre)
                kept.append(self._edges(row))
        levels = np.array(kept).reshape(-1, 2)
        return levels[np.argsort(levels[:, 0])]

    def level_between(self, below: Floats, above: Floats, room: float, least: float) -> Floats | None:
        """y (2,) of the level that shows most between levels `below` and `above` (2,), farther than `room` from both, in a step that lacks one. None
        where none has the `least` cover, or what shows is strange or of the rear face."""
        low, high = below.mean() + room, above.mean() - room
        for row in peaks(self.cover, least):
            centre = float(self.face.y[row])
            if low < centre < high:
                strange = self.face.similarity(self.span, centre) < self.settings.strange
                return None if strange or self.face.rear.shows(self.beside, centre) else self._edges(row)
        return None

    def _stays(self, level: Floats) -> bool:
        """Whether a level that was tracked is kept."""
        shown, strength = self._cover_at(level), self._strength(level) / self.face.usual_level
        sunk = strength < FAINT and level.mean() < self.face.floor + SUNK * self.thickness
        similarity = self.face.storey_similarity(self.span, level)
        plain = shown > WHOLE or shown * strength > self.settings.plain
        strange = similarity < self.settings.strange or (similarity < self.settings.doubted and not plain)
        behind = strength < FAINT and (self._is_behind(level) or self._is_far(level))
        return shown >= self.settings.lost and not sunk and not behind and (self._is_sure(level) or not strange)

    def _is_sure(self, level: Floats) -> bool:
        """Whether the network is sure of a level along the whole length."""
        return self._cover_at(level) > WHOLE and self._strength(level) > SURE

    def _is_behind(self, level: Floats) -> bool:
        """Whether a level that was tracked is thin, as what is farther away looks, and at a height where the rear one of another level of its bay appears."""
        others = self.beside[np.abs(self.beside.mean(axis=1) - level.mean()) > self.thickness]
        return self._is_thin(level) and self.face.rear.shows(others, float(level.mean()))

    def _is_far(self, level: Floats) -> bool:
        """Whether a level that was tracked is thin along the whole length, as a beam of another rack looks through an open bay, and not where the lowest
        ones are: these stand in the shade."""
        room = ROOM * self.thickness
        lowest = np.abs(self._others_lowest() - level.mean()) < room
        return self._is_thin(level) and self._cover_at(level) > WHOLE and not (len(lowest) and lowest.mean() >= HALF)

    def _is_thin(self, level: Floats) -> bool:
        """Whether a level that was tracked is as thin as what is farther away looks."""
        return bool(level[1] - level[0] < THIN * self.thickness)

    def _is_double(self, level: Floats, levels: Sequence[Floats]) -> bool:
        """Whether a level that shows in part is so near to a stronger one of its bay that one beam was taken for two: goods hid a part of it,
        and their edge was taken for the rest. Its middle tells: what adjoins a beam borrows the beam's evidence at its edge."""
        near = [other for other in levels if 0 < abs(other.mean() - level.mean()) < ROOM * self.thickness]
        if not near or self.cover[np.abs(self.face.y - level.mean()).argmin()] > WHOLE:
            return False
        strength, *others = (self._strength(y.mean() + CORE * (y - y.mean())) for y in (level, *near))
        return max(others) > strength

    def _at_their_paint(self, levels: Sequence[Floats]) -> list[Floats]:
        """Levels (2,) that were tracked, each where its paint is, without those that come to lie on another one."""
        placed = list[Floats]()
        for number, level in enumerate(levels):
            moved = self._at_its_paint(level)
            others = [float(other.mean()) for k, other in enumerate(levels) if k != number]
            if moved is level or all(abs(moved.mean() - other) > APART * self.thickness for other in others):
                placed.append(moved)
        return placed

    def _at_its_paint(self, level: Floats) -> Floats:
        """y (2,) of a level that was tracked: where none of its own rows has the paint of beams, and a stripe of this paint as high as a beam adjoins
        which the network sees, too, that stripe. What lies right below or above a beam, such as a wall in its shade, was tracked instead. A level that
        the network is sure of stays."""
        paint, centre, height = self.face.paint, float(level.mean()), float(np.ptp(level))
        if not paint.is_informative or self._is_sure(level):
            return level
        if paint.similarity(*self.span, centre, reach=CORE / 2 * height) >= self.settings.strange:
            return level
        stripe = self._stripe(centre, height / 2 + self.thickness)
        return level if stripe is None or self._cover_in(stripe) < FEW else stripe

    def _stripe(self, centre: float, reach: float) -> Floats | None:
        """y (2,) of the stripe of beams' paint within `reach` of a height; None where there is none, or it is not as high as a beam."""
        paint = self.face.paint
        if not paint.is_informative or paint.similarity(*self.span, centre, reach=reach) < self.settings.doubted:
            return None
        stripe = paint.extent(*self.span, centre, reach)
        return stripe if abs(float(np.ptp(stripe)) / self.thickness - 1) < UNEVEN else None

    def _is_level(self, row: int, known: Sequence[Floats]) -> bool:
        """Whether there is a level at a row where none was tracked: by its cover, its paint, and its height. `known`: y (2,) of those that were found so far.

        Below the posts' feet are goods and markings. But guards may hide feet: a stripe there that is as strong as the beams, and painted like
        them in half of the bays, is a beam. One bay alone does not decide, because goods and shade change its paint. So is one that is seen along
        the whole length where the bay lacks its lowest beam.
        """
        face, settings, half = self.face, self.settings, self.thickness / 2
        cover, centre = float(self.cover[row]), float(face.y[row])
        strength = self._strength(centre + half * np.array([-1.0, 1.0])) / face.usual_level
        similarity, strong = face.similarity(self.span, centre), strength > STRONG
        if centre <= face.floor + half:
            painted = cover > settings.level and face.usual_similarity(centre) >= SIMILAR_BELOW
            return strong and (painted or (cover > WHOLE and self._lacks_lowest(centre, known)))
        behind = not strong and face.rear.shows(self.beside, centre)
        if centre >= face.ceiling + half or similarity < settings.strange or behind:
            return False
        if cover >= settings.lacking and self._lacks_lowest(centre, known):
            return True
        if cover >= settings.partly and self._lacks_highest(centre, known):
            return True
        if cover >= settings.level:
            return face.paint.is_informative or cover > WHOLE or cover * strength > settings.plain
        return similarity >= SIMILAR and max(cover, face.usual_cover(centre)) >= settings.painted

    def _lacks_lowest(self, centre: float, known: Sequence[Floats]) -> bool:
        """Whether a level would be the lowest of its bay, where half of the other bays, and two at least, have theirs."""
        steps = np.array([float(y.mean()) - centre for y in (*self.beside, *known)])
        return self._is_outermost(centre, steps, self._others_lowest())

    def _lacks_highest(self, centre: float, known: Sequence[Floats]) -> bool:
        """Whether a level would be the highest of its bay, where half of the other bays, and two at least, have theirs."""
        steps = np.array([centre - float(y.mean()) for y in (*self.beside, *known)])
        others = (y for number, y in enumerate(self.face.tracked.sections) if number != self.number and len(y))
        return self._is_outermost(centre, steps, np.array([y.mean(axis=1).max() for y in others]))

    def _is_outermost(self, centre: float, steps: Floats, others: Floats) -> bool:
        """Whether a level whose steps (m,) to those of its bay are all wide is as high as half of the other bays' (n,) are, and two at least."""
        if not len(self.beside):
            return False
        step, room = float(steps.min()), ROOM * self.thickness
        near = np.abs(others - centre) < max(room, STEP_SHARE * step)
        return len(near) > 1 and step > room and bool(near.mean() >= HALF)

    def _others_lowest(self) -> Floats:
        """y (n,) of the lowest level of each other bay that has any."""
        return np.array([y for number, y in enumerate(self.face.lowest) if number != self.number and np.isfinite(y)])

    def _edges(self, row: int) -> Floats:
        """y (2,) of the edges of a level whose cover has its maximum at a row: those of its paint where that is similar, 0.6 to 1.4 of the usual height
        apart, or as high as a beam; else around the row, 0.6 of it apart, which is surely of the level. What shows as high as two, one of which lies
        behind, is the other one. What is painted alike and higher than three goes on into something else, such as a grey floor."""
        centre, usual, both = float(self.face.y[row]), self.thickness, np.array([-0.5, 0.5])
        least, most = (1 - UNEVEN) * usual, (1 + UNEVEN) * usual
        if self.face.similarity(self.span, centre) >= SIMILAR:
            stripe = self.face.paint.extent(*self.span, centre)
            height = float(np.ptp(stripe))
            if height < ROOM * usual:
                return np.asarray(stripe.mean() + np.clip(height, least, most) * both)
        elif (stripe_of_beam := self._stripe(centre, usual)) is not None:
            return stripe_of_beam
        front = self._before_the_rear(row)
        return np.asarray(centre + least * both) if front is None else front

    def _before_the_rear(self, row: int) -> Floats | None:
        """y (2,) of the level in a stripe around a row that is as high as two, where the other one is the rear beam of one of the bay's levels; None where
        neither is, or both are."""
        gaps = np.cumsum(self.cover < self.cover[row] / 2)
        around = self.face.y[(gaps == gaps[row]) & (self.cover >= self.cover[row] / 2)]
        low, high, size = float(around.min()), float(around.max()), np.array([0.0, self.thickness])
        if high - low < TWO * self.thickness:
            return None
        rear = self.face.rear
        front = [level for level in (low + size, high - size[::-1]) if not rear.shows(self.beside, float(level.mean()))]
        return front[0] if len(front) == 1 else None

    def _cover_in(self, stripe: Floats) -> float:
        """The mean cover of the rows of a stripe (2,)."""
        return float(self.cover[(self.face.y > stripe[0]) & (self.face.y < stripe[1])].mean())

    def _cover_at(self, level: Floats) -> float:
        """The greatest cover at a level (2,)."""
        return float(greatest(self.cover, self.face.y, level[None])[0])

    def _strength(self, level: Floats) -> float:
        """The evidence of a level (2,)."""
        return self.face.level_strength(self.span, *level)
