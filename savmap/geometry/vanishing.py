"""Orientation from straight edges: vanishing points of a building's three axes on the sphere.

The camera and an edge lie in a plane; the plane's unit normal is perpendicular to the edge's own
direction. Every edge parallel to an axis d therefore gives n . d = 0, wherever it is (paper, section III-E).
"""

from dataclasses import dataclass

import numpy as np

from savmap.geometry.arrays import Floats, Ints, array_record

RIG_UP = np.array([0.0, -1.0, 0.0])
RIG_FORWARD = np.array([0.0, 0.0, 1.0])
SEARCHED_EDGES = 500
SEARCHED_PAIRS = 4000
SEARCHED_AXES = 40
SEARCH_SIGMA = np.radians(1.5)
FINE_SIGMA = np.radians(0.3)
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


@dataclass(frozen=True, eq=False)
@array_record
class Manhattan:
    """Rotation (3, 3) whose columns are a building's axes in the rig frame (x right, y up, z towards the camera as one
    looks along -z), and the share of the edges' length that follows them."""

    rig_from_manhattan: Floats
    support: float


@dataclass(frozen=True, eq=False)
@array_record
class Orientation:
    """world_from_rig (3, 3) and the information (3, 3) in rad^-2 about small turns of the rig, in rig axes."""

    world_from_rig: Floats
    information: Floats


def plane_normals(rays_a: Floats, rays_b: Floats) -> tuple[Floats, Floats]:
    """Unit normals (n, 3) of the planes through pairs of rays (n, 3), and the angles (n,) between the rays, radians."""
    cross = np.cross(rays_a, rays_b)
    sine = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(sine, 1e-12)[:, None], np.arctan2(sine, np.sum(rays_a * rays_b, axis=1))


def manhattan_from_segments(rays_a: Floats, rays_b: Floats, start: Floats | None = None) -> Manhattan | None:
    """The three perpendicular directions that most of the segments' length follows; None for fewer than six segments.

    rays_a, rays_b: (n, 3) unit rays of the segments' ends, rig frame. Searched for over the sphere (pairs of segments
    propose an axis, then the turn about it is tried degree by degree), or refined from `start` (3, 3).
    """
    normals, lengths = plane_normals(rays_a, rays_b)
    if len(normals) < 6:
        return None
    rotation = _searched(normals, lengths) if start is None else start
    for sigma in np.geomspace(2 * SEARCH_SIGMA, FINE_SIGMA, 12):
        rotation = _refined(rotation, normals, lengths, float(sigma))
    close = np.abs(normals @ rotation).min(axis=1) < 3 * FINE_SIGMA
    upright = start if start is not None else facing(rotation, RIG_UP, -RIG_FORWARD)
    return Manhattan(facing(rotation, upright[:, 1], upright[:, 2]), float(lengths[close].sum() / lengths.sum()))


def facing(axes: Floats, up: Floats, towards: Floats) -> Floats:
    """Relabel three axes (columns, any order and sign) so that y is nearest `up` and z, of the others, nearest
    `towards`."""
    directions = np.hstack([axes, -axes])
    y = directions[:, int(np.argmax(up @ directions))]
    level = np.abs(y @ directions) < 0.5
    z = directions[:, level][:, int(np.argmax(towards @ directions[:, level]))]
    return np.column_stack([np.cross(y, z), y, z])


def _searched(normals: Floats, lengths: Floats) -> Floats:
    longest = np.argsort(-lengths)[:SEARCHED_EDGES]
    normals, lengths = normals[longest], lengths[longest]
    turns = np.radians(np.arange(0.0, 90.0, 1.0))
    best, rotation = -np.inf, np.eye(3)
    for axis in _proposed(normals, lengths):
        e1 = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        e1 /= np.linalg.norm(e1)
        e2 = np.cross(axis, e1)
        along = np.outer(normals @ e1, np.cos(turns)) + np.outer(normals @ e2, np.sin(turns))
        across = np.outer(normals @ e2, np.cos(turns)) - np.outer(normals @ e1, np.sin(turns))
        closest = np.minimum(np.minimum(np.abs(along), np.abs(across)), np.abs(normals @ axis)[:, None])
        scores = lengths @ np.exp(-0.5 * (closest / SEARCH_SIGMA) ** 2)
        turn = int(np.argmax(scores))
        if scores[turn] > best:
            second = np.cos(turns[turn]) * e1 + np.sin(turns[turn]) * e2
            best, rotation = scores[turn], np.column_stack([axis, second, np.cross(axis, second)])
    return rotation


