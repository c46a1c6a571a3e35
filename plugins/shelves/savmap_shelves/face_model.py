"""The face of a rack as one probabilistic model: posts along x, and beams up each section between two of them.

Each is the best set of intervals on the evidence of all frames (savmap.vision.evidence.intervals). Priors tie members
together: posts and beams are of few profiles, and sections have levels in common. Lengths are in cells, counted from
the patch's lower left corner.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from savmap.types import Bools, Floats, Ints, PlaneEvidence
from savmap.vision.evidence.intervals import Intervals, Occlusion, best_intervals, interval_scores
from savmap_shelves.likelihood import FaceParameters
from savmap_shelves.paint import paint_ratios

WIDEST, HIGHEST, NARROWEST = 0.2, 0.3, 2
"""The widest post and the highest beam, as shares of the camera's distance, and cells of the least of both."""
POOLED = 0.05
"""Along members, cells are averaged over so much of the camera's distance: pictures say the same of them."""
POSTS_APART, ABOVE = 0.08, 0.1
"""Posts are at least so far apart, and no beam is further above the posts' tops, as shares of the camera's distance."""
ROUNDS, SURE = 3, 5.0
"""Of reading all sections, each with what the others gave; a member that scores more tells the usual profile."""
LEAST_SHOWN = 0.01
"""Cells that were seen less than this share of the usual are taken for unseen."""
UNEVEN, SHOWN, HIGH = 0.12, 0.4, 0.6
"""Members are as wide as usual to such a share; quantiles of their scores along them, above which they show, and that
tells their borders."""
END_CELLS = 4
"""Around the row in which posts begin to show."""
POSSIBLE = 0.01
"""What is less likely is absent."""


@dataclass(frozen=True)
class Member:
    """A post's or beam's edges across it, in the patch's coordinates, and how likely it exists."""

    low: float
    high: float
    probability: float


@dataclass(frozen=True, eq=False)
class Face:
    """Posts from the left, beams of each section between two of them from the bottom up, and what may exist beside
    these; and how far up the posts show."""

    posts: tuple[Member, ...]
    sections: tuple[tuple[Member, ...], ...]
    possible: tuple[tuple[Member, ...], ...]
    bottom: float
    top: float


