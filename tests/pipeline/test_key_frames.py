"""Key frames: one for every share of the distance from the face, as far as the path is known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.pipeline.key_frames import FRONT, LEAST_POINTS, PARALLAX_RAD, SHARE, KeyFrames, front
from savmap.types import Floats
from savmap.vision.odometry import WIDTH, Followed

AHEAD, BACK = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
"""In the rig frame, z forward."""
STEP = 0.07


def wall(z: float, along: tuple[float, float] = (-4.0, 24.0)) -> Floats:
    """Points (n, 3) all over an upright wall."""
    x, y = np.meshgrid(np.arange(*along, 0.5), np.arange(-1.5, 1.6, 0.5))
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1)


def followed(angle: float = 0.0, count: int = 30) -> Followed:
    """Points around the horizon, all moved by an angle, radians."""
    x = (np.arange(count) * WIDTH / count + angle / (2 * np.pi) * WIDTH) % WIDTH
    return Followed(np.arange(count), np.stack([x, np.full(count, WIDTH / 4)], axis=1).astype(np.float32))


def odometry(x: float | None, places: Floats, part: int = 0, turn: float = 0.0) -> Any:
    """What is known of a frame's pose at x along the wall, turned to the right by an angle, radians; None: nothing."""
    if x is None:
        return SimpleNamespace(pose=None, part=-1, places=places[:0])
    pose = np.eye(4)
    pose[:3, :3], pose[0, 3] = Rotation.from_euler("y", turn).as_matrix(), x
    return SimpleNamespace(pose=pose, part=part, places=places)


def key_places(places: Floats, *towards: Floats, frames: int = 200) -> Floats:
    """Where the key frames of a drive along x are."""
    keys = KeyFrames()
    keys.towards = towards
    x = STEP * np.arange(frames)
    return np.asarray(x[[keys.is_key(followed(), odometry(at, places)) for at in x.tolist()]])


@pytest.mark.parametrize("distance", [1.0, 2.0, 4.0])
def test_a_key_frame_comes_every_share_of_the_distance(distance: float) -> None:
    """What lies behind the camera does not count."""
    places = key_places(np.vstack([wall(distance), wall(-0.4)]), AHEAD)
    assert places[0] == 0.0
    assert len(places) > 5
    gaps = np.diff(places)
    assert (gaps > SHARE * distance).all()
    assert (gaps < SHARE * distance + 1.001 * STEP).all()


def test_the_nearer_of_two_faces_counts() -> None:
    both = np.vstack([wall(3.0), wall(-1.0)])
    assert np.array_equal(key_places(both, AHEAD, BACK), key_places(both, BACK))
    assert np.array_equal(key_places(both, BACK, AHEAD), key_places(both, BACK))
    assert len(key_places(both, AHEAD)) < len(key_places(both, BACK)) / 2


def test_a_camera_that_stands_or_turns_has_one_key_frame() -> None:
    """It trembles by a centimetre, while all points go by."""
    keys, rng = KeyFrames(), np.random.default_rng(1)
    keys.towards = (AHEAD,)
    standing = [
        keys.is_key(followed(0.05 * frame), odometry(float(rng.normal(0, 0.01)), wall(2.0), turn=0.02 * frame))
        for frame in range(100)
    ]
    assert standing == [True] + [False] * 99


def test_parallax_decides_where_the_path_is_not_known() -> None:
    keys = KeyFrames()
    step = 0.4 * PARALLAX_RAD
    chosen = [keys.is_key(followed(step * frame), odometry(None, wall(2.0))) for frame in range(10)]
    assert np.flatnonzero(chosen).tolist() == [0, 3, 6, 9]
    assert not any(keys.is_key(followed(step * 9), odometry(None, wall(2.0))) for _ in range(20))


def test_parallax_decides_from_one_part_of_the_path_to_the_next() -> None:
    """Their scales differ; and where too few points are known, the distance is not."""
    keys = KeyFrames()
    keys.towards = (AHEAD,)
    assert keys.is_key(followed(), odometry(0.0, wall(2.0)))
    assert not keys.is_key(followed(), odometry(9.0, wall(2.0), part=1))
    assert not keys.is_key(followed(), odometry(9.0, wall(2.0)[: LEAST_POINTS - 1]))
    assert keys.is_key(followed(1.1 * PARALLAX_RAD), odometry(9.0, wall(2.0), part=1))
    assert not keys.is_key(followed(), odometry(9.0 + 0.9 * SHARE * 2.0, wall(2.0), part=1))
    assert keys.is_key(followed(), odometry(9.0 + 1.1 * SHARE * 2.0, wall(2.0), part=1))


def test_a_frame_to_which_nothing_could_be_followed_is_one() -> None:
    keys = KeyFrames()
    assert keys.is_key(followed(), odometry(None, wall(2.0)))
    assert keys.is_key(followed(count=LEAST_POINTS - 1), odometry(None, wall(2.0)))
    assert keys.is_key(Followed(np.arange(30) + 100, followed().pixels), odometry(None, wall(2.0)))


def test_a_face_is_where_a_share_of_the_points_is_nearer() -> None:
    """Some things stand before it, and what lies aside of its direction is of something else."""
    face, before = wall(2.0, (-1.0, 1.1)), wall(0.7, (-0.2, 0.2))[2:4]
    assert front(np.vstack([face, before]), (AHEAD,)) == 2.0
    assert front(np.vstack([face, wall(0.3)[::4] + np.array([9.0, 0.0, 0.0])]), (AHEAD,)) == 2.0
    assert front(face, (BACK,)) == pytest.approx(np.quantile(np.linalg.norm(face, axis=1), FRONT))
    assert front(np.zeros((0, 3)), (AHEAD,)) == 0.0


def test_where_no_face_is_known_a_share_of_all_points_counts() -> None:
    around = np.vstack([wall(1.0, (-1.0, 1.1)), *[wall(8.0, (-1.0, 1.1))] * 2])
    assert front(around, ()) == pytest.approx(np.quantile(np.linalg.norm(around, axis=1), FRONT))
    assert 1.0 < front(around, ()) < 2.0
    keys = KeyFrames()
    x = STEP * np.arange(20)
    chosen = [keys.is_key(followed(), odometry(at, around + np.array([at, 0.0, 0.0]))) for at in x.tolist()]
    assert (np.diff(x[chosen]) > SHARE * front(around, ())).all()
    assert sum(chosen) >= 3
