"""Poses between given ones: rotations interpolated on the sphere (slerp), positions linearly; held before the first and
after the last."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from savmap.geometry.arrays import Floats, Ints

ROUNDS, CLOSE_RAD, NEAR_RAD = 10, float(np.radians(0.2)), float(np.radians(3.0))


def poses_at(wanted: Floats | Ints, given: Floats | Ints, poses: Floats) -> Floats:
    """Transforms (m, 4, 4) at times or frame numbers `wanted` (m,) from `poses` (n, 4, 4) at those `given` (n,), in
    order, n >= 1."""
    filled = np.tile(np.eye(4), (len(wanted), 1, 1))
    if len(wanted):
        filled[:, :3, :3] = rotations_at(wanted, given, poses[:, :3, :3])
        filled[:, :3, 3] = columns_at(wanted, given, poses[:, :3, 3])
    return filled


def rotations_at(wanted: Floats | Ints, given: Floats | Ints, rotations: Floats) -> Floats:
    """Rotations (m, 3, 3) at times or frame numbers `wanted` (m,) from `rotations` (n, 3, 3) at those `given` (n,), in
    order, n >= 1."""
    if len(given) == 1:
        return np.repeat(rotations, len(wanted), axis=0)
    path = Slerp(given, Rotation.from_matrix(rotations))
    turned: Floats = path(np.clip(wanted, given[0], given[-1])).as_matrix()
    return turned


def columns_at(wanted: Floats | Ints, given: Floats | Ints, values: Floats) -> Floats:
    """Values (m, k), interpolated linearly, at times or frame numbers `wanted` (m,) from `values` (n, k) at those
    `given` (n,)."""
    return np.stack([np.interp(wanted, given, column) for column in values.T], axis=1)


def middle_rotation(rotations: Floats) -> Floats:
    """The rotation (3, 3) amid rotations (n, 3, 3): the sum of the angles to it is least, so that outliers count
    little."""
    turns = Rotation.from_matrix(rotations)
    middle = turns.mean()
    for _ in range(ROUNDS):
        off = np.atleast_1d((turns * middle.inv()).magnitude())
        middle = turns.mean(1 / (off + CLOSE_RAD))
    return np.asarray(middle.as_matrix())


def usual_rotation(rotations: Floats) -> Floats:
    """The rotation (3, 3) amid those of rotations (n, 3, 3) that most others are near, however many are far off."""
    near = np.abs(np.einsum("nij,mij->nm", rotations, rotations) - 3.0) < 2 * (1 - np.cos(NEAR_RAD))
    return middle_rotation(rotations[near[near.sum(axis=1).argmax()]])
