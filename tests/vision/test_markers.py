"""Markers in drawn panoramas: found all around, followed past the camera, to a fraction of a pixel and without bias."""

import cv2
import numpy as np
import pytest

from savmap.errors import SiteError
from savmap.geometry import pinhole
from savmap.vision.markers import SEARCH_EVERY, MarkerTracker, MarkerTracks

from .marked import marked, pattern

TAG = pattern(cv2.aruco.DICT_APRILTAG_36h11, 7)
SQUARE = 0.1 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
HEIGHT = 1024


def corners_at(frame: int, yaw_deg: float, pitch_deg: float) -> np.ndarray:
    """Corners (4, 3) of a marker that stands askew 1.5 m to the right of a camera which goes ahead 6 cm a frame."""
    place = pinhole.rig_from_view(yaw_deg, pitch_deg, 0)
    return place @ np.array([0.06 * (8 - frame), 0, 1.5]) + SQUARE @ (place @ pinhole.rig_from_view(20, 10, 8)).T


def seen(yaw_deg: float, pitch_deg: float, frames: int = 17) -> tuple[MarkerTracks, np.ndarray]:
    """What is seen of the marker, and where its corners truly are in the rig frame (frames, 4, 3)."""
    rng = np.random.default_rng(5)
    truth = np.array([corners_at(frame, yaw_deg, pitch_deg) for frame in range(frames)])
    tracker = MarkerTracker([("tag36h11", 7), ("tag36h11", 8), ("5x5_100", 7)])
    for frame, corners in enumerate(truth):
        tracker.update(marked(frame, HEIGHT, corners, TAG, rng))
    return tracker.marks, truth


@pytest.mark.slow
@pytest.mark.parametrize(("yaw_deg", "pitch_deg"), [(100.0, 0.0), (180.0, -45.0), (-30.0, 25.0)])
def test_corners_are_found_without_bias(yaw_deg: float, pitch_deg: float) -> None:
    marks, truth = seen(yaw_deg, pitch_deg)
    assert list(marks.tracks) == ["tag36h11 7"]
    tracks = marks.tracks["tag36h11 7"]
    assert [track.name for track in tracks] == [f"marker tag36h11 7 / corner {n}" for n in (1, 2, 3, 4)]
    assert all(track.frames.tolist() == list(range(17)) for track in tracks)
    rays = np.array(
        [
            [marks.views[view].rig_rays(pixel) for view, pixel in zip(track.views, track.pixels, strict=True)]
            for track in tracks
        ]
    ).swapaxes(0, 1)
    unit = truth / np.linalg.norm(truth, axis=-1, keepdims=True)
    off_px = np.linalg.norm(rays - unit, axis=-1) * HEIGHT / np.pi
    assert np.sqrt(np.mean(off_px**2)) < 0.15
    sides, true_sides = (np.linalg.norm(each - np.roll(each, 1, axis=1), axis=-1) for each in (rays, unit))
    assert abs(np.mean(sides / true_sides) - 1) < 0.002


def test_sigma_is_that_of_the_panorama() -> None:
    marks, _ = seen(100.0, 0.0, frames=1)
    track = marks.tracks["tag36h11 7"][0]
    spec = marks.views[track.views[0]]
    sigma_rad = np.sqrt(track.covariances[0, 0, 0]) / spec.camera[0, 0]
    assert sigma_rad * HEIGHT / np.pi == pytest.approx(0.3)


def test_soft_borders_in_a_fine_panorama_are_measured() -> None:
    """Eight pixels wide, as a lens or a codec leaves them in pictures of 7680 pixels."""
    corners = corners_at(8, 100.0, 0.0)
    tracker = MarkerTracker([("tag36h11", 7)])
    tracker.update(marked(0, 3840, corners, TAG, np.random.default_rng(5), blur_px=4.0))
    marks = tracker.marks
    rays = np.array([marks.views[track.views[0]].rig_rays(track.pixels[0]) for track in marks.tracks["tag36h11 7"]])
    off = np.linalg.norm(rays - corners / np.linalg.norm(corners, axis=1, keepdims=True), axis=1)
    assert off.max() * 3840 / np.pi < 1.0


def test_one_that_comes_late_is_found_and_nothing_without_any() -> None:
    rng = np.random.default_rng(5)
    tracker, blind = MarkerTracker([("tag36h11", 7)]), MarkerTracker([])
    for frame in range(SEARCH_EVERY + 2):
        picture = marked(frame, HEIGHT, corners_at(8, 60.0, 0.0), TAG if frame > 1 else 0 * TAG, rng)
        tracker.update(picture)
        blind.update(picture)
    assert tracker.marks.tracks["tag36h11 7"][0].frames.tolist() == [SEARCH_EVERY, SEARCH_EVERY + 1]
    assert not blind.marks.tracks


def test_a_number_the_dictionary_lacks_is_refused() -> None:
    with pytest.raises(SiteError, match="tag16h5 has the numbers 0 to 29, not 30"):
        MarkerTracker([("tag16h5", 30)])
