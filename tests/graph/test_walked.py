"""The form of a walked path as factors: in any scale and anywhere, and only where frames differ."""

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.graph.factors.checks import check_jacobians
from savmap.graph.factors.walked import share_between, walked_constraints
from savmap.graph.keys import frame_key
from savmap.types import Trajectory


def walk(count: int = 6) -> Trajectory:
    """A path that sways and turns."""
    rng, poses = np.random.default_rng(1), np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(0.1 * rng.normal(size=(count, 3))).as_matrix()
    poses[:, :3, 3] = np.column_stack([0.4 * np.arange(count), *(0.05 * rng.normal(size=(2, count)))])
    return Trajectory(2 * np.arange(count), poses)


def moved(path: Trajectory, scale: float) -> Trajectory:
    """The same path in another frame and scale."""
    turn = Rotation.from_euler("xyz", [0.3, -1.2, 2.0]).as_matrix()
    poses = path.world_from_rig.copy()
    poses[:, :3, :3] = turn @ poses[:, :3, :3]
    poses[:, :3, 3] = scale * poses[:, :3, 3] @ turn.T + [3.0, -1.0, 7.0]
    return Trajectory(path.frames, poses)


def error(path: Trajectory, at: Trajectory) -> float:
    values = gtsam.Values()
    for frame, pose in zip(at.frames.tolist(), at.world_from_rig, strict=True):
        values.insert(frame_key(frame), gtsam.Pose3(pose))
    graph = walked_constraints(path, path.frames).factors
    assert graph is not None
    return float(graph.error(values))


@pytest.mark.parametrize("scale", [0.2, 1.0, 40.0])
def test_a_path_fits_itself_in_any_scale_and_anywhere(scale: float) -> None:
    assert error(walk(), moved(walk(), scale)) < 1e-3


def test_a_frame_that_is_off_does_not_fit() -> None:
    path = walk()
    off = path.world_from_rig.copy()
    off[3, :3, 3] += [0.02, 0.0, 0.0]
    assert error(path, Trajectory(path.frames, off)) > 1.0
    turned = path.world_from_rig.copy()
    turned[3, :3, :3] = turned[3, :3, :3] @ Rotation.from_rotvec([0.0, 0.01, 0.0]).as_matrix()
    assert error(path, Trajectory(path.frames, turned)) > 1.0


def test_jacobians_are_the_derivatives() -> None:
    path = walk()
    assert check_jacobians(walked_constraints(path, path.frames), moved(path, 2.0)) == []


def test_only_frames_that_are_solved_for_are_bound() -> None:
    path = walk()
    graph = walked_constraints(path, np.array([0, 4, 6, 10])).factors
    assert graph is not None
    keys = {key for number in range(graph.size()) for key in list(graph.at(number).keys())}
    assert keys == {frame_key(frame) for frame in (0, 4, 6, 10)}
    assert graph.size() == 3 + 2


def test_a_turn_on_the_spot_tells_no_place() -> None:
    poses = walk(3).world_from_rig.copy()
    poses[:, :3, 3] = [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.05, 0.0, 0.0]]
    assert share_between(poses) is None
    poses[:, :3, 3] = 0.0
    assert share_between(poses) is None
