"""Points are followed across the seam; by their rays a drive's path comes out whole, whatever moves by itself."""

from collections.abc import Callable, Iterable, Sequence

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.files.serialization import packed, unpacked
from savmap.geometry.sphere import panorama_pixels_from_rays
from savmap.types import Panorama
from savmap.vision.odometry import WIDTH, Followed, Follower, Odometry, WalkedPath

STEP = 0.2
NOISE_PX = 0.1
SPEED_PX = 9
"""Of a panorama that is turned, a frame."""


def poses(steps: Iterable[tuple[float, float]], rng: np.random.Generator) -> np.ndarray:
    """Poses (n, 4, 4) of a rig that goes on by so much and then turns by so many degrees, step by step, and sways."""
    found, place, heading = [], np.zeros(3), 0.0
    for ahead, turn in [(0.0, 0.0), *steps]:
        place = place + ahead * np.array([np.sin(np.radians(heading)), 0.0, np.cos(np.radians(heading))])
        heading += turn
        pose = np.eye(4)
        sway = Rotation.from_rotvec(np.radians(rng.normal(0, 0.5, 3)))
        pose[:3, :3] = (Rotation.from_euler("y", heading, degrees=True) * sway).as_matrix()
        pose[:3, 3] = place
        found.append(pose)
    return np.array(found)


def straight(count: int, rng: np.random.Generator) -> np.ndarray:
    """Poses (count, 4, 4) along a line."""
    return poses([(STEP, 0.0)] * (count - 1), rng)


