"""How the camera moved along the face from frame to frame, from the face tangents of uprights and corners.

The shift between neighbouring frames is voted for by all pairs of like things; a shortest path over all frames (Viterbi)
chooses a smooth sequence of shifts, so that a rack's regular spacing or a false upright does not mislead a single frame.
Then scale, shift and rise of each pair of frames are fitted robustly and chained.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from savmap.types import Floats, Ints
from savmap_shelves.sightings import Catalogue, Tangents

BIN = 0.02
KERNEL = 0.05
EVIDENCE = 8.0
CHANGE = 0.05
LARGEST_CHANGE = 5.0
MATCH = 0.1


@dataclass(frozen=True)
class Glance:
    """One frame on the face plane: things (k, 2) at tangents p, q and their kind (k,).

    Kinds 0 and 1 are uprights' left and right edges where they cross the horizon (q = 0), 2 to 5 corners of beams.
    """

    places: Floats
    kind: Ints


def at_horizon(seen: Catalogue, face: Tangents) -> Floats:
    """Tangents p (n, 2) of the uprights' edges (left, right) at q = 0."""
    p, q = face.p[seen.uprights], face.q[seen.uprights]
    rise = q[:, :, 1] - q[:, :, 0]
    lean = (p[:, :, 1] - p[:, :, 0]) / np.where(np.abs(rise) > 1e-3, rise, np.nan)
    horizon: Floats = p[:, :, 0] - lean * q[:, :, 0]
    return horizon


def glances(seen: Catalogue, face: Tangents, count: int) -> list[Glance]:
    """All frames 0 .. count - 1 as their edges and corners on the face plane."""
    edges = at_horizon(seen, face)
    corners = np.stack([face.p[seen.corners], face.q[seen.corners]], axis=-1)
    corners[seen.corners < 0] = np.nan
    frame = np.concatenate([np.repeat(seen.upright_frame, 2), np.repeat(seen.beam_frame, 4)])
    kind = np.concatenate([np.tile([0, 1], len(edges)), np.tile([2, 3, 4, 5], len(corners))])
    places = np.concatenate([np.column_stack([edges.ravel(), np.zeros(edges.size)]), corners.reshape(-1, 2)])
    usable = np.isfinite(places).all(axis=1)
    order = np.flatnonzero(usable)[np.argsort(frame[usable], kind="stable")]
    starts = np.searchsorted(frame[order], np.arange(count + 1))
    return [Glance(places[order[a:b]], kind[order[a:b]]) for a, b in zip(starts[:-1], starts[1:], strict=True)]


def typical_spacing(seen: Catalogue, face: Tangents) -> float:
    """The median distance between neighbouring uprights of a frame, as a tangent; nan where no frame shows two."""
    centre = at_horizon(seen, face).mean(axis=1)
    order = np.lexsort((centre, seen.upright_view, seen.upright_frame))
    same = (np.diff(seen.upright_frame[order]) == 0) & (np.diff(seen.upright_view[order]) == 0)
    gaps = np.diff(centre[order])[same]
    gaps = gaps[np.isfinite(gaps) & (gaps > 0.2)]
    return float(np.median(gaps)) if len(gaps) else float("nan")


def shifts(views: list[Glance], steps: Floats, reach: float, travel: int) -> Floats:
    """The camera's shift to the right (n - 1,) between neighbouring frames, in units of its distance from the face.

    steps (n - 1,): the time between the frames over the usual time. reach: the largest shift in the usual time.
    travel: +1 or -1 where the direction of travel is known, 0 where it is not.
    """
    grid = np.arange(-np.ceil(reach / BIN), np.ceil(reach / BIN) + 1) * BIN
    cost = np.abs(grid) * 0.5 + np.where(grid * travel < -0.05, 20.0, 0.0)
    change = np.minimum(np.abs(grid[:, None] - grid) / CHANGE, LARGEST_CHANGE)
    table, back = np.zeros(len(grid)), np.zeros((len(steps), len(grid)), dtype=np.int64)
    for index, step in enumerate(steps):
        ways = table[:, None] + change
        back[index] = ways.argmin(axis=0)
        table = ways.min(axis=0) + cost - EVIDENCE * _votes(views[index], views[index + 1], grid * step)
    path = np.zeros(len(steps), dtype=np.int64)
    state = int(table.argmin())
    for index in range(len(steps) - 1, -1, -1):
        path[index] = state
        state = int(back[index, state])
    return grid[path] * steps


