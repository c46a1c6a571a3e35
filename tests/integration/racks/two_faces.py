"""Two faces of an aisle seen on one drive: row A on the camera's left, row B on its right, nearly parallel."""

from dataclasses import replace

import made_up_rack as made
import numpy as np
from scipy.spatial.transform import Rotation

from savmap.graph import CameraHeight, Problem
from savmap.types import Floats, ViewSpec

BACK = ViewSpec("back", 180.0, 0.0, 0.0, 150.0)
AISLE_M = 3.0


def faces(seed: int, sections: int = 3, frames: int = 30) -> tuple[made.World, made.World]:
    """Row A, and a rack of its own across the aisle, seen from the same poses of the rig. No bay is a bridge, whose beams' heights
    would give the scale."""
    a = made.world(seed, sections=sections, frames=frames, bridge=None)
    rng = np.random.default_rng(1000 + seed)
    truth = made.rack(rng, sections, bridge=None)
    poses = b_from_a(float(truth.uprights[-1, 1])) @ a.poses
    return a, made.seen_from(truth, poses, rng, view=BACK, name="B")


def b_from_a(length_m: float) -> Floats:
    """From row A's frame to row B's, whose first upright stands across from A's last: half a degree off parallel."""
    moved = np.eye(4)
    moved[:3, :3] = Rotation.from_euler("yxz", [180.5, 0.2, 0.1], degrees=True).as_matrix()
    moved[:3, 3] = length_m, 0.01, AISLE_M
    return moved


def problems(
    a: made.World,
    b: made.World,
    rng: np.random.Generator | None = None,
    off_m: float = 0.0,
    camera_of_a: bool = True,
) -> tuple[Problem, Problem]:
    """A knows its length and the camera's height, B that height alone; both the heights of their lowest beams. With `rng`
    references are off by their sigmas; A's length by `off_m` besides. Without `camera_of_a` only B knows the camera's height."""
    of_a = made.references(a, rng=rng)
    height = of_a.camera_heights[0].value_m
    length = replace(of_a.lengths[0], value_m=of_a.lengths[0].value_m + off_m)
    start_a, start_b = made.begin(a), made.begin(b)
    of_b = replace(of_a, camera_heights=(CameraHeight(height, 0.02),), lengths=())
    of_a = replace(of_a, lengths=(length,), camera_heights=of_a.camera_heights if camera_of_a else ())
    return made.problem(a, start_a, of_a), made.problem(b, start_b, of_b)
