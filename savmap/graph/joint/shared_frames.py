"""Frames that several rows share, and the factors that make their poses agree.

Faces across an aisle are parallel only roughly, so each row keeps its frame of coordinates: world_from_rig of a frame
in row a is that in row b moved by one unknown rigid transform, a_from_b.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from savmap.graph.keys import NO_ROW, frame_key, rekey
from savmap.types import Floats, Ints

LEAST_FRAMES = 3
EQUAL_RAD, EQUAL_M = float(np.radians(0.01)), 1e-3
TURN_RAD, PLACE_M = 0.5, 20.0


@dataclass(frozen=True, eq=False)
class SharedFrames:
    """Frames (k,) of row `a` and those (k,) of row `b` that are the same pictures; `key` of the transform a_from_b."""

    a: int
    b: int
    frames_a: Ints
    frames_b: Ints
    key: int


def shared_frames(frames: Sequence[Ints], moments: Sequence[Sequence[Hashable]]) -> list[SharedFrames]:
    """Shared frames of pairs of rows whose `frames` were located; moments[r][f] identifies the picture that is frame f
    of row r. Every shared picture binds each row to the first one that has it."""
    first: dict[Hashable, tuple[int, int]] = {}
    pairs: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for row, numbers in enumerate(frames):
        for frame in numbers.tolist():
            lead, number = first.setdefault(moments[row][frame], (row, frame))
            if lead != row:
                pairs.setdefault((lead, row), []).append((number, frame))
    enough = [(rows, np.array(same, np.int64)) for rows, same in pairs.items() if len(same) >= LEAST_FRAMES]
    return [
        SharedFrames(*rows, same[:, 0], same[:, 1], rekey(gtsam.symbol("t", number), NO_ROW))
        for number, (rows, same) in enumerate(enough)
    ]


def shared_frame_factors(shared: SharedFrames, a_from_b: gtsam.Pose3) -> list[gtsam.NonlinearFactor]:
    """The poses of every shared frame agree; the transform has a wide prior about `a_from_b`."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([EQUAL_RAD, EQUAL_M], 3))
    loose = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([TURN_RAD, PLACE_M], 3))
    return [
        gtsam.PriorFactorPose3(shared.key, a_from_b, loose),
        *(
            gtsam.CustomFactor(noise, [_pose(shared.a, in_a), shared.key, _pose(shared.b, in_b)], _disagreement)
            for in_a, in_b in zip(shared.frames_a.tolist(), shared.frames_b.tolist(), strict=True)
        ),
    ]


def first_transform(poses_a: Floats, poses_b: Floats) -> gtsam.Pose3:
    """a_from_b between poses (k, 4, 4) of the same frames: the mean rotation, and the shift between the mean
    positions."""
    turn = Rotation.from_matrix(poses_a[:, :3, :3] @ np.swapaxes(poses_b[:, :3, :3], 1, 2)).mean().as_matrix()
    shift = (poses_a[:, :3, 3] - poses_b[:, :3, 3] @ turn.T).mean(axis=0)
    return gtsam.Pose3(gtsam.Rot3(turn), shift)


def _pose(row: int, frame: int) -> int:
    return rekey(frame_key(frame), row)


def _disagreement(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
    """Log(X_a^-1 T X_b), and its derivatives by small motions on the right of X_a, T and X_b."""
    in_a, a_from_b, in_b = map(values.atPose3, factor.keys())
    difference = in_a.inverse().compose(a_from_b).compose(in_b)
    error: Floats = gtsam.Pose3.Logmap(difference)
    if jacobians is not None:
        slope = gtsam.Pose3.LogmapDerivative(difference)
        jacobians[0] = -slope @ difference.inverse().AdjointMap()
        jacobians[1] = slope @ in_b.inverse().AdjointMap()
        jacobians[2] = slope
    return error
