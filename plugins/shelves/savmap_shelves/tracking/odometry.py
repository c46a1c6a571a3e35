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
CHANGE = (0.012, 0.05)
LARGEST_CHANGE = 15.0
MATCH, MATCH_SIGMA = 0.1, 0.015
LARGEST_RISE, USUAL_RISE, RISE_SPREAD = 0.15, 0.05, 0.01
LEVEL, LEVEL_SIGMA = 0.04, 0.005
GOOD_VOTE = 0.5
GOOD_MATCH, HOPEFUL, HOPELESS = 0.5, 3, 0.25
CORNER_VOTE = 0.2
RATIOS = (0.88, 0.92, 0.96, 1.04, 1.08, 1.12)
FIRST_CORNER = 2


@dataclass(frozen=True)
class FrameObservations:
    """A frame on the face plane: tangents p, q (k, 2) of its edges and corners, and their kind (k,).

    Kinds 0 and 1 are uprights' left and right edges where they cross the horizon (q = 0), 2 to 5 corners of beams.
    """

    positions: Floats
    kind: Ints


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
    calmer: Floats = _smoothest(grid, cost, float(np.clip(pace(moved) / 2, *CHANGE))) * steps
    return calmer


def pace(moved: Floats) -> float:
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
    smoothest: Floats = grid[np.array(path[::-1], dtype=np.int64)]
    return smoothest


def _evidence(first: FrameObservations, second: FrameObservations, grid: Floats) -> Floats:
    """Votes for each shift; where few agree, also if the distance from the face changed between the two frames."""
    votes = _votes(first, second, grid, 1.0)
    if votes.max() < GOOD_VOTE:
        votes = np.max([votes, *(_votes(first, second, grid, ratio) for ratio in RATIOS)], axis=0)
    return votes


def _votes(first: FrameObservations, second: FrameObservations, grid: Floats, ratio: float) -> Floats:
    """For each shift, the share of edges and corners of a frame that have a match in the other (near 1 at best)."""
    (a, b), (c, d) = ((frame.kind < FIRST_CORNER, frame.kind >= FIRST_CORNER) for frame in (first, second))
    edges, corners = _differences(first, second, (a, c), ratio), _differences(first, second, (b, d), ratio)
    possible = min(a.sum(), c.sum()) + CORNER_VOTE * min(b.sum(), d.sum())
    width = float(grid[1] - grid[0])
    if possible == 0 or width < 1e-6:
        return np.zeros_like(grid)
    values, weights = np.concatenate([edges, corners]), np.repeat([1.0, CORNER_VOTE], [len(edges), len(corners)])
    bins = np.round((values - grid[0]) / width).astype(np.int64)
    inside = (bins >= 0) & (bins < len(grid))
    count = np.bincount(bins[inside], weights[inside], minlength=len(grid))
    spread = KERNEL / width
    peaks: Floats = gaussian_filter1d(count, spread, mode="constant") * spread * np.sqrt(2 * np.pi)
    share: Floats = np.minimum(peaks / possible, 1.5) * possible / (possible + 1)
    return share


def _differences(
    first: FrameObservations, second: FrameObservations, chosen: tuple[Bools, Bools], ratio: float
) -> Floats:
    a, b = chosen
    apart = ratio * first.positions[a][:, None] - second.positions[b]
    like = (first.kind[a][:, None] == second.kind[b]) & (np.abs(apart[..., 1]) < MATCH)
    differences: Floats = apart[..., 0][like]
    return differences


def steps_between(views: Sequence[FrameObservations], moved: Floats) -> Floats:
    """Ratio, slide and rise (n - 1, 3) from each frame to the next: p' = ratio p + slide, q' = ratio q + rise."""
    usual = pace(moved)
    loose = np.array([np.clip(0.5 * usual, 0.01, 0.05), np.clip(usual, 0.05, 0.2), 0.05]) / MATCH_SIGMA
    likely = LEVEL * np.maximum(1.0, np.abs(moved) / max(usual, 1e-6))
    pairs = zip(views[:-1], views[1:], moved, likely, strict=True)
    return np.array([_fit(a, b, shift, loose, change) for a, b, shift, change in pairs]).reshape(-1, 3)


def chained(steps: Floats) -> Floats:
    """Scale s = 1 / t_z, u = t_x / t_z and v = t_y / t_z (n, 3) of each frame, the first at (1, 0, 0)."""
    states = np.zeros((len(steps) + 1, 3))
    states[0, 0] = 1.0
    for index, (ratio, slide, rise) in enumerate(steps):
        s, u, v = states[index]
        states[index + 1] = ratio * s, ratio * u - slide, ratio * v - rise
    return states