@dataclass(frozen=True, eq=False)
class FaceReader:
    """Reads the face in the evidence of all frames on the uprights' plane and on the beams', which is a patch of the
    same cells.

    distance: of the camera, in the patch's unit. floor: height above the
    lower side; sizes: the posts' usual width and the beams' usual thickness; None where they are not known. least_seen:
    the share of a post's height, in the least of its columns, below which none is.
    """

    uprights: PlaneEvidence
    beams: PlaneEvidence
    distance: float
    floor: float | None
    parameters: FaceParameters
    sizes: tuple[float | None, float | None] = (None, None)
    least_seen: float = 0.0

    @property
    def cell(self) -> float:
        """A cell's side as a share of the camera's distance."""
        return self.uprights.patch.cell / self.distance

    def cells(self, share: float) -> int:
        """How many cells a share of the camera's distance is."""
        return max(1, round(share / self.cell))

    def ratios(self, evidence: PlaneEvidence, label: str) -> Floats:
        """Log-likelihood ratios (rows, columns) of the cells, the lowest row first."""
        shown = self.shown(evidence)
        return np.asarray(self.parameters.ratios(label, evidence.of(label), shown)[::-1], np.float64)

    def shown(self, evidence: PlaneEvidence) -> Bools:
        """Which cells (rows, columns) are seen well enough to tell anything, the highest row first."""
        return np.asarray(evidence.weight > LEAST_SHOWN * np.median(evidence.weight[evidence.weight > 0]))

    def read(self) -> Face | None:
        """The face; None where fewer than two posts show."""
        if not (self.uprights.weight > 0).any():
            return None
        upright = self.ratios(self.uprights, "upright")
        posts, (bottom, top), ratios = self._posts(upright)
        if len(posts.cells) < 2:
            return None
        between = self.sections_between(posts, top)
        sections = between.read()
        first = between.first
        cell = self.uprights.patch.cell
        rows = slice(bottom, top)
        width, thickness = (None if size is None else size / cell for size in self.sizes)
        (places,) = measured_members([posts], [self.means(self.uprights, "upright")[rows].T], [ratios[rows].T], width)
        shown = [self.means(self.beams, "beam")[first:, slice(*span)] for span in between.spans]
        levels = measured_members(sections, shown, between.painted(between.paint(sections)), thickness)
        return Face(
            tuple(
                Member(float(place[0] * cell), float(place[1] * cell), likely)
                for place, likely in zip(places, posts.existing.tolist(), strict=True)
            ),
            tuple(
                tuple(
                    Member(float((first + level[0]) * cell), float((first + level[1]) * cell), likely)
                    for level, likely in zip(places, section.existing.tolist(), strict=True)
                )
                for places, section in zip(levels, sections, strict=True)
            ),
            tuple(tuple(_possible(section, first, cell)) for section in sections),
            cell * lower_end(self.means(self.uprights, "upright"), posts, bottom),
            top * cell,
        )

    def means(self, evidence: PlaneEvidence, label: str) -> Floats:
        """Mean scores (rows, columns), the lowest row first."""
        return np.asarray(evidence.of(label)[::-1], np.float64)

    def _posts(self, ratios: Floats) -> tuple[Intervals, tuple[int, int], Floats]:
        """Posts, the rows between which they show, and the cells' ratios; by their paint, too, once they are known by
        the scores."""
        posts, rows, usual = self._read_posts(ratios, first_extent(ratios), None)
        for _ in range(ROUNDS - 2):
            posts, rows, usual = self._read_posts(ratios, rows, usual)
        if len(posts.cells) < 2:
            return posts, rows, ratios
        ratios = ratios + self.parameters.paint * self.paint_of_posts(posts, rows)
        posts, rows, _ = self._read_posts(ratios, rows, usual)
        return posts, rows, ratios

    def _read_posts(
        self, ratios: Floats, rows: tuple[int, int], usual: float | None
    ) -> tuple[Intervals, tuple[int, int], float | None]:
        """Posts between two rows, where so wide ones are usual; the rows between which they show, and their usual
        width."""
        scores = self.post_scores(self.pooled(ratios[slice(*rows)].T), usual)
        unseen = np.cumsum(np.append(0, self.shown(self.uprights)[::-1][slice(*rows)].mean(axis=0) < self.least_seen))
        for column, width in enumerate(self.post_widths.tolist()):
            scores[: len(unseen) - width, column][unseen[width:] > unseen[:-width]] = -np.inf
        (posts,) = best_intervals([scores], self.post_widths, self.cells(POSTS_APART))
        if not len(posts.cells):
            return posts, rows, usual
        return posts, extent(ratios, posts), float(np.median(np.diff(posts.cells, axis=1)))

    def paint_of_posts(self, posts: Intervals, rows: tuple[int, int]) -> Floats:
        """What paint says of the cells (n, columns) around each post, by the other ones."""
        picture = self.uprights.picture[::-1]
        nearest = np.abs(np.arange(picture.shape[1])[:, None] - posts.cells.mean(axis=1)).argmin(axis=1)
        members, groups = np.zeros((2, len(posts.cells), *picture.shape[:2]), np.bool_)
        for number, (low, high) in enumerate(posts.cells.tolist()):
            members[number, slice(*rows), low:high] = True
            groups[number, slice(*rows), nearest == number] = True
        groups &= self.uprights.weight[::-1] > 0
        ratios = paint_ratios(picture, [*members], [*groups], self.parameters.paint_limit)
        return np.asarray(np.choose(nearest, ratios), np.float64)

    @property
    def post_widths(self) -> Ints:
        """Possible widths of posts (w,), in cells."""
        return np.arange(NARROWEST, self.cells(WIDEST))

    def post_scores(self, blocks: Floats, usual: float | None) -> Floats:
        """Scores (n, w) of posts across pooled cells (n, k), where this is their usual width, in cells."""
        widths = self.post_widths
        return self.block_scores(blocks, widths) + self.parameters.post + self.profile(widths, usual)

    def sections_between(self, posts: Intervals, top: int) -> "Sections":
        """The sections between posts, of which `top` is the highest row: from the floor to a little above."""
        first = int(np.flatnonzero((self.beams.weight > 0).sum(axis=1)[::-1])[0])
        if self.floor is not None:
            first = max(first, int(np.clip(self.floor / self.uprights.patch.cell, 0, top - 1)))
        rows = slice(first, min(len(self.beams.weight), top + self.cells(ABOVE)))
        spans = [(left[1] + 1, right[0] - 1) for left, right in pairwise(posts.cells.tolist())]
        return Sections(self, self.ratios(self.beams, "beam")[rows], self.beams.picture[::-1][rows], spans, first)

    def scores(self, ratios: Floats, widths: Ints) -> Floats:
        """Scores (n, w) of intervals across cells (n, m)."""
        return self.block_scores(self.pooled(ratios), widths)

    def block_scores(self, blocks: Floats, widths: Ints) -> Floats:
        """Scores (n, w) of intervals across pooled cells (n, k)."""
        if not blocks.shape[1]:
            return np.zeros((len(blocks), len(widths)))
        return interval_scores(blocks, widths, self.occlusion)

    def pooled(self, cells: Floats) -> Floats:
        """Means (n, k) of cells (n, m), of which every few along say the same."""
        pooled = self.cells(POOLED)
        blocks = cells.shape[1] // pooled
        return np.asarray(cells[:, : blocks * pooled].reshape(len(cells), blocks, pooled).mean(axis=2))

    @property
    def occlusion(self) -> Occlusion:
        """Of pooled cells."""
        occlusion = self.parameters.occlusion(self.cell)
        return replace(occlusion, same_along=max(1.0, occlusion.same_along / self.cells(POOLED)))

    def profile(self, widths: Ints, usual: float | None) -> Floats:
        """Log prior (w,) of widths: about the usual one, once it is known."""
        if usual is None:
            return np.full(len(widths), -np.log(len(widths)))
        cost = 0.5 * np.square((widths - usual) / max(1.0, self.parameters.profile * usual))
        return np.asarray(-cost - np.log(np.exp(-cost).sum()))


