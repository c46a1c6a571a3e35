"""What lies in a plane, and what is seen through it: the rear of a structure, as level as its front."""

import numpy as np
import pytest

from savmap.types import Floats, PlanePatch, Trajectory
from savmap.vision.evidence import inner_part, lies_behind

from .test_flat_depth import LENGTH_M, SPEC, TALL, XS, packed_views_of, poses_before

CAMERA_M, AWAY_M = 1.1, 2.0
FACE = PlanePatch("face", np.array([-1.0, 0.0, 0.0]), *np.eye(3)[:2], np.array([7.0, 3.0]), 0.02)
OTHER = PlanePatch("other", np.array([-1.0, 0.0, 0.5]), *np.eye(3)[:2], np.array([7.0, 3.0]), 0.02)
BEHIND = PlanePatch("behind", np.array([-1.0, 0.0, -1.0]), *np.eye(3)[:2], np.array([7.0, 3.0]), 0.02)
PATH = Trajectory(np.arange(len(XS)), poses_before(AWAY_M))


def outline_of(height: float, z: float, shown_m: float = LENGTH_M) -> Floats:
    """Where a band at a height and depth appears on the face z = 0."""
    nearer = AWAY_M / (AWAY_M - z)
    low, high = (CAMERA_M + nearer * (y - CAMERA_M) for y in (height, height + TALL))
    return np.array([[0.2, low, 0.0], [shown_m - 0.2, low, 0.0], [shown_m - 0.2, high, 0.0], [0.2, high, 0.0]])


def seen_through(height: float, z: float, noise: float = 1.0, shown: bool = True, scale: float = 1.0) -> bool:
    """Whether a band at a height and depth is found to lie behind the face, by frames from 2 m before the face."""
    packed_views = packed_views_of({height: z} if shown else {}, np.random.default_rng(7), noise)
    part = inner_part(scale * outline_of(height, z), [FACE])
    assert part is not None
    scaled = PATH.world_from_rig.copy()
    scaled[:, :3, 3] *= scale
    return lies_behind(part, packed_views, {"face": SPEC}, Trajectory(PATH.frames, scaled))


@pytest.mark.parametrize("height", [0.6, 1.6])
@pytest.mark.parametrize("z", [-0.7, -1.2, -2.0])
def test_what_is_seen_through_the_plane_lies_behind(height: float, z: float) -> None:
    assert seen_through(height, z)


@pytest.mark.parametrize("z", [0.05, 0.0, -0.05])
def test_what_lies_in_the_plane_does_not_lie_behind(z: float) -> None:
    assert not seen_through(1.6, z)


def test_the_unit_of_the_path_does_not_matter() -> None:
    assert seen_through(1.6, -1.2, scale=3.0)


def test_what_shows_nothing_tells_nothing() -> None:
    assert not seen_through(1.6, -1.2, noise=3.0, shown=False)


def test_too_few_frames_tell_nothing() -> None:
    part = inner_part(outline_of(1.6, -1.2), [FACE])
    assert part is not None
    assert not lies_behind(part, [], {"face": SPEC}, PATH)
    assert not lies_behind(part, packed_views_of({1.6: -1.2}, np.random.default_rng(7))[9:12], {"face": SPEC}, PATH)


def test_the_inside_of_an_outline_is_on_its_plane_away_from_its_ends() -> None:
    outline = outline_of(1.6, 0.0)
    part = inner_part(outline, [OTHER, FACE, BEHIND])
    assert part is not None
    assert part.origin == pytest.approx([0.2 + TALL, 1.6 + 0.12 * TALL, 0.0])
    assert part.size == pytest.approx([LENGTH_M - 0.4 - 2 * TALL, 0.76 * TALL])
    assert inner_part(outline, []) is None
    assert inner_part(outline[:, [1, 0, 2]], [FACE]) is None


def test_a_part_of_few_cells_tells_nothing() -> None:
    part = inner_part(outline_of(1.6, 0.0, shown_m=0.41 + 5.0 * TALL), [FACE])
    assert part is not None
    packed_views = packed_views_of({1.6: 0.0}, np.random.default_rng(7))
    assert not lies_behind(part, packed_views, {"face": SPEC}, PATH)