def around(path: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Points (count, 3) 1.5 to 6 m off a path."""
    places = path[rng.integers(0, len(path), count), :3, 3]
    away = rng.normal(size=(count, 3))
    return np.asarray(places + away / np.linalg.norm(away, axis=1, keepdims=True) * rng.uniform(1.5, 6, (count, 1)))


def followed(
    numbers: np.ndarray, points: np.ndarray, pose: np.ndarray, rng: np.random.Generator, noise_px: float = NOISE_PX
) -> Followed:
    """These points (n, 3) as they are seen from a pose."""
    pixels = panorama_pixels_from_rays((points - pose[:3, 3]) @ pose[:3, :3], WIDTH // 2)
    return Followed(numbers, (pixels + noise_px * rng.normal(size=pixels.shape)).astype(np.float32))


def both(a: Followed, b: Followed) -> Followed:
    """The points of both; those of the second have the higher numbers."""
    return Followed(np.append(a.numbers, b.numbers), np.vstack([a.pixels, b.pixels]))


def drive(path: np.ndarray, rng: np.random.Generator, count: int = 1200, reach: float = 5.0) -> list[Followed]:
    """Points around a path, each followed while it is near."""
    points = around(path, count, rng)
    near = np.linalg.norm(points - path[:, None, :3, 3], axis=2) < reach
    return [followed(np.flatnonzero(seen), points[seen], pose, rng) for seen, pose in zip(near, path, strict=True)]


def walked(frames: Sequence[Followed], lost: set[int] | None = None) -> WalkedPath:
    """The path by these frames; what is given back is added to the `lost`, and followed no more."""
    odometry, lost = Odometry(), set() if lost is None else lost
    for frame in frames:
        kept = ~np.isin(frame.numbers, list(lost))
        lost |= set(odometry.take(Followed(frame.numbers[kept], frame.pixels[kept])).tolist())
    return odometry.path


def brought(places: np.ndarray, onto: np.ndarray) -> np.ndarray:
    """Places (n, 3) after the similarity that brings them nearest to others."""
    a, b = places - places.mean(axis=0), onto - onto.mean(axis=0)
    left, sizes, right = np.linalg.svd(b.T @ a)
    signs = np.array([1.0, 1.0, np.linalg.det(left @ right)])
    return np.asarray(onto.mean(axis=0) + (sizes @ signs) / np.square(a).sum() * a @ (left * signs @ right).T)


def assert_near(found: np.ndarray, true: np.ndarray, share: float = 0.003, degrees: float = 0.3) -> None:
    """Places are right to a share of the way after a similarity, and turns in the frame of the first."""
    places = true[:, :3, 3]
    error = np.linalg.norm(brought(found[:, :3, 3], places) - places, axis=1)
    assert error.max() < share * np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
    off = Rotation.from_matrix((true[0, :3, :3].T @ true[:, :3, :3]).transpose(0, 2, 1) @ found[:, :3, :3])
    assert np.degrees(off.magnitude()).max() < degrees


COURSES = {
    "ahead": [(STEP, 0.0)] * 30,
    "stands at first": [(0.0, 0.0)] * 6 + [(STEP, 0.0)] * 20,
    "stands amid": [(STEP, 0.0)] * 10 + [(0.0, 0.0)] * 6 + [(STEP, 0.0)] * 10,
    "turns by 90 degrees": [(STEP, 0.0)] * 10 + [(STEP / 2, 9.0)] * 10 + [(STEP, 0.0)] * 10,
    "turns in place": [(STEP, 0.0)] * 10 + [(0.0, 15.0)] * 6 + [(STEP, 0.0)] * 10,
    "goes back": [(STEP, 0.0)] * 14 + [(-STEP, 0.0)] * 14,
}


@pytest.mark.parametrize("course", COURSES)
def test_odometry_gives_the_path_up_to_a_similarity(course: str) -> None:
    rng = np.random.default_rng(3)
    true = poses(COURSES[course], rng)
    found = walked(drive(true, rng))
    assert found.part.tolist() == [0] * len(true)
    np.testing.assert_allclose(found.world_from_rig[0], np.eye(4))
    assert_near(found.world_from_rig, true)


def test_odometry_stands_where_the_camera_stands() -> None:
    rng = np.random.default_rng(4)
    true = poses(COURSES["stands at first"], rng)
    places = brought(walked(drive(true, rng)).world_from_rig[:, :3, 3], true[:, :3, 3])
    assert np.linalg.norm(places[:6] - places[0], axis=1).max() < 0.03 * STEP * 6


def test_odometry_does_not_know_a_path_before_there_is_one() -> None:
    rng = np.random.default_rng(5)
    odometry = Odometry()
    assert (odometry.pose, odometry.part, odometry.path.longest) == (None, -1, 0)
    assert odometry.path.world_from_rig.shape == (0, 4, 4)
    for frame in drive(poses([(0.0, 0.0)] * 4, rng), rng):
        assert not len(odometry.take(frame))
        assert (odometry.pose, odometry.part) == (None, -1)
    assert odometry.path.part.tolist() == [-1] * 5


def test_odometry_gives_back_points_that_move_by_themselves() -> None:
    rng = np.random.default_rng(6)
    true = straight(24, rng)
    points = around(true[12:13], 60, rng)
    passing = [points + np.array([0.12 * number, 0.0, 0.0]) for number in range(len(true))]
    frames = [
        both(still, followed(10_000 + np.arange(60), moving, pose, rng))
        for still, moving, pose in zip(drive(true, rng), passing, true, strict=True)
    ]
    lost = set[int]()
    found = walked(frames, lost)
    assert_near(found.world_from_rig, true)
    still = {number for frame in frames for number in frame.numbers.tolist() if number < 10_000}
    assert sum(number >= 10_000 for number in lost) > 50
    assert sum(number < 10_000 for number in lost) < 0.05 * len(still)


def test_odometry_is_not_disturbed_by_what_moves_with_the_rig() -> None:
    rng = np.random.default_rng(7)
    true, lost = straight(24, rng), set[int]()
    rig = around(np.eye(4)[None], 40, rng)
    frames = [
        both(frame, followed(10_000 + np.arange(40), rig, np.eye(4), rng)) for frame in drive(true, rng, count=400)
    ]
    found = walked(frames, lost)
    assert found.part.tolist() == [0] * len(true)
    assert_near(found.world_from_rig, true, degrees=0.5)
    assert sum(number < 10_000 for number in lost) < 10


def test_odometry_begins_a_new_part_after_a_gap() -> None:
    rng = np.random.default_rng(8)
    true = straight(30, rng)
    frames = drive(true, rng)
    first, second = frames[:12], [Followed(frame.numbers + 10_000, frame.pixels) for frame in frames[12:]]
    found = walked([*first, *second])
    assert found.part.tolist() == [0] * 12 + [1] * 18
    assert found.longest == 1
    np.testing.assert_array_equal(found.world_from_rig[:12], walked(first).world_from_rig)
    assert_near(found.world_from_rig[12:], true[12:])
    np.testing.assert_allclose(found.world_from_rig[12], np.eye(4))


def test_odometry_passes_over_frames_that_show_nothing() -> None:
    rng = np.random.default_rng(13)
    true = straight(24, rng)
    black = [1, 10, 11, 12, 20]
    frames = [
        frame if number not in black else Followed(frame.numbers[:0], frame.pixels[:0])
        for number, frame in enumerate(drive(true, rng))
    ]
    found, shown = walked(frames), np.setdiff1d(np.arange(len(true)), black)
    assert np.flatnonzero(found.part == 0).tolist() == shown.tolist()
    assert_near(found.world_from_rig[shown], true[shown])


def test_odometry_needs_no_frames_that_follow() -> None:
    rng = np.random.default_rng(9)
    frames = drive(straight(16, rng), rng)
    whole, begun = walked(frames), walked(frames[:9])
    np.testing.assert_array_equal(whole.world_from_rig[:9], begun.world_from_rig)
    np.testing.assert_array_equal(whole.variance[:9], begun.variance)


def test_odometry_tells_where_points_are() -> None:
    rng = np.random.default_rng(10)
    true = straight(16, rng)
    odometry, points = Odometry(), around(true, 300, rng)
    for pose in true:
        odometry.take(followed(np.arange(300), points, pose, rng))
    scale = np.linalg.norm(true[-1, :3, 3] - true[0, :3, 3]) / np.linalg.norm(odometry.path.world_from_rig[-1, :3, 3])
    places = scale * odometry.places @ true[0, :3, :3].T + true[0, :3, 3]
    nearest = np.linalg.norm(places[:, None] - points, axis=2).min(axis=1)
    assert len(places) > 250
    assert np.median(nearest) < 0.02


def textured(rng: np.random.Generator) -> np.ndarray:
    """A panorama (WIDTH / 2, WIDTH, 3) without a seam, with corners all over."""
    rough = np.tile(rng.integers(0, 255, (WIDTH // 2, WIDTH)).astype(np.uint8), (1, 3))
    smooth = cv2.GaussianBlur(rough, (0, 0), 4.0)[:, WIDTH : 2 * WIDTH].astype(float)
    grey = np.clip(128 + 5 * (smooth - smooth.mean()), 0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def turning(count: int, change: Callable[[np.ndarray, int], None] = lambda image, number: None) -> list[Panorama]:
    """Panoramas of a camera that turns to the right, some of them changed."""
    image, shown = textured(np.random.default_rng(11)), []
    for number in range(count):
        turned = np.roll(image, -SPEED_PX * number, axis=1)
        change(turned, number)
        shown.append(Panorama(number, number / 15, turned))
    return shown


def test_follower_follows_points_across_the_seam() -> None:
    follower, count = Follower(), 9
    frames = [follower.update(panorama) for panorama in turning(count)]
    first, last = frames[0], frames[-1]
    shared, a, b = np.intersect1d(first.numbers, last.numbers, return_indices=True)
    moved = last.pixels[b] - first.pixels[a] + [SPEED_PX * (count - 1), 0]
    moved[:, 0] = (moved[:, 0] + WIDTH / 2) % WIDTH - WIDTH / 2
    assert len(first.numbers) > 200
    assert len(shared) > 0.8 * len(first.numbers)
    assert np.quantile(np.linalg.norm(moved, axis=1), 0.98) < 0.2
    crossed = first.pixels[a][:, 0] < SPEED_PX * (count - 1)
    assert crossed.sum() > 10, "points that crossed the seam"
    for frame in frames:
        assert (np.diff(frame.numbers) > 0).all()
        assert ((frame.pixels >= [-0.5, 0]) & (frame.pixels <= [WIDTH, WIDTH / 2])).all()
    np.testing.assert_allclose(np.linalg.norm(last.rays, axis=1), 1.0)


def test_follower_begins_new_points_for_those_it_lost() -> None:
    def flat(image: np.ndarray, number: int) -> None:
        if number == 1:
            image[:, 300:700] = 128

    follower = Follower()
    whole, covered, shown = (follower.update(panorama) for panorama in turning(3, flat))
    inside = {
        int(number) for number, (x, _) in zip(whole.numbers, whole.pixels, strict=True) if 340 < x + SPEED_PX < 660
    }
    assert inside
    assert not inside & set(covered.numbers.tolist())
    assert not inside & set(shown.numbers.tolist())
    assert (shown.numbers > whole.numbers.max()).sum() > 0.7 * len(inside)


def test_follower_passes_over_black_frames() -> None:
    def black(image: np.ndarray, number: int) -> None:
        if number in {2, 3}:
            image[:] = 0

    follower = Follower()
    frames = [follower.update(panorama) for panorama in turning(6, black)]
    assert [len(frame.numbers) > 200 for frame in frames] == [True, True, False, False, True, True]
    assert np.isin(frames[1].numbers, frames[4].numbers).mean() > 0.7


def test_follower_begins_anew_where_nothing_goes_on() -> None:
    def other(image: np.ndarray, number: int) -> None:
        if number >= 2:
            image[:] = image[::-1]

    follower = Follower()
    frames = [follower.update(panorama) for panorama in turning(8, other)]
    assert [len(frame.numbers) > 200 for frame in frames] == [True, True, False, False, False, True, True, True]
    assert np.isin(frames[1].numbers, frames[5].numbers).mean() < 0.05


def test_follower_forgets_points() -> None:
    follower = Follower()
    first, second = turning(2)
    numbers = follower.update(first).numbers
    follower.forget(numbers[::2])
    after = follower.update(second).numbers
    assert not np.isin(numbers[::2], after).any()
    assert np.isin(numbers[1::2], after).mean() > 0.9


def test_follower_looks_closer_where_little_is_seen() -> None:
    """In what a narrow camera sees, and not at its border; rays are those of the whole panorama."""
    mask = np.zeros((WIDTH, 2 * WIDTH), np.uint8)
    mask[400:624, 824:1224] = 255
    large = [cv2.resize(panorama.image, (2 * WIDTH, WIDTH), interpolation=cv2.INTER_CUBIC) for panorama in turning(5)]
    follower = Follower()
    frames = [follower.update(Panorama(number, number / 15, image, mask)) for number, image in enumerate(large)]
    first, last = frames[0], frames[-1]
    assert first.width == 2 * WIDTH
    x, y = first.pixels.T
    assert ((x > 824) & (x < 1223) & (y > 400) & (y < 623)).all()
    _, a, b = np.intersect1d(first.numbers, last.numbers, return_indices=True)
    assert len(a) > 50
    turn = Rotation.from_euler("y", 4 * SPEED_PX * 360 / WIDTH, degrees=True)
    off = np.linalg.norm(turn.apply(last.rays[b]) - first.rays[a], axis=1)
    assert np.quantile(off, 0.95) < 0.3 * first.pixel


def test_follower_goes_on_from_a_kept_frame_as_if_not_cut_off() -> None:
    panoramas, follower, frames = turning(8), Follower(), []
    for panorama in panoramas:
        frames.append(follower.update(panorama))
        follower.forget(frames[-1].numbers[-40:])
    begun = [int(frame.numbers.max()) + 1 for frame in frames]
    assert begun[3] < begun[0] < begun[-1], "the newest points are lost, and others begin later"
    kept = unpacked(packed(frames[3]), Followed)
    later = Follower()
    later.go_on(panoramas[3], kept, max(begun[:4]))
    later.forget(kept.numbers[-40:])
    for panorama, frame in zip(panoramas[4:], frames[4:], strict=True):
        again = later.update(panorama)
        np.testing.assert_array_equal(again.numbers, frame.numbers)
        np.testing.assert_array_equal(again.pixels, frame.pixels)
        later.forget(again.numbers[-40:])


def test_followed_points_and_paths_are_stored_to_the_last_bit() -> None:
    rng = np.random.default_rng(12)
    frames = drive(straight(6, rng), rng)
    after = unpacked(packed(frames[0]), Followed)
    np.testing.assert_array_equal(after.numbers, frames[0].numbers)
    np.testing.assert_array_equal(after.pixels, frames[0].pixels)
    assert after.pixels.dtype == np.float32
    assert packed(after) == packed(frames[0])
    path = walked(frames)
    again = unpacked(packed(path), WalkedPath)
    for name in ("world_from_rig", "part", "variance"):
        np.testing.assert_array_equal(getattr(again, name), getattr(path, name))