@dataclass(frozen=True, eq=False)
class Sections:
    """The cells between posts, of which each section is a line of beams: log-likelihood `ratios` (n, columns) by the
    network's scores, `picture` (n, columns, 3) RGB, `spans` of the sections' columns, and the patch's `first` row."""

    reader: FaceReader
    ratios: Floats
    picture: NDArray[np.uint8]
    spans: Sequence[tuple[int, int]]
    first: int

    @property
    def widths(self) -> Ints:
        """Possible thicknesses of beams (w,), in cells."""
        return np.arange(NARROWEST, self.reader.cells(HIGHEST))

    @property
    def gap(self) -> int:
        """Least gap between two beams, in cells."""
        return self.reader.cells(self.reader.parameters.gap)

    def read(self) -> list[Intervals]:
        """The beams of all sections."""
        shown, sections, usual = self.shown(None), list[Intervals](), None
        for turn in range(ROUNDS + 1):
            sections = best_intervals(self.scores(shown, sections, usual), self.widths, self.gap)
            usual = usual_width(sections)
            if turn == 1 and usual is not None:
                shown = self.shown(self.paint(sections))
        return sections

    def shown(self, paint: Sequence[Floats] | None) -> list[Floats]:
        """Scores (n, w) of intervals in each section by its cells, with what paint adds to their ratios."""
        return [self.reader.scores(ratios, self.widths) for ratios in self.painted(paint)]

    def painted(self, paint: Sequence[Floats] | None) -> list[Floats]:
        """Log-likelihood ratios (n, m) of each section's cells, with what paint adds to them."""
        weight = self.reader.parameters.paint
        return [
            self.ratios[:, slice(*span)] + (weight * paint[k][:, slice(*span)] if paint else 0.0)
            for k, span in enumerate(self.spans)
        ]

    def paint(self, sections: Sequence[Intervals]) -> list[Floats]:
        """What paint says of each section's cells (n, columns), by the sure members of the others."""
        members, groups = np.zeros((2, len(sections), *self.picture.shape[:2]), np.bool_)
        for number, (section, span) in enumerate(zip(sections, self.spans, strict=True)):
            groups[number, :, slice(*span)] = True
            for low, high in section.cells[section.score > SURE].tolist():
                members[number, low:high, slice(*span)] = True
        return paint_ratios(self.picture, [*members], [*groups], self.reader.parameters.paint_limit)

    def scores(self, shown: Sequence[Floats], sections: Sequence[Intervals], usual: float | None) -> list[Floats]:
        """Scores (n, w) of intervals in each section with their log prior, by an earlier reading of all sections, if
        there is one, and the usual thickness."""
        middles = np.arange(len(self.ratios))[:, None] + self.widths / 2
        profile = self.reader.profile(self.widths, usual)
        return [score + profile + self._levels(k, sections, middles) for k, score in enumerate(shown)]

    def _levels(self, number: int, sections: Sequence[Intervals], middles: Floats) -> Floats:
        """Log rate of beams at middles (n, w), by how many of the other sections have one there."""
        parameters, others = self.reader.parameters, [section for k, section in enumerate(sections) if k != number]
        if not others:
            return np.full(middles.shape, parameters.level)
        near = self.reader.cells(POOLED) / 2
        places = (section.cells.mean(axis=1) for section in others)
        share = sum((np.abs(middles[..., None] - place) <= near).any(axis=-1) for place in places) / len(others)
        return np.asarray(parameters.level + np.log1p(np.expm1(parameters.shared) * share))


