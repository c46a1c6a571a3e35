"""The rig's attitude in every frame from the directions of the uprights' and beams' edges (vanishing points).

An edge's two ends span a plane through the camera; its normal is at right angles to the edge's direction. Uprights'
edges follow y, beams' edges x. Small rotations are solved for all frames at once, each held to those of the frames beside
it, so that a frame with few edges borrows from its neighbours (paper, III.E: orientation from vanishing points).
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from savmap.types import Floats, Ints, ViewSpec
from savmap_shelves.tracking.sightings import Sightings, rig_rays

EDGE_SIGMA = 0.004
SCALES = (30.0, 30.0, 10.0, 5.0, 3.0, 3.0, 3.0)


def facing(view: ViewSpec) -> Floats:
    """World_from_rig (3, 3) for a view that looks straight at the face."""
    return np.diag([1.0, -1.0, -1.0]) @ view.rig_from_view.T


def rectified(sightings: Sightings, start: Floats, neighbour: Floats, prior_sigma: float) -> Floats:
    """World_from_rig (n, 3, 3), from `start` (n, 3, 3).

    neighbour (n - 1,): standard deviation in radians of the correction's change from each frame to the next (inf where a
    new pass begins). prior_sigma: of the correction itself.
    """
    rays = rig_rays(sightings.points, sightings.views)
    crossed = np.cross(rays[sightings.edges[:, 0]], rays[sightings.edges[:, 1]])
    length = np.linalg.norm(crossed, axis=1)
    kept = length > 0.02
    normals, weight = crossed[kept] / length[kept, None], length[kept] / EDGE_SIGMA
    frame = sightings.points.frame[sightings.edges[kept, 0]]
    axes = np.eye(3)[sightings.edge_axis[kept]]
    attitude = start
    total = np.zeros((len(start), 3))
    for scale in SCALES:
        step = _step(attitude, total, (frame, normals, axes, weight), scale, neighbour, prior_sigma)
        attitude = Rotation.from_rotvec(step).as_matrix() @ attitude
        total = total + step
    return attitude


def _step(
    attitude: Floats,
    total: Floats,
    edges: tuple[Ints, Floats, Floats, Floats],
    scale: float,
    neighbour: Floats,
    prior_sigma: float,
) -> Floats:
    frame, normals, axes, weight = edges
    count = len(attitude)
    turned = np.einsum("nij,nj->ni", attitude[frame], normals)
    residual = (turned * axes).sum(axis=1) * weight
    jacobian = np.cross(turned, axes) * weight[:, None]
    trust = 1 / (1 + (residual / scale) ** 2) ** 2
    blocks = np.zeros((count, 3, 3))
    np.add.at(blocks, frame, trust[:, None, None] * jacobian[:, :, None] * jacobian[:, None, :])
    right = np.zeros((count, 3))
    np.add.at(right, frame, -(trust * residual)[:, None] * jacobian)
    blocks += np.eye(3) / prior_sigma**2
    right -= total / prior_sigma**2
    stiffness = 1 / neighbour**2
    change = np.diff(total, axis=0) * stiffness[:, None]
    right[:-1] += change
    right[1:] -= change
    return _solve_chain(blocks, right, stiffness)


def _solve_chain(blocks: Floats, right: Floats, stiffness: Floats) -> Floats:
    """Solve the block-tridiagonal system whose off-diagonal blocks are -stiffness I."""
    count = len(blocks)
    diagonal = blocks.copy()
    diagonal[:-1] += stiffness[:, None, None] * np.eye(3)
    diagonal[1:] += stiffness[:, None, None] * np.eye(3)
    base = 3 * np.arange(count)
    rows = np.broadcast_to(base[:, None, None] + np.arange(3)[:, None], (count, 3, 3)).ravel()
    columns = np.broadcast_to(base[:, None, None] + np.arange(3), (count, 3, 3)).ravel()
    beside = (base[:-1, None] + np.arange(3)).ravel()
    off = -np.repeat(stiffness, 3)
    matrix = coo_array(
        (
            np.concatenate([diagonal.ravel(), off, off]),
            (np.concatenate([rows, beside, beside + 3]), np.concatenate([columns, beside + 3, beside])),
        ),
        shape=(3 * count, 3 * count),
    )
    return spsolve(matrix.tocsc(), right.ravel()).reshape(count, 3)
