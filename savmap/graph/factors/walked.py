"""The form of a drive's path as factors: how the camera turned from frame to frame, and where each frame lies between
its neighbours, in whatever scale. They bind frames to one another, and to no place, no scale and no structure."""

from collections.abc import Iterator
from itertools import pairwise

import gtsam
import numpy as np

from savmap.graph.constraints import Constraints
from savmap.graph.factors.appearance import skew
from savmap.graph.keys import frame_key
from savmap.graph.measurements import image_measurements
from savmap.types import Floats, FrameTable, Ints, Trajectory

PLUGIN = "walk"
TURN_SIGMA_DEG, PLACE_SIGMA = 0.1, 0.002
"""Of a turn, and of a place between two neighbours, as a share of how far these are apart."""
FREE_M = 1e3
LEAST_SHARE = 0.3
"""Of the way, by which the outer two of three frames are apart where the one between tells anything."""


def walked_constraints(walked: Trajectory, table: FrameTable, frames: Ints) -> Constraints:
    """The form of a `walked` path of known turns and unknown scale, at those of its frames (n,) that are solved for,
    each pass by itself."""
    graph = gtsam.NonlinearFactorGraph()
    sigmas = np.append(np.full(3, np.radians(TURN_SIGMA_DEG)), np.full(3, FREE_M))
    turn = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    poses = dict(zip(walked.frames.tolist(), walked.world_from_rig, strict=True))
    for numbers in runs(walked, table, frames):
        for frame, following in pairwise(numbers):
            between = gtsam.Pose3(poses[frame]).between(gtsam.Pose3(poses[following]))
            graph.add(gtsam.BetweenFactorPose3(frame_key(frame), frame_key(following), between, turn))
    for three, share in shares(walked, table, frames):
        graph.push_back(place_factor([frame_key(frame) for frame in three], share))
    return Constraints(PLUGIN, {}, image_measurements((), {}, {}), (), {}, factors=graph)


def runs(walked: Trajectory, table: FrameTable, frames: Ints) -> Iterator[list[int]]:
    """Those of the frames (n,) that were walked, pass by pass."""
    here = np.intersect1d(walked.frames, frames)
    for name in dict.fromkeys(table.passes):
        yield np.intersect1d(here, table.of_pass(name)).tolist()


def shares(walked: Trajectory, table: FrameTable, frames: Ints) -> Iterator[tuple[tuple[int, int, int], Floats]]:
    """Three frames each, and where the second of them lies between the others (`share_between`): neighbours, and ever
    further ones, for the scale of a path that only neighbours hold runs away."""
    poses = dict(zip(walked.frames.tolist(), walked.world_from_rig, strict=True))
    for numbers in runs(walked, table, frames):
        step = 1
        while 2 * step < len(numbers):
            for first in range(0, len(numbers) - 2 * step, step):
                three = numbers[first], numbers[first + step], numbers[first + 2 * step]
                if (share := share_between(np.stack([poses[frame] for frame in three]))) is not None:
                    yield three, share
            step *= 2


def share_between(poses: Floats) -> Floats | None:
    """What (3, 3) makes, of the way from the first of three poses (3, 4, 4) to the last, that to the second, in the
    first rig's axes; None where they are no way apart."""
    ways = (poses[1:, :3, 3] - poses[0, :3, 3]) @ poses[0, :3, :3]
    near, far = ways
    travelled = float(np.linalg.norm(near) + np.linalg.norm(far - near))
    length = float(np.linalg.norm(far))
    if length < LEAST_SHARE * travelled or travelled == 0.0:
        return None
    along = far / length
    across = near - (near @ along) * along
    return np.asarray(
        (near @ along) / length * np.eye(3) + (np.outer(across, along) - np.outer(along, across)) / length
    )


def place_factor(keys: list[int], share: Floats) -> gtsam.CustomFactor:
    """That the second of three poses lies between the first and the last as `share` (3, 3) says; its errors are shares
    of how far these are apart."""

    def error(_: object, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        first, second, last = (values.atPose3(key) for key in keys)
        axes = first.rotation().matrix().T
        near, far = (axes @ (pose.translation() - first.translation()) for pose in (second, last))
        scale = 1 / max(float(np.linalg.norm(far)), 1e-6)
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(scale * np.hstack([skew(near) - share @ skew(far), share - np.eye(3)]))
            jacobians[1] = np.asfortranarray(scale * np.hstack([np.zeros((3, 3)), axes @ second.rotation().matrix()]))
            turned = -share @ axes @ last.rotation().matrix()
            jacobians[2] = np.asfortranarray(scale * np.hstack([np.zeros((3, 3)), turned]))
        return np.asarray(scale * (near - share @ far))

    noise = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Huber.Create(1.345), gtsam.noiseModel.Isotropic.Sigma(3, PLACE_SIGMA)
    )
    return gtsam.CustomFactor(noise, keys, error)