def stretches(ratios: Floats) -> tuple[Ints, Ints, Floats]:
    """The stretch with the greatest sum of log-likelihood ratios (rows, columns) in each column: its first row, the row
    after its last (columns,), and the sum (columns,)."""
    summed = np.cumsum(np.clip(np.pad(ratios, ((1, 0), (0, 0))), -2, 2), axis=0)
    gains = summed - np.minimum.accumulate(summed, axis=0)
    last = gains.argmax(axis=0)
    before = np.arange(len(summed))[:, None] <= last
    return np.where(before, summed, np.inf).argmin(axis=0), last, np.asarray(gains.max(axis=0))


def extent(ratios: Floats, posts: Intervals) -> tuple[int, int]:
    """The rows between which posts show, by the median along them of their log-likelihood ratios (rows, columns)."""
    along = np.median([ratios[:, low:high].mean(axis=1) for low, high in posts.cells.tolist()], axis=0)
    first, last, _ = stretches(along[:, None])
    return int(first[0]), int(last[0])


def first_extent(ratios: Floats) -> tuple[int, int]:
    """The rows between which most columns with posts show them, before these are known, by ratios (rows, columns). A
    view may be many times as high as a rack."""
    first, last, gains = stretches(ratios)
    strong = gains > gains.max() / 2
    return (int(np.median(first[strong])), int(np.median(last[strong]))) if strong.any() else (0, len(ratios))


def lower_end(scores: Floats, posts: Intervals, bottom: int) -> float:
    """Where posts end below, in cells, near the first row in which they show: where the median over them of the mean
    scores (rows, columns) across each falls to half of what it is above."""
    along = np.median([scores[:, low:high].mean(axis=1) for low, high in posts.cells.tolist()], axis=0)
    first, last = max(bottom - END_CELLS, 0), min(bottom + 2 * END_CELLS, len(along))
    part = along[first:last]
    below = np.flatnonzero(part < np.max(part, initial=0.0) / 2)
    if not len(below) or below[-1] + 1 >= len(part):
        return float(bottom)
    before, after = part[below[-1] : below[-1] + 2].tolist()
    return float(first + below[-1] + 0.5 + (np.max(part) / 2 - before) / (after - before))


