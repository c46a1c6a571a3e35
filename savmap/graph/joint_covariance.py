"""How the errors of a row's vertices go together, from the solve: what a distance between two of them needs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.graph.solver.solution import Landmark, Solution
from savmap.types import Floats, Ints, JointCovariance, Structure

SAME_M, SAME_SIGMA_M = 1e-3, 5e-4
"""Coordinates that are nearer to one another, and known to be so, are one: edges that all of a level's beams share, to
0.1 mm."""


def joint_covariance(structures: Mapping[str, Sequence[Structure]], solution: Solution) -> JointCovariance | None:
    """Of all coordinates of vertices that are, bit by bit, a landmark's of their plugin, with its variance; others are
    taken for independent. None where there is no such coordinate."""
    place = {key: 3 * number for number, key in enumerate(solution.covariance.keys)}
    positions = np.full(3 * len(place), np.nan)
    slots_by_id: dict[str, dict[str, Ints]] = {}
    for plugin, group in structures.items():
        landmarks, keys = solution.landmarks_of(plugin), solution.keys.get(plugin, {})
        if landmarks:
            points = _Points.of(landmarks, np.array([place[keys[name]] for name in landmarks]))
            positions[points.slots] = points.positions
            slots_by_id[plugin] = {structure.id: points.slots_of(structure) for structure in group}
    slots = np.unique(
        np.concatenate([[-1], *(numbers.ravel() for group in slots_by_id.values() for numbers in group.values())])
    )[1:]
    if not len(slots):
        return None
    covariance = solution.covariance.points[np.ix_(slots, slots)]
    same = _groups(positions[slots], slots % 3, covariance)
    _, first = np.unique(same, return_index=True)
    number_of = np.full(slots[-1] + 2, -1)
    number_of[slots] = same
    coordinates = {
        plugin: {name: number_of[numbers] for name, numbers in group.items()} for plugin, group in slots_by_id.items()
    }
    return JointCovariance(coordinates, covariance[np.ix_(first, first)], solution.covariance.hidden[:, slots[first]])


@dataclass(frozen=True, eq=False)
class _Points:
    """A plugin's landmarks: places (m, 3) of their coordinates in the solve's covariance, positions (m, 3) m and
    variances (m, 3) m^2."""

    slots: Ints
    positions: Floats
    variances: Floats

    @classmethod
    def of(cls, landmarks: Mapping[str, Landmark], first: Ints) -> "_Points":
        """Landmarks whose x stand at `first` (m,)."""
        positions = np.array([landmark.position for landmark in landmarks.values()])
        variances = np.array([np.diag(landmark.covariance) for landmark in landmarks.values()])
        return cls(first[:, None] + np.arange(3), positions, variances)

    def slots_of(self, structure: Structure) -> Ints:
        """For each vertex and axis (v, 3) the place of the landmark's coordinate that has this position and variance;
        -1: none has."""
        variances = np.diagonal(structure.covariances, axis1=1, axis2=2)
        alike = (structure.vertices[:, None] == self.positions) & (variances[:, None] == self.variances)
        slots: Ints = np.where(alike.any(axis=1), self.slots[alike.argmax(axis=1), np.arange(3)], -1)
        return slots


def _groups(positions: Floats, axes: Ints, covariance: Floats) -> Ints:
    """Numbers (n,) from 0 of groups of coordinates along the same axis that are one and the same."""
    variances = np.diag(covariance)
    spread = variances[:, None] + variances - 2 * covariance
    near = (np.abs(positions[:, None] - positions) < SAME_M) & (axes[:, None] == axes) & (spread < SAME_SIGMA_M**2)
    group: Ints = np.full(len(positions), -1)
    for number in range(len(positions)):
        group[number] = group[near[number].argmax()] if near[number].argmax() < number else group.max() + 1
    return group
