"""The grid of a face in its own coordinates, from the tracked landmarks, and the patch around it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.types import Floats, PlanePatch

FACE = "face"


@dataclass(frozen=True, eq=False)
class Grid:
    """A face in its own coordinates: x (k, 2) of the posts' edges from the left, and for each bay between them y (m, 2)
    of its beams' edges from the bottom."""

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


def tracked_grid(points: Mapping[str, Floats]) -> Grid | None:
    """The grid that was tracked, by the first positions of its landmarks; None where it holds no bay."""
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
    sections = [_levels_of(rows, section) for section in range(1, len(posts))]
    if not any(len(levels) for levels in sections):
        return None
    thicknesses = np.abs(np.concatenate([np.diff(levels, axis=1) for levels in sections]))
    if not np.isfinite(thicknesses).any():
        return None
    usual = float(np.nanmedian(thicknesses))
    return Grid(np.sort(posts, axis=1), [_thick(levels, usual) for levels in sections])


def _thick(levels: Floats, usual: float) -> Floats:
    """Levels with their edges in order, at least half as thick as usual: in a first solution, a level's edges may
    be crossed. An edge that was not tracked is as far from the other as usual."""
    levels = np.where(np.isfinite(levels), levels, levels[:, ::-1] + usual * np.array([-1.0, 1.0]))
    middle, half = levels.mean(axis=1, keepdims=True), np.abs(np.diff(levels, axis=1)) / 2
    return np.asarray(middle + np.maximum(half, usual / 4) * np.array([-1.0, 1.0]))


def _levels_of(rows: Mapping[tuple[int, int, int], Sequence[float]], section: int) -> Floats:
    """y (m, 2) of the levels of a bay; nan for an edge that was not tracked."""
    numbers = sorted({beam for number, beam, _ in rows if number == section})
    edges = [[np.median(rows.get((section, beam, edge), [np.nan])) for edge in (0, 1)] for beam in numbers]
    return np.array(edges).reshape(-1, 2)


def face_patch(grid: Grid) -> PlanePatch:
    """The face around a grid, with room for a bay on all sides."""
    levels = np.concatenate([*grid.sections])
    low = np.array([grid.posts[0, 0], levels.min()]) - grid.bay
    high = np.array([grid.posts[-1, 1], levels.max()]) + grid.bay
    return PlanePatch(FACE, np.append(low, 0.0), np.eye(3)[0], np.eye(3)[1], high - low, grid.thickness)