def usual_width(sections: Sequence[Intervals]) -> float | None:
    """The usual width of the members that are sure."""
    widths = [np.diff(section.cells, axis=1)[section.score > SURE, 0] for section in sections]
    sure = np.concatenate(widths) if widths else np.zeros(0)
    return float(np.median(sure)) if len(sure) else None


def _possible(intervals: Intervals, first: int, cell: float) -> Iterator[Member]:
    for low, high, probability in intervals.others(POSSIBLE):
        yield Member((low + first) * cell, (high + first) * cell, probability)


def measured_members(
    intervals: Sequence[Intervals], scores: Sequence[Floats], ratios: Sequence[Floats], solved: float | None
) -> list[list[Floats]]:
    """The borders (2,) of each line's intervals, in parts of a cell, by the mean scores (n, m) of the line's cells:
    where the score falls to half. A member that is not as wide as usual by more than `UNEVEN` is where a usual one fits
    best: by its scores, where something hides one of its borders; by its cells' log-likelihood ratios (n, m), which
    tell paints apart, where something adjoins it. Scores are blurred; where the usual width was `solved`, in cells, all
    members become thinner by as much."""
    usual = usual_width(intervals) or 1.0
    measured = [
        [borders(line, *cells) for cells in part.cells.tolist()] for part, line in zip(intervals, scores, strict=True)
    ]
    widths = np.array([member[1] - member[0] for members in measured for member in members])
    alike = widths[np.abs(widths - usual) < max(UNEVEN * usual, 1.0)]
    usual = float(np.median(alike)) if len(alike) else usual
    room, blur = max(UNEVEN * usual, 0.5), 0.0 if solved is None else max(usual - solved, 0.0)
    thinner = blur / 2 * np.array([1.0, -1.0])
    return [
        [
            thinner
            + (
                member
                if abs(member[1] - member[0] - usual) < room
                else placed(line, likely if member[1] - member[0] > usual else None, member, usual)
            )
            for member in members
        ]
        for members, line, likely in zip(measured, scores, ratios, strict=True)
    ]


def along(scores: Floats, low: int, high: int) -> Bools:
    """Where along a member (m,) its middle shows."""
    third = max(1, (high - low) // 3)
    core = scores[low + (high - low - third) // 2 :][:third].mean(axis=0)
    return np.asarray(core >= np.quantile(core, SHOWN))


def borders(scores: Floats, low: int, high: int) -> Floats:
    """Where the scores (n, m) across a member fall to half of its greatest (2,), in cells from the first's lower
    side."""
    profile = np.quantile(scores[:, along(scores, low, high)], HIGH, axis=1)
    top = low + int(profile[low:high].argmax())
    half = profile[top] / 2
    first = next((k for k in range(top, -1, -1) if profile[k] < half), -1)
    last = next((k for k in range(top, len(profile)) if profile[k] < half), len(profile))
    lower = first + (half - profile[first]) / (profile[first + 1] - profile[first]) if first >= 0 else -0.5
    upper = last - (half - profile[last]) / (profile[last - 1] - profile[last]) if last < len(profile) else last - 0.5
    return np.array([lower, upper]) + 0.5


def placed(scores: Floats, ratios: Floats | None, member: Floats, usual: float) -> Floats:
    """The borders (2,) of a member of the usual width where its ratios (n, m), or, without these, its scores, are
    greatest, about a place that is known to half of its width."""
    low, high = int(np.floor(member[0])), max(int(np.ceil(member[1])), int(np.floor(member[0])) + 1)
    shown = along(scores, max(low, 0), min(high, len(scores)))
    profile = np.quantile((scores if ratios is None else ratios)[:, shown], HIGH, axis=1)
    summed = np.concatenate([[0.0], np.cumsum(profile - profile.max() / 2 if ratios is None else profile)])
    room = abs(member[1] - member[0] - usual) / 2 + 1
    middles = member.mean() + np.linspace(-room, room, 41)
    cells = np.arange(len(summed))
    gathered = np.interp(middles + usual / 2, cells, summed) - np.interp(middles - usual / 2, cells, summed)
    best = gathered >= gathered.max() - 1e-9
    return float(middles[best].mean()) + usual * np.array([-0.5, 0.5])
