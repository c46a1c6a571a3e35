"""The form of a walked path as factors: in any scale and anywhere, and only where frames differ."""

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.graph.factors.checks import check_jacobians
from savmap.graph.factors.walked import share_between, shares, walked_constraints
from savmap.graph.keys import frame_key
from savmap.types import FrameTable, Ints, Trajectory


def walk(count: int = 6) -> Trajectory:
    """A path that sways and turns."""
    rng, poses = np.random.default_rng(1), np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(0.1 * rng.normal(size=(count, 3))).as_matrix()
    poses[:, :3, 3] = np.column_stack([0.4 * np.arange(count), *(0.05 * rng.normal(size=(2, count)))])
    return Trajectory(2 * np.arange(count), poses)


def table(path: Trajectory, second_from: int | None = None) -> FrameTable:
    """The frames of one pass, or of two."""
    count = int(path.frames.max()) + 1
    names = ["pass 1" if second_from is None or k < second_from else "pass 2" for k in range(count)]
    return FrameTable(0.1 * np.arange(count), tuple(names))


def graph_of(path: Trajectory, frames: Ints | None = None) -> gtsam.NonlinearFactorGraph:
    graph = walked_constraints(path, table(path), path.frames if frames is None else frames).factors
    assert graph is not None
    return graph


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
    return float(graph_of(path).error(values))


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


def test_a_scale_that_runs_away_slowly_does_not_fit() -> None:
    path = walk(33)
    steps = np.diff(path.world_from_rig[:, :3, 3], axis=0) * np.linspace(0.95, 1.05, 32)[:, None]
    poses = path.world_from_rig.copy()
    poses[1:, :3, 3] = poses[0, :3, 3] + np.cumsum(steps, axis=0)
    neighbours = [three for three, _ in shares(path, table(path), path.frames) if three[2] - three[0] == 4]
    assert len(neighbours) == 31
    assert error(path, Trajectory(path.frames, poses)) > 20.0


def test_jacobians_are_the_derivatives() -> None:
    path = walk()
    assert check_jacobians(walked_constraints(path, table(path), path.frames), moved(path, 2.0)) == []


def test_only_frames_that_are_solved_for_are_bound() -> None:
    graph = graph_of(walk(), np.array([0, 4, 6, 10]))
    keys = {key for number in range(graph.size()) for key in list(graph.at(number).keys())}
    assert keys == {frame_key(frame) for frame in (0, 4, 6, 10)}
    assert graph.size() == 3 + 2


def test_passes_are_not_bound_to_one_another() -> None:
    path = walk()
    graph = walked_constraints(path, table(path, 6), path.frames).factors
    assert graph is not None
    assert graph.size() == 2 * (2 + 1)


def test_a_turn_on_the_spot_tells_no_place() -> None:
    poses = walk(3).world_from_rig.copy()
    poses[:, :3, 3] = [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.05, 0.0, 0.0]]
    assert share_between(poses) is None
    poses[:, :3, 3] = 0.0
    assert share_between(poses) is None
