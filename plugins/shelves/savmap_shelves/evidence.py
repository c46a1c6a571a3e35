"""Uprights and beams in the evidence of all frames: posts where columns of the face show one, levels where rows between posts do.

This is the published density estimate (paper, III.D) over every pixel of every frame instead of over edges that single frames found.
What was tracked sets the scale: its own evidence says how strong the others' should be.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, median_filter

from savmap.types import Bools, Expected, Floats, PlaneEvidence, PlanePatch

Singles = NDArray[np.float32]

FACE = "face"
CELLS_ACROSS = 5.0
BEYOND, ABOVE = 1.3, 0.12
BODY = (0.12, 0.92)


@dataclass(frozen=True)
class EvidenceSettings:
    """When evidence is believed; shares are of what is usual for those that were tracked.

    `post`, `level`: what a new one must have, and at least `faint`; `post_in_gap`: one in a bay so wide that one is missing;
    `lost`: what was tracked with less is dropped. `wide`: such a multiple of the usual bay misses a post; `narrow`: posts nearer to
    one another than this share of it are one.
    """

    post: float = 0.45
    post_in_gap: float = 0.2
    level: float = 0.5
    lost: float = 0.12
    faint: float = 0.08
    wide: float = 1.6
    narrow: float = 0.3


@dataclass(frozen=True, eq=False)
class Grid:
    """A face in its own coordinates: x (k, 2) of the posts' edges from the left, and for each section between them y (m, 2) of its
    beams' edges from the bottom."""

    posts: Floats
    sections: Sequence[Floats]

    @property
    def width(self) -> float:
        """The usual width of a post."""
        return float(np.median(np.diff(self.posts, axis=1)))

    @property
    def thickness(self) -> float:
        """The usual thickness of a beam."""
        return float(np.median(np.concatenate([np.diff(levels, axis=1)[:, 0] for levels in self.sections])))

    @property
    def bay(self) -> float:
        """The usual distance from post to post."""
        return float(np.median(np.diff(self.posts.mean(axis=1))))

    @property
    def top(self) -> float:
        """The highest edge."""
        return float(max(levels.max() for levels in self.sections if len(levels)))


def tracked_grid(points: Mapping[str, Floats]) -> Grid | None:
    """The grid that was tracked, by the first positions of its landmarks; None where it holds no section."""
    columns: dict[tuple[int, int], list[float]] = {}
    rows: dict[tuple[int, int, int], list[float]] = {}
    for name, position in points.items():
        words = name.split(" / ")
        if len(words) == 3 and words[0].startswith("upright"):
            columns.setdefault((int(words[0].split()[1]), int(words[1] == "right")), []).append(float(position[0]))
        elif len(words) == 3 and words[1].startswith("beam"):
            key = int(words[0].split()[1]), int(words[1].split()[1]), int("upper" in words[2])
            rows.setdefault(key, []).append(float(position[1]))
    whole = [number for number, side in columns if side == 0 and (number, 1) in columns]
    posts = np.array([[np.median(columns[number, side]) for side in (0, 1)] for number in sorted(whole)])
    if len(posts) < 2 or not rows:
        return None
    return Grid(posts, [_levels_of(rows, section) for section in range(1, len(posts))])


def _levels_of(rows: Mapping[tuple[int, int, int], Sequence[float]], section: int) -> Floats:
    numbers = sorted({beam for own, beam, _ in rows if own == section})
    whole = [beam for beam in numbers if (section, beam, 0) in rows and (section, beam, 1) in rows]
    return np.array([[np.median(rows[section, beam, edge]) for edge in (0, 1)] for beam in whole]).reshape(-1, 2)


def face_patch(grid: Grid) -> PlanePatch:
    """The face around a grid, with room for a bay at either end and for a level above, in cells of a fifth of a post."""
    low, high = _reach_up(grid)
    left, right = grid.posts[0, 0] - BEYOND * grid.bay, grid.posts[-1, 1] + BEYOND * grid.bay
    cell = min(grid.width, grid.thickness) / CELLS_ACROSS
    origin = np.array([left, low, 0.0])
    return PlanePatch(FACE, origin, np.eye(3)[0], np.eye(3)[1], np.array([right - left, high - low]), cell)