def _fit(first: FrameObservations, second: FrameObservations, shift: float, loose: Floats, likely: float) -> Floats:
    """Ratio, slide and rise of `second`: p' = ratio p + slide, q' = ratio q + rise. Falls back on the shift alone. Where hardly
    anything agrees, a ratio further from 1 than is `likely` is not believed: chance finds such, and the chain would break there."""
    usual = np.array([1.0, -shift, 0.0])
    starts = [usual]
    if _agreement(first, second, usual, MATCH / 2) < GOOD_MATCH * min(len(first.kind), len(second.kind)):
        ratios = [ratio for ratio in (1.0, *RATIOS) if abs(ratio - 1) < 3 * loose[0] * MATCH_SIGMA]
        starts = [np.array([ratio, -shift + slip, 0.0]) for slip in (0.0, -MATCH, MATCH) for ratio in ratios]
        starts = sorted(starts, key=lambda motion: -_agreement(first, second, motion, MATCH / 2))[:HOPEFUL]
    for _ in range(2):
        starts = [_refined(first, second, start, (usual, loose)) for start in starts]
    best = max(starts, key=lambda motion: _agreement(first, second, motion, MATCH / 4))
    few = _agreement(first, second, best, MATCH / 4) < HOPELESS * min(len(first.kind), len(second.kind))
    if few and abs(best[0] - 1) > likely:
        return _refined(first, second, usual, (usual, np.append(LEVEL_SIGMA / MATCH_SIGMA, loose[1:])))
    return best


def _agreement(first: FrameObservations, second: FrameObservations, motion: Floats, sigma: float) -> float:
    """How many edges and corners match under `motion`, closer ones counting more; less if the distance from the face changes much."""
    a, b = _matches(first, second, motion)
    apart = np.abs(_moved(first, motion)[a] - second.positions[b]).max(axis=1, initial=0.0)
    return float(np.exp(-0.5 * (apart / sigma) ** 2).sum() * (1 - 1.5 * abs(motion[0] - 1)))


def _refined(
    first: FrameObservations, second: FrameObservations, start: Floats, prior: tuple[Floats, Floats]
) -> Floats:
    """Least squares over what matches under `start` (3,), robust, held to `prior` (value, sigma over MATCH_SIGMA)."""
    a, b = _matches(first, second, start)
    before, after, level = first.positions[a], second.positions[b], first.kind[a] >= FIRST_CORNER
    rows = np.concatenate([_rows(before[:, 0], 1), _rows(before[level, 1], 2), np.diag(1 / prior[1])])
    values = np.concatenate([after[:, 0], after[level, 1], prior[0] / prior[1]])
    solution, trust = start, np.ones(len(rows))
    for _ in range(3):
        misfit = (values - rows @ solution) / MATCH_SIGMA
        trust[:-3] = 1 / (1 + misfit[:-3] ** 2)
        weighted = rows * trust[:, None]
        solution = np.linalg.solve(weighted.T @ rows, weighted.T @ values)
    return solution


def _rows(tangent: Floats, column: int) -> Floats:
    rows = np.zeros((len(tangent), 3))
    rows[:, 0], rows[:, column] = tangent, 1.0
    return rows


def _matches(first: FrameObservations, second: FrameObservations, motion: Floats) -> tuple[Ints, Ints]:
    """Edges and corners of two frames that are each other's nearest of their kind after the first is moved by `motion` (3,)."""
    if not len(first.kind) or not len(second.kind):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    moved = _moved(first, motion)
    apart = np.maximum(
        np.abs(moved[:, :1] - second.positions[:, 0]),
        np.abs(moved[:, 1:] - second.positions[:, 1]),
    )
    apart[(first.kind[:, None] != second.kind) | (apart > MATCH)] = np.inf
    best = apart.argmin(axis=1)
    rows = np.arange(len(best))
    mutual = (apart.argmin(axis=0)[best] == rows) & np.isfinite(apart[rows, best])
    return np.flatnonzero(mutual), best[mutual]


def _moved(frame: FrameObservations, motion: Floats) -> Floats:
    return np.asarray(
        motion[0] * frame.positions + np.where(frame.kind[:, None] >= FIRST_CORNER, motion[1:], [motion[1], 0.0])
    )


def rise_between(
    first: FrameObservations, second: FrameObservations, ratio: float, slide: float
) -> tuple[float, float]:
    """What q grew by beside `ratio`, for a known ratio and slide: the densest of the matching corners' differences, and how
    many agree on it."""
    a, b = first.kind >= FIRST_CORNER, second.kind >= FIRST_CORNER
    apart = second.positions[b] - ratio * first.positions[a][:, None]
    like = (first.kind[a][:, None] == second.kind[b]) & (np.abs(apart[..., 0] - slide) < MATCH)
    values = apart[..., 1][like & (np.abs(apart[..., 1]) < LARGEST_RISE)]
    if not len(values):
        return 0.0, 0.0
    near = np.abs(values[:, None] - values) < RISE_SPREAD
    liking = near.sum(axis=1) * np.exp(-0.5 * (values / USUAL_RISE) ** 2)
    best = near[liking.argmax()]
    return float(np.mean(values[best])), float(best.sum())
