"""One camera path seen from several rows: which frames are the same, and the factor that says so.

Faces across an aisle are parallel only roughly, so each row keeps its frame of coordinates: world_from_rig of a frame in row a is
that in row b moved by one unknown rigid transform, a_from_b.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from savmap.graph.carry import NO_ROW, carried_key
from savmap.graph.keys import frame_key
from savmap.types import Floats, Ints

LEAST_FRAMES = 3
TIE_RAD, TIE_M = float(np.radians(0.01)), 1e-3
TURN_RAD, PLACE_M = 0.5, 20.0


@dataclass(frozen=True)
class Tie:
    """Frames (k,) of row `a` and those (k,) of row `b` that are the same pictures."""

    a: int
    b: int
    frames_a: Ints
    frames_b: Ints
    key: int


def ties_of(frames: Sequence[Ints], moments: Sequence[Sequence[Hashable]]) -> list[Tie]:
    """Ties between rows whose `frames` were located; moments[r][f] tells which picture frame f of row r is. Every shared picture
    binds each row to the first one that has it."""
    first: dict[Hashable, tuple[int, int]] = {}
    pairs: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for row, numbers in enumerate(frames):
        for frame in numbers.tolist():
            lead, number = first.setdefault(moments[row][frame], (row, frame))
            if lead != row:
                pairs.setdefault((lead, row), []).append((number, frame))
    shared = [(rows, np.array(same, np.int64)) for rows, same in pairs.items() if len(same) >= LEAST_FRAMES]
    return [
        Tie(*rows, same[:, 0], same[:, 1], carried_key(gtsam.symbol("t", number), NO_ROW))
        for number, (rows, same) in enumerate(shared)
    ]


def tie_factors(tie: Tie, a_from_b: gtsam.Pose3) -> list[gtsam.NonlinearFactor]:
    """Every shared frame's poses agree; the transform, near `a_from_b`, is all but free."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([TIE_RAD, TIE_M], 3))
    loose = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([TURN_RAD, PLACE_M], 3))
    return [
        gtsam.PriorFactorPose3(tie.key, a_from_b, loose),
        *(
            gtsam.CustomFactor(noise, [_pose(tie.a, in_a), tie.key, _pose(tie.b, in_b)], _disagreement)
            for in_a, in_b in zip(tie.frames_a.tolist(), tie.frames_b.tolist(), strict=True)
        ),
    ]


def first_transform(poses_a: Floats, poses_b: Floats) -> gtsam.Pose3:
    """a_from_b between poses (k, 4, 4) of the same frames: the mean turn, and the shift between the mean places."""
    turn = Rotation.from_matrix(poses_a[:, :3, :3] @ np.swapaxes(poses_b[:, :3, :3], 1, 2)).mean().as_matrix()
    shift = (poses_a[:, :3, 3] - poses_b[:, :3, 3] @ turn.T).mean(axis=0)
    return gtsam.Pose3(gtsam.Rot3(turn), shift)


def _pose(row: int, frame: int) -> int:
    return carried_key(frame_key(frame), row)


def _disagreement(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
    """Log(X_a^-1 T X_b), and its derivatives by small motions on the right of X_a, T and X_b."""
    in_a, a_from_b, in_b = map(values.atPose3, factor.keys())
    off = in_a.inverse().compose(a_from_b).compose(in_b)
    error: Floats = gtsam.Pose3.Logmap(off)
    if jacobians is not None:
        slope = gtsam.Pose3.LogmapDerivative(off)
        jacobians[0] = -slope @ off.inverse().AdjointMap()
        jacobians[1] = slope @ in_b.inverse().AdjointMap()
        jacobians[2] = slope
    return error
