"""Which coordinates of a map nothing measured: a plugin takes them to be so, such as where a post ends that goods hide."""

import numpy as np

from savmap.types import Bools, RowMap, Structure

ASSUMED_M = 0.03
"""A coordinate that was not solved for and has a larger standard deviation than this, m, is an assumption."""


def assumed_coordinates(row: RowMap, plugin: str, structure: Structure) -> Bools:
    """For each vertex and axis (v, 3) of a structure of the row whether it is an assumption. None is where the map does not say what was solved for."""
    if row.joint is None:
        return np.zeros(structure.vertices.shape, bool)
    numbers = range(len(structure.vertices))
    solved = np.array([row.joint.solved(plugin, structure, number) for number in numbers], bool).reshape(-1, 3)
    variances = np.diagonal(structure.covariances, axis1=1, axis2=2)
    assumed: Bools = (variances > ASSUMED_M**2) & ~solved
    return assumed
