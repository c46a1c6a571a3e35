"""Which coordinates of a map nothing measured."""

from dataclasses import replace

import numpy as np

from savmap.maps.assumed import assumed_coordinates
from savmap.types import FrameTable, JointCovariance, RowMap, Structure, Trajectory

SOLVED, FREE = [0, 1, 2], [0, -1, 2]
NUMBERS = np.array([SOLVED, FREE, FREE, SOLVED])
HEIGHT_SIGMAS_M = [0.6, 0.6, 0.02, 0.002]


def row() -> RowMap:
    """A post whose first end was measured badly, whose second is assumed, and whose third is worked out of what was measured."""
    covariances = np.array([np.diag([1e-6, sigma**2, 1e-6]) for sigma in HEIGHT_SIGMAS_M])
    post = Structure("post", "post", np.zeros((4, 3)), covariances, tuple("abcd"), np.zeros((0, 2), np.int64))
    joint = JointCovariance({"posts": {"post": NUMBERS}}, np.eye(3))
    path = Trajectory(np.arange(1), np.eye(4)[None])
    return RowMap("A", FrameTable(np.zeros(1), ("pass 1",)), {}, path, {"posts": (post,)}, (), joint=joint)


def test_assumed_is_what_is_unsure_and_not_solved_for() -> None:
    own = row()
    found = assumed_coordinates(own, "posts", own.structures["posts"][0])
    assert np.argwhere(found).tolist() == [[1, 1]]


def test_nothing_is_assumed_where_the_map_does_not_tell() -> None:
    own = replace(row(), joint=None)
    assert not assumed_coordinates(own, "posts", own.structures["posts"][0]).any()
