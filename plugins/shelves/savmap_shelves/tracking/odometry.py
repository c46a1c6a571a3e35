"""How the camera moved along the face from frame to frame, from the face tangents of uprights and corners.

The shift between neighbouring frames is voted for by all pairs of edges and corners of a kind; a shortest path over all frames (Viterbi)
chooses a smooth sequence of shifts, so that a rack's regular spacing or a false upright does not mislead a single frame.
Then scale, shift and rise of each pair of frames are fitted robustly and chained.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter

from savmap.types import Bools, Floats, Ints
from savmap_shelves.tracking.sightings import FaceSightings

BIN = 0.01
KERNEL = 0.05
EVIDENCE = 8.0
CHANGE = (0.012, 0.05)
LARGEST_CHANGE = 15.0
MATCH, MATCH_SIGMA = 0.1, 0.015
LARGEST_RISE, USUAL_RISE, RISE_SPREAD = 0.15, 0.05, 0.01
LEVEL, LEVEL_SIGMA = 0.04, 0.005
GOOD_VOTE = 0.5
GOOD_MATCH, HOPEFUL, HOPELESS = 0.5, 3, 0.25
CORNER_VOTE = 0.2
AROUND, SUDDEN = 7, 2.0
RATIOS = (0.88, 0.92, 0.96, 1.04, 1.08, 1.12)
FIRST_CORNER = 2


@dataclass(frozen=True, eq=False)
class FrameObservations:
    """A frame on the face plane: tangents p, q (k, 2) of its edges and corners, and their kind (k,).

    Kinds 0 and 1 are uprights' left and right edges where they cross the horizon (q = 0), 2 to 5 corners of beams.
    """

    positions: Floats
    kind: Ints

    @property
    def corner(self) -> Bools:
        """Whether it is a corner of a beam (k,)."""
        return self.kind >= FIRST_CORNER

    def part(self, chosen: Bools) -> "FrameObservations":
        """The edges and corners chosen (k,)."""
        return FrameObservations(self.positions[chosen], self.kind[chosen])


def frame_observations(sightings: FaceSightings, count: int) -> list[FrameObservations]:
    """All frames 0 .. count - 1 as their edges and corners on the face plane."""
    edges, face = sightings.horizon(), sightings.face
    corners = np.stack([face.p[sightings.corners], face.q[sightings.corners]], axis=-1)
    corners[sightings.corners < 0] = np.nan
    frame = np.concatenate([np.repeat(sightings.upright_frame, 2), np.repeat(sightings.beam_frame, 4)])
    kind = np.concatenate([np.tile([0, 1], len(edges)), np.tile([2, 3, 4, 5], len(corners))])
    positions = np.concatenate([np.column_stack([edges.ravel(), np.zeros(edges.size)]), corners.reshape(-1, 2)])
    usable = np.isfinite(positions).all(axis=1)
    order = np.flatnonzero(usable)[np.argsort(frame[usable], kind="stable")]
    starts = np.searchsorted(frame[order], np.arange(count + 1))
    return [FrameObservations(positions[order[a:b]], kind[order[a:b]]) for a, b in pairwise(starts)]


def shifts(views: Sequence[FrameObservations], steps: Floats, reach: float, travel: int) -> Floats:
    """The camera's shift to the right (n - 1,) between neighbouring frames, in units of its distance from the face.

    steps (n - 1,): the time between the frames over the usual time. reach: the largest shift in the usual time.
    travel: +1 or -1 where the direction of travel is known, 0 where it is not. A first round finds the usual pace, the
    second holds the shifts to it: a slow or densely sampled camera changes its shift less from frame to frame.
    """
    grid = np.arange(-np.ceil(reach / BIN), np.ceil(reach / BIN) + 1) * BIN
    against = np.abs(grid) * 0.5 + np.where(grid * travel < -0.05, 20.0, 0.0)
    cost = [
        against - EVIDENCE * _evidence(a, b, grid * step)
        for a, b, step in zip(views[:-1], views[1:], steps, strict=True)
    ]
    moved = _smoothest(grid, cost, CHANGE[1])
    return _smoothest(grid, cost, float(np.clip(_pace(moved) / 2, *CHANGE))) * steps


def _pace(moved: Floats) -> float:
    """The usual size of a shift."""
    return float(np.median(np.abs(moved))) if len(moved) else 0.0


def _smoothest(grid: Floats, cost: Sequence[Floats], change: float) -> Floats:
    """The sequence of shifts (n,) out of `grid` with the least cost, changes of `change` costing 1 (Viterbi)."""
    turn = np.minimum(np.abs(grid[:, None] - grid) / change, LARGEST_CHANGE)
    table, back = np.zeros(len(grid)), []
    for frame_cost in cost:
        costs = table[:, None] + turn
        back.append(costs.argmin(axis=0))
        table = costs.min(axis=0) + frame_cost
    path = []
    state = int(table.argmin())
    for came in reversed(back):
        path.append(state)
        state = int(came[state])
    return grid[np.array(path[::-1], dtype=np.int64)]


def _evidence(first: FrameObservations, second: FrameObservations, grid: Floats) -> Floats:
    """Votes for each shift; where few agree, also if the distance from the face changed between the two frames."""
    votes = _votes(first, second, grid, 1.0)
    if votes.max() < GOOD_VOTE:
        votes = np.max([votes, *(_votes(first, second, grid, ratio) for ratio in RATIOS)], axis=0)
    return votes


def _votes(first: FrameObservations, second: FrameObservations, grid: Floats, ratio: float) -> Floats:
    """For each shift, the share of edges and corners of a frame that have a match in the other (near 1 at best)."""
    width = float(grid[1] - grid[0])
    possible = min((~first.corner).sum(), (~second.corner).sum())
    possible = possible + CORNER_VOTE * min(first.corner.sum(), second.corner.sum())
    if possible == 0 or width < 1e-6:
        return np.zeros_like(grid)
    edges = _differences(first.part(~first.corner), second.part(~second.corner), ratio)
    corners = _differences(first.part(first.corner), second.part(second.corner), ratio)
    values, weights = np.concatenate([edges, corners]), np.repeat([1.0, CORNER_VOTE], [len(edges), len(corners)])
    bins = np.round((values - grid[0]) / width).astype(np.int64)
    inside = (bins >= 0) & (bins < len(grid))
    count = np.bincount(bins[inside], weights[inside], minlength=len(grid))
    spread = KERNEL / width
    peaks: Floats = gaussian_filter1d(count, spread, mode="constant") * spread * np.sqrt(2 * np.pi)
    share: Floats = np.minimum(peaks / possible, 1.5) * possible / (possible + 1)
    return share


def _differences(first: FrameObservations, second: FrameObservations, ratio: float) -> Floats:
    """Shifts in p of all pairs of a kind that are at much the same q."""
    apart = ratio * first.positions[:, None] - second.positions
    like = (first.kind[:, None] == second.kind) & (np.abs(apart[..., 1]) < MATCH)
    differences: Floats = apart[..., 0][like]
    return differences


def steps_between(views: Sequence[FrameObservations], moved: Floats) -> Floats:
    """Ratio, slide and rise (n - 1, 3) from each frame to the next: p' = ratio p + slide, q' = ratio q + rise."""
    usual = _pace(moved)
    loose = np.array([np.clip(0.5 * usual, 0.01, 0.05), np.clip(usual, 0.05, 0.2), 0.05]) / MATCH_SIGMA
    likely = LEVEL * np.maximum(1.0, np.abs(moved) / max(usual, 1e-6))
    matchers = [FrameMatcher(first, second) for first, second in pairwise(views)]
    found = zip(matchers, moved, likely, strict=True)
    steps = np.array([matcher.motion(shift, loose, change) for matcher, shift, change in found]).reshape(-1, 3)
    for index in _sudden(steps[:, 0], likely):
        steps[index] = matchers[index].held(moved[index], loose)
    return steps


def _sudden(ratios: Floats, likely: Floats) -> list[int]:
    """Steps (n,) in which the distance from the face changes unlike in those around: nobody leaps, other lines were matched."""
    change = np.log(ratios)
    usual = median_filter(change, AROUND, mode="nearest") if len(change) else change
    return [int(index) for index in np.flatnonzero(np.abs(change - usual) > SUDDEN * likely)]


@dataclass(frozen=True, eq=False)
class FrameMatcher:
    """Two frames and the motion (3,) between them: p' = ratio p + slide, q' = ratio q + rise."""

    first: FrameObservations
    second: FrameObservations

    def motion(self, shift: float, loose: Floats, likely: float) -> Floats:
        """The motion, held to a shift as far as `loose` (3,), sigmas over MATCH_SIGMA, says; the shift alone as a last resort.

        Where hardly anything agrees, a ratio further from 1 than is `likely` is refused: it comes from chance, and the
        chain of frames would break there.
        """
        usual = np.array([1.0, -shift, 0.0])
        starts, possible = [usual], min(len(self.first.kind), len(self.second.kind))
        if self._agreement(usual, MATCH / 2) < GOOD_MATCH * possible:
            ratios = [ratio for ratio in (1.0, *RATIOS) if abs(ratio - 1) < 3 * loose[0] * MATCH_SIGMA]
            starts = [np.array([ratio, -shift + slip, 0.0]) for slip in (0.0, -MATCH, MATCH) for ratio in ratios]
            starts = sorted(starts, key=lambda motion: -self._agreement(motion, MATCH / 2))[:HOPEFUL]
        for _ in range(2):
            starts = [self._refined(start, usual, loose) for start in starts]
        best = max(starts, key=lambda motion: self._agreement(motion, MATCH / 4))
        if self._agreement(best, MATCH / 4) < HOPELESS * possible and abs(best[0] - 1) > likely:
            return self.held(shift, loose)
        return best

    def held(self, shift: float, loose: Floats) -> Floats:
        """The motion by a shift along the face, the distance from it kept."""
        usual = np.array([1.0, -shift, 0.0])
        return self._refined(usual, usual, np.append(LEVEL_SIGMA / MATCH_SIGMA, loose[1:]))

    def _agreement(self, motion: Floats, sigma: float) -> float:
        """How many edges and corners match, closer ones counting more; less if the distance from the face changes much."""
        a, b = self._matches(motion)
        apart = np.abs(self._moved(motion)[a] - self.second.positions[b]).max(axis=1, initial=0.0)
        return float(np.exp(-0.5 * (apart / sigma) ** 2).sum() * (1 - 1.5 * abs(motion[0] - 1)))

    def _refined(self, start: Floats, usual: Floats, loose: Floats) -> Floats:
        """Robust least squares over what matches under `start` (3,), held to the usual motion as far as `loose` says."""
        a, b = self._matches(start)
        before, after, corner = self.first.positions[a], self.second.positions[b], self.first.corner[a]
        rows = np.concatenate([_rows(before[:, 0], 1), _rows(before[corner, 1], 2), np.diag(1 / loose)])
        values = np.concatenate([after[:, 0], after[corner, 1], usual / loose])
        solution, trust = start, np.ones(len(rows))
        for _ in range(3):
            misfit = (values - rows @ solution) / MATCH_SIGMA
            trust[:-3] = 1 / (1 + misfit[:-3] ** 2)
            weighted = rows * trust[:, None]
            solution = np.linalg.solve(weighted.T @ rows, weighted.T @ values)
        return solution

    def _matches(self, motion: Floats) -> tuple[Ints, Ints]:
        """Edges and corners of both frames that are each other's nearest of their kind after the first is moved."""
        if not len(self.first.kind) or not len(self.second.kind):
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        moved, positions = self._moved(motion), self.second.positions
        apart = np.maximum(np.abs(moved[:, :1] - positions[:, 0]), np.abs(moved[:, 1:] - positions[:, 1]))
        apart[(self.first.kind[:, None] != self.second.kind) | (apart > MATCH)] = np.inf
        best = apart.argmin(axis=1)
        rows = np.arange(len(best))
        mutual = (apart.argmin(axis=0)[best] == rows) & np.isfinite(apart[rows, best])
        return np.flatnonzero(mutual), best[mutual]

    def _moved(self, motion: Floats) -> Floats:
        """The first frame's positions (k, 2) after the motion; edges stay at the horizon."""
        offset = np.where(self.first.corner[:, None], motion[1:], [motion[1], 0.0])
        return np.asarray(motion[0] * self.first.positions + offset)


