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


@dataclass(frozen=True, eq=False)
class EdgeObservations:
    """N observations of edges: frame, edge (index of its coordinate), row (0: an x observed as p, 1: a y as q), p, q, sigma."""

    frame: Ints
    edge: Ints
    row: Ints
    p: Floats
    q: Floats
    sigma: Floats

    @property
    def measured(self) -> Floats:
        """The observed tangent (N,)."""
        return np.where(self.row == 0, self.p, self.q)

    @property
    def tilt_terms(self) -> Floats:
        """Derivatives (N, 3) of the observed tangent to yaw, pitch and roll."""
        p, q = self.p, self.q
        return np.array([[1 + p**2, p * q, q], [p * q, 1 + q**2, -p]])[self.row, :, np.arange(len(self.row))]


@dataclass(frozen=True, eq=False)
class GridFit:
    """States (n, 6): s, u, v, yaw, pitch, roll; coordinates of the edges (k,); residuals (N,) over their sigma."""

    states: Floats
    edges: Floats
    residual: Floats


def predicted(states: Floats, edges: Floats, observations: EdgeObservations) -> Floats:
    """The tangent (N,) that each observation should have."""
    state = states[observations.frame]
    offset = np.where(observations.row == 0, state[:, 1], state[:, 2])
    value: Floats = (
        edges[observations.edge] * state[:, 0] - offset + (observations.tilt_terms * state[:, 3:]).sum(axis=1)
    )
    return value


def adjusted(
    states: Floats, edges: Floats, observations: EdgeObservations, prior: Floats, rounds: int = 8, scale: float = 3.0
) -> GridFit:
    """A robust fit (Cauchy weights at `scale` sigmas); prior (6,): sigmas that hold states to their start, tilts to 0."""
    anchor = states.copy()
    anchor[:, 3:] = 0.0
    sigma = np.hypot(observations.sigma, LEAST_SIGMA)
    for _ in range(rounds):
        residual = (observations.measured - predicted(states, edges, observations)) / sigma
        weight = 1 / (1 + (residual / scale) ** 2) / sigma**2
        pull, hold = weight * residual * sigma, (anchor - states) / prior**2
        step_states, step_edges = _step(states, edges, observations, pull, weight, hold, prior)
        states, edges = states + step_states, edges + step_edges
    return GridFit(states, edges, (observations.measured - predicted(states, edges, observations)) / sigma)


def _step(
    states: Floats,
    edges: Floats,
    observations: EdgeObservations,
    pull: Floats,
    weight: Floats,
    hold: Floats,
    prior: Floats,
) -> tuple[Floats, Floats]:
    """One Gauss-Newton step of the states (n, 6) and of the edges (k,)."""
    frame, count = observations.frame, len(observations.frame)
    by_state = np.zeros((count, 6))
    by_state[:, 0] = edges[observations.edge]
    by_state[np.arange(count), 1 + observations.row] = -1.0
    by_state[:, 3:] = observations.tilt_terms
    by_edge = states[frame, 0]
    frames, edge_count = len(states), len(edges)
    products = [weight * by_state[:, i] * by_state[:, j] for i, j in np.ndindex(6, 6)]
    sums = [np.bincount(frame, product, minlength=frames) for product in products]
    blocks = np.stack(sums, axis=1).reshape(frames, 6, 6) + np.diag(1 / prior**2)
    pulls = [np.bincount(frame, pull * by_state[:, i], minlength=frames) for i in range(6)]
    right = np.stack(pulls, axis=1) + hold
    coupling = _coupling(observations, weight * by_edge, by_state, (frames, edge_count))
    inverse = bsr_array((np.linalg.inv(blocks), np.arange(frames), np.arange(frames + 1))).tocsr()
    solved = inverse @ coupling
    free = inverse @ right.ravel()
    diagonal = np.bincount(observations.edge, weight * by_edge**2, minlength=edge_count)
    reduced = np.diag(diagonal * (1 + 1e-9) + 1e-6) - (coupling.T @ solved).toarray()
    pulls_edges = np.bincount(observations.edge, pull * by_edge, minlength=edge_count)
    step_edges = np.linalg.solve(reduced, pulls_edges - coupling.T @ free)
    return (free - solved @ step_edges).reshape(frames, 6), step_edges


def _coupling(observations: EdgeObservations, weight: Floats, by_state: Floats, shape: tuple[int, int]) -> csr_array:
    """The normal equations' part (6 n, k) between the states and the edges."""
    rows = 6 * observations.frame[:, None] + np.arange(6)
    columns = np.broadcast_to(observations.edge[:, None], rows.shape)
    values = weight[:, None] * by_state
    return coo_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(6 * shape[0], shape[1])).tocsr()
