"""Points nearest to rays: of many cameras, or of two lines."""

import numpy as np

from savmap.geometry.arrays import Floats


def nearest_point(origins: Floats, directions: Floats, rounds: int = 5) -> Floats:
    """The point (3,) nearest to rays (n, 3) + s (n, 3), re-weighted by 1 / (distance + 5 cm) so that outliers count
    little.

    Raises ValueError when the rays are parallel.
    """
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.eye(3) - unit[:, :, None] * unit[:, None, :]
    weights = np.ones(len(unit))
    point = np.zeros(3)
    for _ in range(rounds):
        normal = np.einsum("n,nij->ij", weights, across)
        if np.linalg.cond(normal) > 1e9:
            raise ValueError("the rays are parallel")
        point = np.linalg.solve(normal, np.einsum("n,nij,nj->i", weights, across, origins))
        distance = np.linalg.norm(np.einsum("nij,nj->ni", across, point - origins), axis=1)
        weights = 1 / (distance + 0.05)
    return point


def nearest_points(origins: Floats, directions: Floats) -> Floats:
    """The points (n, 3) nearest to k rays each: from origins (k, 3) along unit directions (n, k, 3). Along parallel
    rays: anywhere."""
    across = np.eye(3) - directions[..., :, None] * directions[..., None, :]
    right = np.einsum("nkij,kj->ni", across, origins)
    points: Floats = np.linalg.solve(across.sum(axis=1) + 1e-9 * np.eye(3), right[..., None])[..., 0]
    return points


def midway(origin: Floats, ray: Floats, other_origin: Floats, other_ray: Floats) -> Floats:
    """The points (..., 3) midway between two lines where they are nearest to one another; the rays are unit vectors and
    not parallel."""
    offset = origin - other_origin
    turn = (ray * other_ray).sum(axis=-1, keepdims=True)
    along, other_along = (ray * offset).sum(axis=-1, keepdims=True), (other_ray * offset).sum(axis=-1, keepdims=True)
    reach = (turn * other_along - along) / (1 - turn**2)
    other_reach = (other_along - turn * along) / (1 - turn**2)
    points: Floats = 0.5 * (origin + reach * ray + other_origin + other_reach * other_ray)
    return points