def _proposed(normals: Floats, lengths: Floats) -> Floats:
    """Axes (m, 3) that much of the edges' length follows, each at least a few degrees from the others, best first."""
    rng = np.random.default_rng(0)
    pairs = rng.choice(len(normals), (SEARCHED_PAIRS, 2), p=lengths / lengths.sum())
    axes = np.cross(normals[pairs[:, 0]], normals[pairs[:, 1]])
    norm = np.linalg.norm(axes, axis=1)
    axes = axes[norm > 0.1] / norm[norm > 0.1, None]
    scores = np.exp(-0.5 * (axes @ normals.T / SEARCH_SIGMA) ** 2) @ lengths
    kept: list[Floats] = []
    for axis in axes[np.argsort(-scores)]:
        if all(abs(float(axis @ other)) < np.cos(np.radians(3)) for other in kept):
            kept.append(axis)
        if len(kept) == SEARCHED_AXES:
            break
    return np.array(kept).reshape(-1, 3)


def _refined(rotation: Floats, normals: Floats, lengths: Floats, sigma: float) -> Floats:
    """One reweighted step, with each edge assigned to the axis that it fits best."""
    cosines = normals @ rotation
    nearest = np.argmin(np.abs(cosines), axis=1)
    residuals = cosines[np.arange(len(normals)), nearest]
    weights = lengths / (1 + (residuals / sigma) ** 2) ** 2
    jacobian = np.cross(rotation.T[nearest], normals)
    information = (jacobian * weights[:, None]).T @ jacobian + 1e-6 * weights.sum() * np.eye(3)
    return rotation_from_vector(-np.linalg.solve(information, jacobian.T @ (weights * residuals))) @ rotation


def rotation_from_vector(vector: Floats) -> Floats:
    """Rotation (3, 3) about a vector (3,) by its length in radians."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turned: Floats = np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
    return turned


def orientation_from_edges(
    rays_a: Floats, rays_b: Floats, axes: Ints, sigmas_rad: Floats, start: Floats
) -> Orientation:
    """world_from_rig from edges of known world axes seen in one frame, by reweighted least squares (Geman-McClure).

    rays_a, rays_b: (n, 3) unit rays of the edges' ends, rig frame; axes (n,) 0, 1, 2 for x, y, z; sigmas_rad (n,) or
    (n, 2) standard deviation of the ends across the edge, radians; start (3, 3) world_from_rig within some 20 degrees.
    """
    normals, _ = plane_normals(rays_a, rays_b)
    ends = np.broadcast_to(sigmas_rad[:, None] if sigmas_rad.ndim == 1 else sigmas_rad, (len(axes), 2))
    in_plane = _in_plane(rays_a, rays_b)
    rotation = start
    information = np.zeros((3, 3))
    for floor in [*np.radians(np.geomspace(4, 0.05, 8)), 0.0, 0.0, 0.0, 0.0]:
        directions = rotation[axes]
        residuals = np.sum(normals * directions, axis=1)
        sigmas = np.maximum(_sigmas(in_plane, directions, ends), floor)
        weights = 1 / sigmas**2 / (1 + (residuals / sigmas / 3) ** 2) ** 2
        jacobian = _cross(directions, normals)
        information = (jacobian * weights[:, None]).T @ jacobian
        step = -np.linalg.solve(information + np.eye(3), jacobian.T @ (weights * residuals))
        rotation = rotation @ rotation_from_vector(step).T
    return Orientation(rotation, information)


def _cross(a: Floats, b: Floats) -> Floats:
    """`np.cross` of (n, 3) and (n, 3), several times faster for a few dozen rows."""
    return np.asarray(a[:, _NEXT] * b[:, _LAST] - a[:, _LAST] * b[:, _NEXT])


def _in_plane(rays_a: Floats, rays_b: Floats) -> Floats:
    """Forms (n, 2, 3) that give alpha and beta of directions d = alpha a + beta b in the planes of rays a, b (n, 3)."""
    cosine = np.sum(rays_a * rays_b, axis=1)[:, None]
    area = np.maximum(1 - cosine**2, 1e-9)
    return np.stack([(rays_a - cosine * rays_b) / area, (rays_b - cosine * rays_a) / area], axis=1)


def _sigmas(in_plane: Floats, directions: Floats, ends: Floats) -> Floats:
    """Standard deviations (n,) of n . d: with d = alpha a + beta b in the edge's plane, the ends' errors add up."""
    shares = (in_plane @ directions[:, :, None])[:, :, 0] * ends
    return np.maximum(np.hypot(shares[:, 0], shares[:, 1]), 1e-6)
