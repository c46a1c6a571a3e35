"""Poses between known ones: rotations interpolated on the sphere (slerp), positions linearly; held before the first and
after the last."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from savmap.geometry.arrays import Floats, Ints


def poses_at(wanted: Floats | Ints, known: Floats | Ints, poses: Floats) -> Floats:
    """Transforms (m, 4, 4) at times or frame numbers `wanted` (m,) from `poses` (n, 4, 4) at those `known` (n,), in
    order, n >= 1."""
    filled = np.tile(np.eye(4), (len(wanted), 1, 1))
    if len(wanted):
        filled[:, :3, :3] = rotations_at(wanted, known, poses[:, :3, :3])
        filled[:, :3, 3] = columns_at(wanted, known, poses[:, :3, 3])
    return filled


def rotations_at(wanted: Floats | Ints, known: Floats | Ints, rotations: Floats) -> Floats:
    """Rotations (m, 3, 3) at times or frame numbers `wanted` (m,) from `rotations` (n, 3, 3) at those `known` (n,), in
    order, n >= 1."""
    if len(known) == 1:
        return np.repeat(rotations, len(wanted), axis=0)
    path = Slerp(known, Rotation.from_matrix(rotations))
    turned: Floats = path(np.clip(wanted, known[0], known[-1])).as_matrix()
    return turned


def columns_at(wanted: Floats | Ints, known: Floats | Ints, values: Floats) -> Floats:
    """Values (m, k), interpolated linearly, at times or frame numbers `wanted` (m,) from `values` (n, k) at those
    `known` (n,)."""
    return np.stack([np.interp(wanted, known, column) for column in values.T], axis=1)