def _rows(tangent: Floats, column: int) -> Floats:
    rows = np.zeros((len(tangent), 3))
    rows[:, 0], rows[:, column] = tangent, 1.0
    return rows


def rise_between(
    first: FrameObservations, second: FrameObservations, ratio: float, slide: float
) -> tuple[float, float]:
    """What q grew by beside `ratio`, for a known ratio and slide, and how many agree on it.

    It is the densest of the matching corners' differences.
    """
    before, after = first.part(first.corner), second.part(second.corner)
    apart = after.positions - ratio * before.positions[:, None]
    like = (before.kind[:, None] == after.kind) & (np.abs(apart[..., 0] - slide) < MATCH)
    values = apart[..., 1][like & (np.abs(apart[..., 1]) < LARGEST_RISE)]
    if not len(values):
        return 0.0, 0.0
    near = np.abs(values[:, None] - values) < RISE_SPREAD
    density = near.sum(axis=1) * np.exp(-0.5 * (values / USUAL_RISE) ** 2)
    best = near[density.argmax()]
    return float(np.mean(values[best])), float(best.sum())


def chained(steps: Floats) -> Floats:
    """Scale s = 1 / t_z, u = t_x / t_z and v = t_y / t_z (n, 3) of each frame, the first at (1, 0, 0)."""
    states = np.zeros((len(steps) + 1, 3))
    states[0, 0] = 1.0
    for index, (ratio, slide, rise) in enumerate(steps):
        s, u, v = states[index]
        states[index + 1] = ratio * s, ratio * u - slide, ratio * v - rise
    return states
