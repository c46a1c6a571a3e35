"""Points and lines in the pictures of an ordinary lens."""

import cv2
import numpy as np

from savmap.types import Planes
from savmap.vision.lens_tracks import STEP, WIDTH, LensFollower, matched

HEIGHT = 640


def wall() -> np.ndarray:
    """A long picture of blurred patches and two posts."""
    rng = np.random.default_rng(3)
    picture = cv2.resize(rng.integers(40, 220, (HEIGHT // 8, 400)).astype(np.uint8), (3200, HEIGHT))
    picture[:, 700:760] = picture[:, 1500:1560] = 10
    return np.asarray(picture, np.uint8)


def pictures(shifts: list[int]) -> list[np.ndarray]:
    """What is seen of the wall from so many pixels on."""
    return [np.repeat(wall()[:, x : x + WIDTH, None], 3, axis=2) for x in shifts]


def followed(shifts: list[int]) -> LensFollower:
    follower = LensFollower()
    for number, picture in enumerate(pictures(shifts)):
        follower.update(number, picture)
    return follower


def test_points_are_followed_as_far_as_the_picture_shifts() -> None:
    tracks = followed([0, 70, 150, 220]).tracks
    assert tracks.frames.tolist() == [0, 1, 2, 3]
    first, last = (tracks.frame == 0), (tracks.frame == 3)
    shared, a, b = np.intersect1d(tracks.point[first], tracks.point[last], return_indices=True)
    assert len(shared) > 100
    moved = tracks.pixels[last][b] - tracks.pixels[first][a]
    np.testing.assert_allclose(np.median(moved, axis=0), [-220, 0], atol=0.1)


def test_a_picture_that_shows_the_same_is_passed_over() -> None:
    step = round(STEP * WIDTH)
    assert followed([0, step // 3, 2 * step // 3, step + 8]).tracks.frames.tolist() == [0, 3]


def test_a_jump_is_bridged_by_features() -> None:
    tracks = followed([0, 520]).tracks
    moved = [
        tracks.pixels[(tracks.frame == 1) & (tracks.point == number)][0, 0] - tracks.pixels[number, 0]
        for number in np.intersect1d(tracks.point[tracks.frame == 0], tracks.point[tracks.frame == 1]).tolist()
    ]
    assert len(moved) > 30
    assert abs(np.median(moved) + 520) < 0.5
    first, second = (cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in pictures([0, 400]))
    homography = matched(np.asarray(first, np.uint8), np.asarray(second, np.uint8))
    assert homography is not None
    np.testing.assert_allclose(homography[0, 2], -400, atol=2.0)


def test_pictures_that_are_not_alike_match_in_nothing() -> None:
    blank = np.zeros((HEIGHT, WIDTH), np.uint8)
    assert matched(blank, blank) is None


def test_lines_are_those_of_the_posts() -> None:
    (segments,) = followed([0]).tracks.segments
    upright = segments[np.abs(segments[:, 0] - segments[:, 2]) < 2]
    long = upright[np.abs(upright[:, 1] - upright[:, 3]) > 60]
    assert {700, 760} <= set(np.round(long[:, [0, 2]].mean(axis=1), -1).astype(int).tolist())


def test_luma_is_followed_as_grey_is() -> None:
    colour = np.full((HEIGHT // 2, WIDTH // 2), 128, np.uint8)
    follower = LensFollower()
    for number, x in enumerate((0, 80)):
        follower.update(number, Planes(wall()[:, x : x + WIDTH].copy(), colour, colour, np.eye(3, 4)))
    assert len(np.unique(follower.tracks.point[follower.tracks.frame == 1])) > 200
