"""What flat parts told of their depth, as relations of the solve."""

import numpy as np
import pytest

from savmap.graph import (
    Constraints,
    equal_coordinate,
    fixed_coordinate,
    image_measurements,
    measured_depths,
    with_depths,
)
from savmap.types import FlatDepth, Trajectory


def path_before(distance: float, frames: int = 6) -> Trajectory:
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 2, 3] = distance
    return Trajectory(np.arange(frames), poses)


def racks(known: float = -0.005, sigma: float = 0.01) -> Constraints:
    """Two beams in one plane, of which something is known by the first."""
    relations = (fixed_coordinate("z", 7, known, sigma), equal_coordinate("z", 7, 8))
    keys = {"beam 1": 7, "beam 2": 8}
    return Constraints("racks", keys, image_measurements([], {}, {}), relations, {name: np.zeros(3) for name in keys})


def depth(share: float, landmark: str = "beam 2") -> FlatDepth:
    return FlatDepth("racks", landmark, "z", share, 0.0003, np.arange(4), 30, 0.001, 0.001)


def test_a_depth_becomes_a_relation_in_metres() -> None:
    constraints = {"racks": racks()}
    told = list(measured_depths([depth(-0.009)], constraints, path_before(2.0)))
    (relation,) = set(with_depths(constraints, told)["racks"].relations) - set(racks().relations)
    assert (relation.axis, relation.a, relation.b, relation.name) == ("z", 8, None, "")
    assert relation.value == pytest.approx(-0.019)
    assert relation.sigma == pytest.approx(np.hypot(0.0006, 0.001))
    assert told[0].sections == 30


def test_only_the_frames_that_were_looked_at_count() -> None:
    path = path_before(2.0)
    poses = path.world_from_rig.copy()
    poses[4:, 2, 3] = 5.0
    (told,) = measured_depths([depth(-0.009)], {"racks": racks()}, Trajectory(path.frames, poses))
    assert told.relation.value == pytest.approx(-0.019)


def test_what_contradicts_the_plugin_is_left_out() -> None:
    constraints = {"racks": racks()}
    (told,) = measured_depths([depth(0.02)], constraints, path_before(2.0))
    assert not told.likely
    assert with_depths(constraints, [told])["racks"].relations == constraints["racks"].relations


def test_depths_of_what_is_not_there_are_left_out() -> None:
    constraints = {"racks": racks()}
    assert not list(measured_depths([depth(0.0, "beam 9")], constraints, path_before(2.0)))
    assert not list(measured_depths([depth(0.0)], {}, path_before(2.0)))
    later = Trajectory(np.arange(10, 16), path_before(2.0).world_from_rig)
    assert not list(measured_depths([depth(0.0)], constraints, later))
