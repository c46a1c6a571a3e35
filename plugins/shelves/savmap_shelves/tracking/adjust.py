"""Least squares on the face plane: camera states by frame and the coordinates of uprights' and beams' edges together.

p = x s - u + yaw (1 + p^2) + pitch p q + roll q  and  q = y s - v + yaw p q + pitch (1 + q^2) - roll p, where s = 1 / t_z,
(u, v) = (t_x, t_y) / t_z, and yaw, pitch, roll are what the rectification left over. Frames are eliminated first (Schur),
which leaves a small dense system of edges.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, coo_array, csr_array

from savmap.types import Floats, Ints

LEAST_SIGMA = 0.004


@dataclass(frozen=True)
class EdgeObservations:
    """N observations of edges: frame, edge (index of its coordinate), row (0: an x observed as p, 1: a y as q), p, q, sigma."""

    frame: Ints
    edge: Ints
    row: Ints
    p: Floats
    q: Floats
    sigma: Floats


@dataclass(frozen=True)
class GridFit:
    """States (n, 6): s, u, v, yaw, pitch, roll; coordinates of the edges (k,); residuals (N,) over their sigma."""

    states: Floats
    edges: Floats
    residual: Floats


def tilt_terms(p: Floats, q: Floats) -> Floats:
    """Derivatives (2, 3, N) of p and q to yaw, pitch and roll."""
    return np.array([[1 + p**2, p * q, q], [p * q, 1 + q**2, -p]])


def predicted(states: Floats, edges: Floats, observations: EdgeObservations) -> Floats:
    """The tangent (N,) that each observation should have."""
    state = states[observations.frame]
    tilt = tilt_terms(observations.p, observations.q)[observations.row, :, np.arange(len(observations.row))]
    offset = np.where(observations.row == 0, state[:, 1], state[:, 2])
    value: Floats = edges[observations.edge] * state[:, 0] - offset + (tilt * state[:, 3:]).sum(axis=1)
    return value


def adjusted(
    states: Floats, edges: Floats, observations: EdgeObservations, prior: Floats, rounds: int = 8, scale: float = 3.0
) -> GridFit:
    """Fit robustly (Cauchy weights at `scale` sigmas) from a start; prior (6,): sigmas that hold each state to its start,
    tilts to zero."""
    anchor = states.copy()
    anchor[:, 3:] = 0.0
    sigma = np.hypot(observations.sigma, LEAST_SIGMA)
    measured = np.where(observations.row == 0, observations.p, observations.q)
    for _ in range(rounds):
        residual = (measured - predicted(states, edges, observations)) / sigma
        weight = 1 / (1 + (residual / scale) ** 2) / sigma**2
        step_states, step_edges = _step(
            states, edges, observations, weight * residual * sigma, weight, (anchor - states, prior)
        )
        states, edges = states + step_states, edges + step_edges
    return GridFit(states, edges, (measured - predicted(states, edges, observations)) / sigma)


def _step(
    states: Floats,
    edges: Floats,
    observations: EdgeObservations,
    pull: Floats,
    weight: Floats,
    hold: tuple[Floats, Floats],
) -> tuple[Floats, Floats]:
    """One Gauss-Newton step of the states (n, 6) and of the edges (k,)."""
    count = len(observations.frame)
    by_state = np.zeros((count, 6))
    by_state[:, 0] = edges[observations.edge]
    by_state[np.arange(count), 1 + observations.row] = -1.0
    by_state[:, 3:] = tilt_terms(observations.p, observations.q)[observations.row, :, np.arange(count)]
    by_edge = states[observations.frame, 0]
    off, prior = hold
    frames, edge_count = len(states), len(edges)
    blocks = np.stack([
        np.bincount(observations.frame, weight * by_state[:, i] * by_state[:, j], minlength=frames) for i in range(6) for j in range(6)
    ], axis=1).reshape(frames, 6, 6) + np.diag(1 / prior**2)  # fmt: skip
    right = (
        np.stack([np.bincount(observations.frame, pull * by_state[:, i], minlength=frames) for i in range(6)], axis=1)
        + off / prior**2
    )
    coupling = _coupling(observations, weight * by_edge, by_state, (frames, edge_count))
    inverse = bsr_array((np.linalg.inv(blocks), np.arange(frames), np.arange(frames + 1))).tocsr()
    solved = inverse @ coupling
    free = inverse @ right.ravel()
    diagonal = np.bincount(observations.edge, weight * by_edge**2, minlength=edge_count)
    reduced = np.diag(diagonal * (1 + 1e-9) + 1e-6) - (coupling.T @ solved).toarray()
    step_edges = np.linalg.solve(
        reduced, np.bincount(observations.edge, pull * by_edge, minlength=edge_count) - coupling.T @ free
    )
    return (free - solved @ step_edges).reshape(frames, 6), step_edges


def _coupling(observations: EdgeObservations, weight: Floats, by_state: Floats, shape: tuple[int, int]) -> csr_array:
    """The normal equations' part (6 n, k) between the states and the edges."""
    rows = 6 * observations.frame[:, None] + np.arange(6)
    columns = np.broadcast_to(observations.edge[:, None], rows.shape)
    values = weight[:, None] * by_state
    return coo_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(6 * shape[0], shape[1])).tocsr()