def _votes(first: Glance, second: Glance, grid: Floats) -> Floats:
    """For each shift, the share of things in one frame that have a like one in the other (near 1 at best)."""
    edges, corners = _differences(first, second, (0, 1)), _differences(first, second, (2, 3, 4, 5))
    possible = sum(
        weight * min(np.isin(first.kind, kinds).sum(), np.isin(second.kind, kinds).sum())
        for weight, kinds in ((1.0, (0, 1)), (0.1, (2, 3, 4, 5)))
    )
    if possible == 0:
        return np.zeros_like(grid)
    width = max(float(grid[1] - grid[0]), 1e-6)
    values, weights = np.concatenate([edges, corners]), np.repeat([1.0, 0.1], [len(edges), len(corners)])
    bins = np.round((values - grid[0]) / width).astype(np.int64)
    inside = (bins >= 0) & (bins < len(grid))
    count = np.bincount(bins[inside], weights[inside], minlength=len(grid))
    spread = KERNEL / width
    peaks: Floats = gaussian_filter1d(count, spread, mode="constant") * spread * np.sqrt(2 * np.pi)
    return np.minimum(peaks / possible, 1.5) * possible / (possible + 1)


def _differences(first: Glance, second: Glance, kinds: tuple[int, ...]) -> Floats:
    a, b = np.isin(first.kind, kinds), np.isin(second.kind, kinds)
    apart = first.places[a][:, None] - second.places[b]
    like = (first.kind[a][:, None] == second.kind[b]) & (np.abs(apart[..., 1]) < MATCH)
    differences: Floats = apart[..., 0][like]
    return differences


def chained(views: list[Glance], moved: Floats) -> Floats:
    """Scale s = 1 / t_z, u = t_x / t_z and v = t_y / t_z (n, 3) of every frame, the first at (1, 0, 0)."""
    states = np.zeros((len(views), 3))
    states[0, 0] = 1.0
    for index, shift in enumerate(moved):
        ratio, slide, rise = _fit(views[index], views[index + 1], shift)
        s, u, v = states[index]
        states[index + 1] = ratio * s, ratio * u - slide, ratio * v - rise
    return states


def _fit(first: Glance, second: Glance, shift: float) -> Floats:
    """Ratio, slide and rise of `second`: p' = ratio p + slide, q' = ratio q + rise. Falls back on the shift alone."""
    a, b = _matches(first, second, shift)
    before, after, level = first.places[a], second.places[b], first.kind[a] >= 2
    rows = np.concatenate([_rows(before[:, 0], 1), _rows(before[level, 1], 2), np.diag([1 / 0.03, 1 / 0.2, 1 / 0.05]) * 0.01])
    values = np.concatenate([after[:, 0], after[level, 1], np.array([1 / 0.03, -shift / 0.2, 0.0]) * 0.01])
    solution = np.array([1.0, -shift, 0.0])
    trust = np.ones(len(rows))
    for _ in range(5):
        misfit = (values - rows @ solution) / 0.015
        trust[:-3] = 1 / (1 + misfit[:-3] ** 2)
        weighted = rows * trust[:, None]
        solution = np.linalg.solve(weighted.T @ rows, weighted.T @ values)
    return solution


def _rows(tangent: Floats, column: int) -> Floats:
    rows = np.zeros((len(tangent), 3))
    rows[:, 0], rows[:, column] = tangent, 1.0
    return rows


def _matches(first: Glance, second: Glance, shift: float) -> tuple[Ints, Ints]:
    if not len(first.kind) or not len(second.kind):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    apart = np.abs(first.places[:, None] - [shift, 0.0] - second.places).max(axis=2)
    apart[(first.kind[:, None] != second.kind) | (apart > MATCH)] = np.inf
    best = apart.argmin(axis=1)
    mutual = (apart.argmin(axis=0)[best] == np.arange(len(best))) & np.isfinite(apart.min(axis=1))
    return np.flatnonzero(mutual), best[mutual]
