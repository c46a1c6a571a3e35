"""How the camera moved along the face from frame to frame, from the face tangents of uprights and corners.

The shift between neighbouring frames is voted for by all pairs of edges and corners of a kind; a shortest path over all frames (Viterbi)
chooses a smooth sequence of shifts, so that a rack's regular spacing or a false upright does not mislead a single frame.
Then scale, shift and rise of each pair of frames are fitted robustly and chained.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from savmap.types import Bools, Floats, Ints
from savmap_shelves.tracking.sightings import FaceSightings

BIN = 0.01
KERNEL = 0.05
EVIDENCE = 8.0
CHANGE, LARGEST_CHANGE = 0.05, 15.0
MATCH, MATCH_SIGMA = 0.1, 0.015
LARGEST_RISE, USUAL_RISE, RISE_SPREAD = 0.15, 0.05, 0.01
CORNER_VOTE = 0.2
ROUNDS = 3
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
    travel: +1 or -1 where the direction of travel is known, 0 where it is not.
    """
    grid = np.arange(-np.ceil(reach / BIN), np.ceil(reach / BIN) + 1) * BIN
    against = np.abs(grid) * 0.5 + np.where(grid * travel < -0.05, 20.0, 0.0)
    cost = [
        against - EVIDENCE * _votes(a, b, grid * step) for a, b, step in zip(views[:-1], views[1:], steps, strict=True)
    ]
    return _smoothest(grid, cost) * steps


def _smoothest(grid: Floats, cost: Sequence[Floats]) -> Floats:
    """The sequence of shifts (n,) out of `grid` with the least cost, changes of `CHANGE` costing 1 (Viterbi)."""
    turn = np.minimum(np.abs(grid[:, None] - grid) / CHANGE, LARGEST_CHANGE)
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


def _votes(first: FrameObservations, second: FrameObservations, grid: Floats) -> Floats:
    """For each shift, the share of edges and corners of a frame that have a match in the other (near 1 at best)."""
    width = float(grid[1] - grid[0])
    possible = min((~first.corner).sum(), (~second.corner).sum())
    possible = possible + CORNER_VOTE * min(first.corner.sum(), second.corner.sum())
    if possible == 0 or width < 1e-6:
        return np.zeros_like(grid)
    edges = _differences(first.part(~first.corner), second.part(~second.corner))
    corners = _differences(first.part(first.corner), second.part(second.corner))
    values, weights = np.concatenate([edges, corners]), np.repeat([1.0, CORNER_VOTE], [len(edges), len(corners)])
    bins = np.round((values - grid[0]) / width).astype(np.int64)
    inside = (bins >= 0) & (bins < len(grid))
    count = np.bincount(bins[inside], weights[inside], minlength=len(grid))
    spread = KERNEL / width
    peaks: Floats = gaussian_filter1d(count, spread, mode="constant") * spread * np.sqrt(2 * np.pi)
    share: Floats = np.minimum(peaks / possible, 1.5) * possible / (possible + 1)
    return share


def _differences(first: FrameObservations, second: FrameObservations) -> Floats:
    """Shifts in p of all pairs of a kind that are at much the same q."""
    offset = first.positions[:, None] - second.positions
    of_kind = (first.kind[:, None] == second.kind) & (np.abs(offset[..., 1]) < MATCH)
    differences: Floats = offset[..., 0][of_kind]
    return differences


def steps_between(views: Sequence[FrameObservations], moved: Floats) -> Floats:
    """Ratio, slide and rise (n - 1, 3) from each frame to the next: p' = ratio p + slide, q' = ratio q + rise. moved (n - 1,): the shifts."""
    pace = float(np.median(np.abs(moved))) if len(moved) else 0.0
    loose = np.array([np.clip(0.5 * pace, 0.01, 0.05), np.clip(pace, 0.05, 0.2), 0.05]) / MATCH_SIGMA
    steps = [_step(first, second, shift, loose) for (first, second), shift in zip(pairwise(views), moved, strict=True)]
    return np.array(steps).reshape(-1, 3)


def _step(first: FrameObservations, second: FrameObservations, shift: float, loose: Floats) -> Floats:
    """The motion (3,) between two frames, held to a shift as far as `loose` (3,), sigmas over MATCH_SIGMA, says: robust least squares over
    what matches."""
    usual = np.array([1.0, -shift, 0.0])
    motion = usual
    for _ in range(ROUNDS):
        a, b = _matches(first, second, motion)
        before, after, corner = first.positions[a], second.positions[b], first.corner[a]
        rows = np.concatenate([_rows(before[:, 0], 1), _rows(before[corner, 1], 2), np.diag(1 / loose)])
        values = np.concatenate([after[:, 0], after[corner, 1], usual / loose])
        trust = np.ones(len(rows))
        for _ in range(ROUNDS):
            misfit = (values - rows @ motion) / MATCH_SIGMA
            trust[:-3] = 1 / (1 + misfit[:-3] ** 2)
            weighted = rows * trust[:, None]
            motion = np.linalg.solve(weighted.T @ rows, weighted.T @ values)
    return motion


def _matches(first: FrameObservations, second: FrameObservations, motion: Floats) -> tuple[Ints, Ints]:
    """Edges and corners of both frames that are each other's nearest of their kind after the first is moved; edges stay at the horizon."""
    moved = motion[0] * first.positions + np.where(first.corner[:, None], motion[1:], [motion[1], 0.0])
    offset = np.abs(moved[:, None] - second.positions).max(axis=2)
    offset[(first.kind[:, None] != second.kind) | (offset > MATCH)] = np.inf
    best, rows = offset.argmin(axis=1), np.arange(len(moved))
    mutual = (offset.argmin(axis=0)[best] == rows) & np.isfinite(offset[rows, best])
    return np.flatnonzero(mutual), best[mutual]


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
    offset = after.positions - ratio * before.positions[:, None]
    of_kind = (before.kind[:, None] == after.kind) & (np.abs(offset[..., 0] - slide) < MATCH)
    values = offset[..., 1][of_kind & (np.abs(offset[..., 1]) < LARGEST_RISE)]
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