def _reach_up(grid: Grid) -> tuple[float, float]:
    """Lowest and highest y of the patch."""
    bottom = min(float(levels.min()) for levels in grid.sections if len(levels))
    room = 0.3 * (grid.top - bottom) + 2 * grid.thickness
    return bottom - room, grid.top + room


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
        self.upright, self.beam = evidence.of("upright"), evidence.of("beam")
        self.weight = evidence.weight

    def grid(self) -> Grid:
        """What the evidence shows."""
        posts = self._posts()
        strengths = [self._strengths(profile, levels) for profile, levels in self._tracked_sections()]
        usual = float(np.median(np.concatenate(strengths)))
        posts = self._with_ends(posts, usual)
        return Grid(posts, [self._levels(pair, usual) for pair in pairwise(posts)])

    def _tracked_sections(self) -> Iterator[tuple[Floats, Floats]]:
        for (left, right), levels in zip(pairwise(self.tracked.posts), self.tracked.sections, strict=True):
            yield self._level_profile(left[1], right[0]), levels

    def _posts(self) -> Floats:
        """x (k, 2) of the posts between the first and the last that were tracked: those that were and are not lost, new ones that
        are as strong, and in bays so wide that one is missing fainter ones."""
        profile = self._post_profile()
        posts = self.tracked.posts
        strength = np.array([self._peak(profile, self.x, *post) for post in posts])
        usual = float(np.median(strength))
        kept = posts[strength >= min(self.settings.lost * usual, self.settings.faint)]
        kept = kept if len(kept) >= 2 else posts
        inner = (self.x > kept[0, 1]) & (self.x < kept[-1, 0])
        posts = self._joined(kept, self._candidates(profile, inner, self.settings.post * usual))
        for _ in range(2):
            gap = np.zeros_like(inner)
            for left, right in pairwise(posts):
                if right.mean() - left.mean() > self.settings.wide * _usual_bay(posts):
                    gap |= (self.x > left[1]) & (self.x < right[0])
            posts = self._joined(posts, self._candidates(profile, gap, self.settings.post_in_gap * usual))
        return posts

    def _post_profile(self) -> Floats:
        """How far the evidence for posts stands out (columns,), on average over the heights between which beams lie."""
        bottom = min(float(levels.min()) for levels in self.tracked.sections if len(levels))
        body = bottom + np.array(BODY) * (self.tracked.top - bottom)
        rows = (self.y > body[0]) & (self.y < body[1])
        return self._standing_out(_mean(self.upright[rows], self.weight[rows], 0), self.tracked.width, self.tracked.bay)

    def _level_profile(self, left: float, right: float) -> Floats:
        """How far the evidence for beams stands out (rows,), on average between two posts."""
        margin = min(self.tracked.width, 0.1 * (right - left))
        columns = (self.x > left + margin) & (self.x < right - margin)
        mean = _mean(self.beam[:, columns], self.weight[:, columns], 1)
        return self._standing_out(mean, self.tracked.thickness, 8 * self.tracked.thickness)

    def _standing_out(self, mean: Floats, size: float, around: float) -> Floats:
        smooth = gaussian_filter1d(mean, size / 4 / self.cell)
        return np.asarray(smooth - median_filter(smooth, max(3, round(0.7 * around / self.cell))))

    def _peak(self, profile: Floats, places: Floats, low: float, high: float) -> float:
        """The greatest value between two places, or beside them by half their distance."""
        margin = (high - low) / 2
        return float(profile[(places > low - margin) & (places < high + margin)].max(initial=0.0))

    def _candidates(self, profile: Floats, within: Bools, least: float) -> Floats:
        """Centres (k,) of peaks in some columns, the strongest first."""
        peak = np.zeros(len(profile), dtype=np.bool_)
        peak[1:-1] = (profile[1:-1] >= profile[:-2]) & (profile[1:-1] > profile[2:])
        chosen = np.flatnonzero(peak & within & (profile >= max(least, self.settings.faint)))
        return np.asarray(self.x[chosen[np.argsort(-profile[chosen], kind="stable")]])

    def _joined(self, posts: Floats, centres: Floats) -> Floats:
        """Posts with new ones, which are as wide as usual, where none is near."""
        apart = max(self.settings.narrow * _usual_bay(posts), 2 * self.tracked.width)
        for centre in centres:
            if np.abs(posts.mean(axis=1) - centre).min() > apart:
                post = centre + self.tracked.width * np.array([-0.5, 0.5])
                posts = np.concatenate([posts, post[None]])
        return posts[np.argsort(posts[:, 0])]

    def _with_ends(self, posts: Floats, usual: float) -> Floats:
        """Posts with one more at either end, where most levels of the outermost section go on to it."""
        profile = self._post_profile()
        strength = float(np.median([self._peak(profile, self.x, *post) for post in posts]))
        for end, beyond in ((-1, self.x > posts[-1, 1]), (0, self.x < posts[0, 0])):
            for centre in self._candidates(profile, beyond, self.settings.post * strength):
                inner = posts[end].mean()
                if not 0.4 * _usual_bay(posts) < abs(centre - inner) < BEYOND * _usual_bay(posts):
                    continue
                profile_there = self._level_profile(*sorted((float(centre), float(inner))))
                levels = self.tracked.sections[end]
                going_on = self._strengths(profile_there, levels) > self.settings.level * usual
                if len(levels) and going_on.mean() > 0.5:
                    posts = self._joined(posts, np.array([centre]))
                    break
        return posts

    def _strengths(self, profile: Floats, levels: Floats) -> Floats:
        return np.array([self._peak(profile, self.y, *level) for level in levels])

    def _levels(self, posts: tuple[Floats, Floats], usual: float) -> Floats:
        """y (m, 2) of a section's beams: those that were tracked between the same posts and are not lost, and new ones."""
        profile = self._level_profile(float(posts[0][1]), float(posts[1][0]))
        levels = self._tracked_between(*posts)
        strength = self._strengths(profile, levels)
        levels = levels[strength >= min(self.settings.lost * usual, self.settings.faint)]
        least = max(self.settings.level * usual, self.settings.faint)
        peak = np.zeros(len(profile), dtype=np.bool_)
        peak[1:-1] = (profile[1:-1] >= profile[:-2]) & (profile[1:-1] > profile[2:]) & (profile[1:-1] >= least)
        for row in sorted(np.flatnonzero(peak), key=lambda row: -profile[row]):
            centre, half = self.y[row], self._half(profile, int(row))
            if not len(levels) or np.abs(levels.mean(axis=1) - centre).min() > 1.5 * self.tracked.thickness:
                levels = np.concatenate([levels, [[centre - half, centre + half]]])
        return levels[np.argsort(levels[:, 0])]

    def _half(self, profile: Floats, row: int) -> float:
        """Half the thickness of a level whose evidence is greatest at a row: down to half of it on either side, within reason."""
        below = np.flatnonzero(profile < profile[row] / 2)
        first, last = below[below < row].max(initial=row - 1), below[below > row].min(initial=row + 1)
        return float(
            np.clip(self.cell * (last - first - 1), 0.6 * self.tracked.thickness, 1.6 * self.tracked.thickness) / 2
        )

    def _tracked_between(self, left: Floats, right: Floats) -> Floats:
        for own, levels in zip(pairwise(self.tracked.posts), self.tracked.sections, strict=True):
            if np.allclose(own[0], left) and np.allclose(own[1], right):
                return levels
        return np.zeros((0, 2))


def _mean(values: Singles, weight: Singles, axis: int) -> Floats:
    """The mean along an axis over cells that were seen, 0 where there are none."""
    seen = weight > 0
    return np.asarray((values * seen).sum(axis=axis) / np.maximum(seen.sum(axis=axis), 1), np.float64)


def _usual_bay(posts: Floats) -> float:
    return float(np.median(np.diff(posts.mean(axis=1))))


def outlines(grid: Grid) -> list[Expected]:
    """The objects of a grid on the face. Posts reach beyond the levels at both ends, as far as the pictures show them."""
    low, high = _reach_up(grid)
    uprights = [_rectangle("upright", post, np.array([low, high])) for post in grid.posts]
    beams = [
        _rectangle("beam", np.array([left[1], right[0]]), level)
        for (left, right), levels in zip(pairwise(grid.posts), grid.sections, strict=True)
        for level in levels
    ]
    return [*uprights, *beams]


def _rectangle(label: str, x: Floats, y: Floats) -> Expected:
    corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
    return Expected(label, np.array([[*corner, 0.0] for corner in corners], np.float64))
