"""The model's errors and slopes."""

import gtsam
import made_up as made
import numpy as np
import pytest

from savmap.types import Floats
from savmap_pallets.outline import Camera, corners, errors, from_hull, with_slopes

POSE = np.array([2.7, -0.9, 0.6])


def test_corners_turn_counter_clockwise_as_seen_from_above() -> None:
    found = corners(np.array([1.0, -2.0, np.pi / 2]), np.array([1.2, 0.1, 0.8]))
    np.testing.assert_allclose(found[0], [1.4, 0.0, 2.6], atol=1e-12)
    np.testing.assert_allclose(found[4:, 1], 0.1)


def test_distances_from_a_square() -> None:
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [2.0, 2.0]])
    distances, slopes = from_hull(np.array([[1.0, -3.0], [1.0, 1.5], [4.0, 2.0]]), square)
    np.testing.assert_allclose(distances, [3.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(slopes[0, :2], [[0.0, 0.75], [0.0, 0.25]], atol=1e-12)


def test_slopes_are_those_of_the_errors() -> None:
    pose, frame = made.PALLETS[1], made.path().world_from_rig[5]
    pixels = made.pixels(pose, frame)[[0, 1, 5, 6, 7]] + np.array([3.0, 2.0])
    _, by_frame, by_pallet = with_slopes(pixels, pose, made.SIZE, Camera(frame, made.spec()))

    def moved_pallet(step: Floats) -> Floats:
        moved = gtsam.Pose2(*pose.tolist()).retract(step)
        return errors(pixels, np.array([moved.x(), moved.y(), moved.theta()]), made.SIZE, Camera(frame, made.spec()))

    def moved_frame(step: Floats) -> Floats:
        return errors(pixels, pose, made.SIZE, Camera(gtsam.Pose3(frame).retract(step).matrix(), made.spec()))

    for slopes, moved, count in ((by_pallet, moved_pallet, 3), (by_frame, moved_frame, 6)):
        steps = 1e-6 * np.eye(count)
        numeric = np.stack([(moved(step) - moved(-step)) / 2e-6 for step in steps], axis=1)
        np.testing.assert_allclose(slopes, numeric, rtol=1e-4, atol=1e-3)


def test_a_pallet_behind_the_camera_has_no_error() -> None:
    behind = np.array([POSE[0], -12.0, 0.0])
    off, by_frame, by_pallet = with_slopes(
        np.zeros((2, 2)), behind, made.SIZE, Camera(made.path().world_from_rig[5], made.spec())
    )
    assert np.isnan(off).all()
    assert not by_frame.any()
    assert not by_pallet.any()
    assert errors(
        np.zeros((2, 2)), POSE, made.SIZE, Camera(made.path().world_from_rig[5], made.spec())
    ) == pytest.approx(
        with_slopes(np.zeros((2, 2)), POSE, made.SIZE, Camera(made.path().world_from_rig[5], made.spec()))[0]
    )
