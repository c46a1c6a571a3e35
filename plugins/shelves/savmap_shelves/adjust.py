"""Least squares on the face plane: camera states by frame and the coordinates of uprights' and beams' edges together.

p = x s - u + yaw (1 + p^2) + pitch p q + roll q  and  q = y s - v + yaw p q + pitch (1 + q^2) - roll p, where s = 1 / t_z,
(u, v) = (t_x, t_y) / t_z, and yaw, pitch, roll are what the rectification left over. Frames are eliminated first (Schur),
which leaves a small dense system of edges.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, coo_array, csr_array

from savmap.types import Floats, Ints

FLOOR = 0.004


@dataclass(frozen=True)
class Sighted:
    """N observations of edges: frame, edge (index of its coordinate), row (0: an x seen as p, 1: a y seen as q), p, q, sigma."""

    frame: Ints
    edge: Ints
    row: Ints
    p: Floats
    q: Floats
    sigma: Floats


@dataclass(frozen=True)
class Fit:
    """States (n, 6): s, u, v, yaw, pitch, roll; coordinates of the edges (k,); residuals (N,) over their sigma."""

    states: Floats
    edges: Floats
    residual: Floats


def tilt_terms(p: Floats, q: Floats) -> Floats:
    """Derivatives (2, 3, N) of p and q to yaw, pitch and roll."""
    return np.array([[1 + p**2, p * q, q], [p * q, 1 + q**2, -p]])


def predicted(states: Floats, edges: Floats, seen: Sighted) -> Floats:
    """The tangent (N,) that every observation should have."""
    state = states[seen.frame]
    tilt = tilt_terms(seen.p, seen.q)[seen.row, :, np.arange(len(seen.row))]
    offset = np.where(seen.row == 0, state[:, 1], state[:, 2])
    value: Floats = edges[seen.edge] * state[:, 0] - offset + (tilt * state[:, 3:]).sum(axis=1)
    return value


def adjusted(states: Floats, edges: Floats, seen: Sighted, prior: Floats, rounds: int = 8, scale: float = 3.0) -> Fit:
    """Fit robustly (Cauchy weights at `scale` sigmas) from a start; prior (6,): sigmas that hold each state to its start,
    tilts to zero."""
    anchor = states.copy()
    anchor[:, 3:] = 0.0
    sigma = np.hypot(seen.sigma, FLOOR)
    measured = np.where(seen.row == 0, seen.p, seen.q)
    for _ in range(rounds):
        residual = (measured - predicted(states, edges, seen)) / sigma
        weight = 1 / (1 + (residual / scale) ** 2) / sigma**2
        step_states, step_edges = _step(
            states, edges, seen, weight * residual * sigma, weight, (anchor - states, prior)
        )
        states, edges = states + step_states, edges + step_edges
    return Fit(states, edges, (measured - predicted(states, edges, seen)) / sigma)


def _step(
    states: Floats, edges: Floats, seen: Sighted, pull: Floats, weight: Floats, hold: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    count = len(seen.frame)
    by_state = np.zeros((count, 6))
    by_state[:, 0] = edges[seen.edge]
    by_state[np.arange(count), 1 + seen.row] = -1.0
    by_state[:, 3:] = tilt_terms(seen.p, seen.q)[seen.row, :, np.arange(count)]
    by_edge = states[seen.frame, 0]
    off, prior = hold
    frames, edge_count = len(states), len(edges)
    blocks = np.stack([
        np.bincount(seen.frame, weight * by_state[:, i] * by_state[:, j], minlength=frames) for i in range(6) for j in range(6)
    ], axis=1).reshape(frames, 6, 6) + np.diag(1 / prior**2)  # fmt: skip
    right = (
        np.stack([np.bincount(seen.frame, pull * by_state[:, i], minlength=frames) for i in range(6)], axis=1)
        + off / prior**2
    )
    coupling = _coupling(seen, weight * by_edge, by_state, (frames, edge_count))
    inverse = bsr_array((np.linalg.inv(blocks), np.arange(frames), np.arange(frames + 1))).tocsr()
    solved = inverse @ coupling
    free = inverse @ right.ravel()
    diagonal = np.bincount(seen.edge, weight * by_edge**2, minlength=edge_count)
    reduced = np.diag(diagonal * (1 + 1e-9) + 1e-6) - (coupling.T @ solved).toarray()
    step_edges = np.linalg.solve(
        reduced, np.bincount(seen.edge, pull * by_edge, minlength=edge_count) - coupling.T @ free
    )
    return (free - solved @ step_edges).reshape(frames, 6), step_edges


def _coupling(seen: Sighted, weight: Floats, by_state: Floats, shape: tuple[int, int]) -> csr_array:
    """The normal equations' part (6 n, k) between the states and the edges."""
    rows = 6 * seen.frame[:, None] + np.arange(6)
    columns = np.broadcast_to(seen.edge[:, None], rows.shape)
    values = weight[:, None] * by_state
    return coo_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(6 * shape[0], shape[1])).tocsr()
