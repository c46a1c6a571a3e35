"""How the errors of a row's vertices go together, from the solve: what a distance between two of them needs."""

from collections.abc import Mapping, Sequence

import numpy as np

from savmap.graph import Landmark, Solution
from savmap.types import Floats, Ints, JointCovariance, Structure

SAME_M, SAME_SIGMA_M = 1e-3, 5e-4
"""Coordinates that are nearer to one another, and known to be so, are one: edges that all of a level's beams share, to 0.1 mm."""


def joint_covariance(structures: Mapping[str, Sequence[Structure]], solution: Solution) -> JointCovariance | None:
    """Of all coordinates of vertices that are, bit by bit, a landmark's of their plugin, with its variance; others are taken for independent.
    None where there is no such coordinate."""
    found = {
        plugin: {structure.id: _slots(structure, plugin, solution) for structure in group}
        for plugin, group in structures.items()
        if solution.landmarks_of(plugin)
    }
    slots = np.unique(
        np.concatenate([[-1], *(numbers.ravel() for group in found.values() for numbers in group.values())])
    )[1:]
    if not len(slots):
        return None
    covariance = solution.covariance.points[np.ix_(slots, slots)]
    group = _groups(_positions(solution)[slots], slots % 3, covariance)
    first = np.array([np.flatnonzero(group == number)[0] for number in range(group.max() + 1)])
    number_of = np.full(slots[-1] + 2, -1)
    number_of[slots] = group
    coordinates = {
        plugin: {name: number_of[numbers] for name, numbers in group.items()} for plugin, group in found.items()
    }
    return JointCovariance(coordinates, covariance[np.ix_(first, first)])


def _slots(structure: Structure, plugin: str, solution: Solution) -> Ints:
    """For each vertex and axis (v, 3) the place in the solve's covariance of the landmark that has this position and variance; -1: none has."""
    landmarks, keys = solution.landmarks_of(plugin), solution.keys[plugin]
    names = tuple(landmarks)
    first = 3 * np.array([solution.covariance.keys.index(keys[name]) for name in names])
    variances = np.diagonal(structure.covariances, axis1=1, axis2=2)
    alike = (structure.vertices[:, None] == _stacked(landmarks, "position")) & (
        variances[:, None] == np.diagonal(_stacked(landmarks, "covariance"), axis1=1, axis2=2)
    )
    slots: Ints = np.where(alike.any(axis=1), first[alike.argmax(axis=1)] + np.arange(3), -1)
    return slots


def _stacked(landmarks: Mapping[str, Landmark], name: str) -> Floats:
    return np.array([getattr(landmark, name) for landmark in landmarks.values()])


def _positions(solution: Solution) -> Floats:
    """Coordinates (3m,) of all points in the order of the solve's covariance."""
    place = {key: 3 * number for number, key in enumerate(solution.covariance.keys)}
    positions = np.full(3 * len(place), np.nan)
    for plugin, landmarks in solution.landmarks.items():
        for name, landmark in landmarks.items():
            first = place[solution.keys[plugin][name]]
            positions[first : first + 3] = landmark.position
    return positions


def _groups(positions: Floats, axes: Ints, covariance: Floats) -> Ints:
    """Numbers (n,) from 0 of groups of coordinates along the same axis that are one and the same."""
    variances = np.diag(covariance)
    apart = variances[:, None] + variances - 2 * covariance
    near = (np.abs(positions[:, None] - positions) < SAME_M) & (axes[:, None] == axes) & (apart < SAME_SIGMA_M**2)
    group: Ints = np.full(len(positions), -1)
    for number in range(len(positions)):
        group[number] = group[near[number].argmax()] if near[number].argmax() < number else group.max() + 1
    return group
