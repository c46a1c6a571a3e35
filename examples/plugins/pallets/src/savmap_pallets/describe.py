"""From the solution to pallets in the map: eight corners with covariances, and the twelve edges between them."""

from collections.abc import Sequence

import gtsam
import numpy as np

from savmap.graph import KeySpace, Solution
from savmap.types import Floats, Structure, Track
from savmap_pallets.outline import corner_slopes, corners

CORNERS = tuple(f"{level} {number}" for level in ("lower", "upper") for number in (1, 2, 3, 4))
EDGES = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]])
KNOWN_M = 1e-4


def describe(tracks: Sequence[Track], solution: Solution, size: Floats, room: str) -> list[Structure]:
    """One structure "pallet k" for each that was solved for, with its place (x, z), turn and their standard deviations."""
    keys = KeySpace(room)
    numbers = [int(track.place["pallet"]) for track in tracks]
    return [
        _pallet(number, solution, keys.pose2(number), size)
        for number in numbers
        if keys.pose2(number) in solution.variables
    ]


def _pallet(number: int, solution: Solution, key: int, size: Floats) -> Structure:
    solved = solution.variables[key]
    assert isinstance(solved, gtsam.Pose2)
    pose = np.array([solved.x(), solved.y(), solved.theta() % np.pi])
    joint = solution.variable_covariance(key)
    vertices = corners(pose, size)
    slopes = corner_slopes(pose, vertices)
    covariances = slopes @ joint @ np.swapaxes(slopes, 1, 2) + KNOWN_M**2 * np.eye(3)
    return Structure(
        id=f"pallet {number}",
        label="pallet",
        vertices=vertices,
        covariances=covariances,
        vertex_labels=CORNERS,
        edges=EDGES,
        attributes={
            "pallet": number,
            "x_m": float(pose[0]),
            "z_m": float(-pose[1]),
            "turn_deg": float(np.degrees(pose[2])),
            "sigma_m": float(np.sqrt((joint[0, 0] + joint[1, 1]) / 2)),
            "sigma_turn_deg": float(np.degrees(np.sqrt(joint[2, 2]))),
        },
    )
