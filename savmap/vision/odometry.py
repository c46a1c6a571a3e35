"""The path of a drive, up to scale, from points that are followed over the whole panorama: no network, no structure.

Corners (Shi and Tomasi 1994) are followed from frame to frame, there and back (Lucas and Kanade 1981; Bouguet 2000), in
a small grey panorama. The first two frames that are apart give a scale. From then on each frame is placed by the points
that are known, robustly, and its rays tell more of where these are: a point is where all of its rays so far come
nearest. What moves by itself, or was taken for its neighbour, does not fit and is left; what moves with the rig never
shows parallax. Each frame costs the same, and needs none of those that follow.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, reduce

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry import pinhole
from savmap.geometry.motion import AGREES, resected, two_views
from savmap.geometry.sphere import rays_from_panorama_pixels
from savmap.types import Bools, FilmedPanorama, Floats, Flow, Ints, Panorama, ViewSpec, array_record

WIDTH, PAD, FINE = 1024, 96, 2
"""Of the panorama that points are followed in, and of what of its other end is shown at each end. A picture so many
times wider is thinned out before it is averaged."""
HIGHEST_DEG = 62.0
"""Of points that are followed: nearer to the poles a panorama is bent too much, and shows the rig."""
MOST_POINTS, ENOUGH, APART_PX, QUALITY = 450, 0.7, 14, 0.005
"""Points that are followed, and the share of these that lets new ones wait."""
MOST_RETURN_PX = 0.5
SIGMA_PX, NOISE_PX = 0.35, 0.2
"""Of a ray, and of one beside the others of its point: these would draw it nearer, and shorten step after step."""
FINEST, LEAST_SHOWN, BORDER_PX = 4, 0.5, 12
"""A camera that does not see all around is followed in a panorama up to so many times finer, where all that it sees
is less than this share of it; so near the border of what is seen no point is."""
LEAST_POINTS, LEAST_SHARE = 12, 0.3
"""By which a frame is placed, and which share of the points that are known must agree."""
SHOWS, MOST_PASSED = 0.05, 3
"""A frame to which no such share of the points could be followed is passed over; at most so many in a row."""
FIRST_PARALLAX = float(np.radians(2.0))
"""Between the first two frames, beside what turning explains: the middle one of the points'."""
KNOWN_PARALLAX = float(np.radians(1.0))
WINDOW, STRIDE = 4, 2
"""Frames of a row that a flow spans, and from the start of one to the start of the next."""
PATCH_PX, HALVINGS = 15, 4

Grey = NDArray[np.uint8]
Pixels = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
@array_record
class Followed:
    """The points that were followed to a frame, in rising order of their numbers (n,), new ones among them, and where
    they are in the small panorama, `width` pixels wide: pixels (n, 2) float32."""

    numbers: Ints
    pixels: Pixels
    width: int = WIDTH

    @property
    def rays(self) -> Floats:
        """Unit rays (n, 3) in the rig frame."""
        return rays_from_panorama_pixels(self.pixels.astype(np.float64), self.width // 2)

    @property
    def pixel(self) -> float:
        """The angle of a pixel, radians."""
        return 2 * np.pi / self.width


def seen(panorama: Panorama) -> Grey:
    """The small grey panorama (WIDTH / 2, WIDTH) that points are followed in."""
    return _grey(_whole(panorama), WIDTH, WIDTH // 2)


def _whole(panorama: Panorama) -> Grey:
    return panorama.planes.luma if isinstance(panorama, FilmedPanorama) else panorama.image


def _grey(picture: Grey, width: int, height: int) -> Grey:
    """A picture in grey, of this size."""
    step = max(1, picture.shape[1] // (FINE * width))
    small = cv2.resize(picture[::step, ::step], (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), np.uint8)


class _AllAround:
    """The grey pictures that points are followed in, of panoramas: with some of the other end at each end."""

    width, origin = WIDTH, np.array([PAD, 0], np.float32)
    """Of the panorama, and where its first pixel is in these pictures."""

    def __init__(self) -> None:
        rows = np.abs(90 - (np.arange(WIDTH // 2) + 0.5) * 360 / WIDTH) < HIGHEST_DEG
        self.looked_at: Grey = np.zeros((WIDTH // 2, WIDTH + 2 * PAD), np.uint8)
        self.looked_at[rows, PAD:-PAD] = 255

    def picture(self, panorama: Panorama) -> Grey:
        """The picture of a panorama."""
        return np.asarray(cv2.copyMakeBorder(seen(panorama), 0, 0, PAD, PAD, cv2.BORDER_WRAP), np.uint8)

    def within(self, points: Pixels) -> Bools:
        """Which points (n, 2) of these pictures may be followed on: all."""
        return np.ones(len(points), np.bool_)


class _InPart:
    """The same of a camera that does not see all around: what it sees, finer."""

    def __init__(self, mask: Grey) -> None:
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
        finer = min(FINEST, np.sqrt(mask.size / ((bottom - top) * (right - left))))
        self.width = min(mask.shape[1], 2 * round(finer * WIDTH / 2))
        self._part, scale = (slice(top, bottom), slice(left, right)), self.width / mask.shape[1]
        self._size = round((right - left) * scale), round((bottom - top) * scale)
        self.origin = -(np.array([left, top]) * scale).astype(np.float32)
        border = 2 * BORDER_PX + 1
        shown = cv2.copyMakeBorder(_grey(mask[self._part], *self._size), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
        self.looked_at: Grey = np.asarray(
            cv2.erode(np.where(shown == 255, 255, 0).astype(np.uint8), np.ones((border, border)))[1:-1, 1:-1], np.uint8
        )

    def picture(self, panorama: Panorama) -> Grey:
        """The picture of a panorama."""
        return _grey(_whole(panorama)[self._part], *self._size)

    def within(self, points: Pixels) -> Bools:
        """Which points (n, 2) of these pictures may be followed on: those away from the border."""
        x, y = points.round().astype(int).T.clip(0, np.array(self._size)[:, None] - 1)
        return np.asarray(self.looked_at[y, x] > 0)


def _pictures(panorama: Panorama) -> _AllAround | _InPart:
    """What makes the pictures of a drive, by its first panorama."""
    mask = panorama.seen
    return _AllAround() if mask is None or np.count_nonzero(mask) > LEAST_SHOWN * mask.size else _InPart(mask)


class Follower:
    """Follows points through the panoramas of a drive, in order."""

    def __init__(self) -> None:
        self._pictures: _AllAround | _InPart | None = None
        self._last: Grey | None = None
        self._passed = 0
        self._numbers, self._pixels, self._next = np.zeros(0, np.int64), np.zeros((0, 2), np.float32), 0

    def update(self, panorama: Panorama) -> Followed:
        """Follow the points to the next frame, and begin new ones where there are none. No points where the frame is
        passed over, for it is black, or broken: the next one goes on from the last before."""
        pictures = self._pictures = self._pictures or _pictures(panorama)
        picture = pictures.picture(panorama)
        if self._last is not None and len(self._pixels):
            numbers, pixels = self._numbers, self._pixels
            self._move(self._last, picture, pictures)
            if len(self._pixels) < SHOWS * len(pixels) and self._passed < MOST_PASSED:
                self._passed, self._numbers, self._pixels = self._passed + 1, numbers, pixels
                return Followed(numbers[:0], pixels[:0], pictures.width)
        self._passed = 0
        self._begin(picture, pictures)
        self._last = picture
        return Followed(self._numbers, self._pixels, pictures.width)

    def forget(self, numbers: Ints) -> None:
        """Follow some of the points no more."""
        kept = ~np.isin(self._numbers, numbers)
        self._numbers, self._pixels = self._numbers[kept], self._pixels[kept]

    def go_on(self, panorama: Panorama, followed: Followed, next_number: int) -> None:
        """Go on from a frame to which these points were followed; new ones get numbers from the next one on."""
        self._pictures = self._pictures or _pictures(panorama)
        self._last, self._numbers, self._pixels = self._pictures.picture(panorama), followed.numbers, followed.pixels
        self._next = next_number

    def _move(self, last: Grey, picture: Grey, pictures: "_AllAround | _InPart") -> None:
        begin = (self._pixels + pictures.origin)[:, None]
        moved, ok = lucas_kanade(last, picture, begin)
        back, ok_back = lucas_kanade(picture, last, moved)
        good = ok & ok_back & (np.linalg.norm(back - begin, axis=2)[:, 0] < MOST_RETURN_PX)
        good &= pictures.within(moved[:, 0])
        pixels = moved[good, 0] - pictures.origin
        pixels[:, 0] %= pictures.width
        self._numbers, self._pixels = self._numbers[good], pixels

    def _begin(self, picture: Grey, pictures: "_AllAround | _InPart") -> None:
        if len(self._pixels) > ENOUGH * MOST_POINTS:
            return
        free = pictures.looked_at.copy()
        for x, y in (self._pixels + pictures.origin).astype(int).tolist():
            cv2.circle(free, (x, y), APART_PX, 0, -1)
        corners = cv2.goodFeaturesToTrack(picture, MOST_POINTS - len(self._pixels), QUALITY, APART_PX, mask=free)
        if corners is not None:
            pixels = corners[:, 0].astype(np.float32) - pictures.origin
            self._numbers = np.append(self._numbers, self._next + np.arange(len(pixels)))
            self._pixels = np.vstack([self._pixels, pixels])
            self._next += len(pixels)


def lucas_kanade(a: Grey, b: Grey, points: Pixels) -> tuple[Pixels, Bools]:
    """Where points of one picture are in another, and which (n,) were tracked there."""
    moved, status, _ = cv2.calcOpticalFlowPyrLK(  # type: ignore[call-overload]
        a, b, points, None, winSize=(PATCH_PX, PATCH_PX), maxLevel=HALVINGS
    )
    return moved, status.ravel() == 1


def flows(followed: Mapping[int, Followed], spec: ViewSpec) -> Iterator[Flow]:
    """Points that were followed through `WINDOW` frames of a row, by the frames' numbers, where a view shows them in
    all of these; a window begins every `STRIDE` frames."""
    frames = sorted(followed)
    for begin in range(0, len(frames) - WINDOW + 1, STRIDE):
        window = frames[begin : begin + WINDOW]
        shared = reduce(np.intersect1d, [followed[frame].numbers for frame in window])
        rays = np.stack([followed[k].rays[np.isin(followed[k].numbers, shared)] for k in window], axis=1)
        rays = rays @ spec.rig_from_view
        pixels = pinhole.project(np.where(rays[..., 2:] > 0, rays, np.nan), spec.camera)
        shown = ((pixels > 0) & (pixels < [spec.width - 1, spec.height - 1])).all(axis=(1, 2))
        if shown.any():
            yield Flow(np.array(window, np.int64), spec, pixels[shown])


@dataclass(frozen=True, eq=False)
@array_record
class WalkedPath:
    """The path of a drive of n frames: poses `world_from_rig` (n, 4, 4) in the frame of the first and in an unknown
    scale; to which `part` of the drive each belongs (n,), -1 where no pose is known: each part has a scale and a frame
    of its own, for too few points led from one to the next; and the variance of each step (n, 6), turn (radians)
    before position."""

    world_from_rig: Floats
    part: Ints
    variance: Floats

    @cached_property
    def longest(self) -> int:
        """The part with most frames; 0 where there is none."""
        return int(np.bincount(self.part[self.part >= 0], minlength=1).argmax())


@dataclass(eq=False)
class _Points:
    """Points that are followed: numbers (n,), the sums of I - r r' (n, 3, 3) and of these times the camera's place
    (n, 3) over their rays r, how many these are (n,)."""

    numbers: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    across: Floats = field(default_factory=lambda: np.zeros((0, 3, 3)))
    at: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    rays: Ints = field(default_factory=lambda: np.zeros(0, np.int64))

    def only(self, numbers: Ints) -> "_Points":
        """With these numbers alone, in rising order; those that are new have no rays yet."""
        at = np.searchsorted(self.numbers, numbers)
        old = (
            (at < len(self.numbers)) & (self.numbers[np.minimum(at, len(self.numbers) - 1)] == numbers)
            if len(self.numbers)
            else np.zeros(len(numbers), np.bool_)
        )
        points = _Points(
            numbers, np.zeros((len(numbers), 3, 3)), np.zeros((len(numbers), 3)), np.zeros(len(numbers), np.int64)
        )
        for mine, others in ((points.across, self.across), (points.at, self.at), (points.rays, self.rays)):
            mine[old] = others[at[old]]
        return points

    def add(self, chosen: Bools, rays: Floats, place: Floats, noise: float) -> None:
        """Add world rays (n, 3), this uncertain (radians), from a place (3,) to the chosen points (n,)."""
        across = np.eye(3) - (1 + 2 * noise**2) * rays[chosen, :, None] * rays[chosen, None, :]
        self.across[chosen] += across
        self.at[chosen] += across @ place
        self.rays[chosen] += 1

    @property
    def placed(self) -> Bools:
        """Which points (n,) show enough parallax."""
        least = np.linalg.eigvalsh(self.across)[:, 0] / np.maximum(self.rays, 1)
        return np.asarray((self.rays > 1) & (least > (KNOWN_PARALLAX / 2) ** 2))

    def places(self) -> Floats:
        """Where the points are (n, 3); of those that are not known, anywhere."""
        return np.asarray(np.linalg.solve(self.across + 1e-9 * np.eye(3), self.at[..., None])[..., 0])


class Odometry:
    """Places the frames of a drive by the points that were followed to them, in order."""

    def __init__(self) -> None:
        self._poses: list[Floats] = []
        self._parts: list[int] = []
        self._variances: list[Floats] = []
        self._waiting: list[Followed] = []
        self._points = _Points()
        self._part = 0
        self._last: Followed | None = None

    @property
    def path(self) -> WalkedPath:
        """The path so far."""
        poses = np.array(self._poses).reshape(-1, 4, 4)
        return WalkedPath(poses, np.array(self._parts, np.int64), np.array(self._variances).reshape(-1, 6))

    @property
    def pose(self) -> Floats | None:
        """world_from_rig (4, 4) of the latest frame; None where it is not known."""
        return self._poses[-1] if self._parts and self._parts[-1] >= 0 else None

    @property
    def part(self) -> int:
        """The part of the drive that the latest frame belongs to; -1 where its pose is not known."""
        return self._parts[-1] if self._parts else -1

    @property
    def places(self) -> Floats:
        """Where the points are (n, 3) that were followed to the latest frame and are known, in the path's frame."""
        return self._points.places()[self._points.placed]

    def take(self, followed: Followed) -> Ints:
        """Take the next frame; the numbers of points that are to be followed no more, for they do not fit."""
        self._poses.append(np.eye(4))
        self._parts.append(-1)
        self._variances.append(np.zeros(6))
        self._last = followed
        if not len(followed.numbers):
            if self._waiting:
                self._waiting.append(followed)
            return np.zeros(0, np.int64)
        if self._waiting or not len(self._points.numbers):
            self._begin(followed)
            return np.zeros(0, np.int64)
        lost = self._place(len(self._poses) - 1, followed)
        if lost is None:
            self._part += 1
            self._points, self._waiting = _Points(), []
            self._begin(followed)
            return np.zeros(0, np.int64)
        return lost

    def _begin(self, followed: Followed) -> None:
        """Find the scale of a part by its first frame and this one, where they are far enough apart."""
        while self._waiting:
            first = self._waiting[0]
            shared, a, b = np.intersect1d(first.numbers, followed.numbers, assume_unique=True, return_indices=True)
            if len(shared) >= 2 * LEAST_POINTS:
                before, after = first.rays[a], followed.rays[b]
                if _parallax(before, after) > FIRST_PARALLAX:
                    pose, agrees = two_views(before, after, SIGMA_PX * followed.pixel, len(self._poses))
                    if agrees.sum() >= max(LEAST_POINTS, LEAST_SHARE * len(agrees)):
                        self._waiting.append(followed)
                        self._started(pose, shared[agrees])
                        return
                break
            self._waiting.pop(0)
        self._waiting.append(followed)

    def _started(self, pose: Floats, numbers: Ints) -> None:
        """Place the frames that waited: the first, the last by its pose, then those between."""
        waiting, self._waiting = self._waiting, []
        first = len(self._poses) - len(waiting)
        self._points = _Points().only(np.union1d(waiting[0].numbers, waiting[-1].numbers))
        for frame, followed, at in ((first, waiting[0], np.eye(4)), (first + len(waiting) - 1, waiting[-1], pose)):
            self._keep(frame, at, np.zeros(6))
            here = np.isin(self._points.numbers, followed.numbers)
            rays = np.zeros((len(here), 3))
            rays[here] = followed.rays[np.isin(followed.numbers, self._points.numbers)] @ at[:3, :3].T
            chosen = here & (np.isin(self._points.numbers, numbers) | (frame != first))
            self._points.add(chosen, rays, at[:3, 3], NOISE_PX * followed.pixel)
        points = self._points
        for number, followed in enumerate(waiting[1:-1], first + 1):
            self._place(number, followed)
            self._points = points
        self._points = points.only(waiting[-1].numbers)

    def _place(self, frame: int, followed: Followed) -> Ints | None:
        """Place a frame by the points that are known, and add its rays to them; the points that do not fit. None where
        too few agree."""
        points = self._points.only(followed.numbers)
        placed, places, rays = points.placed, points.places(), followed.rays
        if placed.sum() < LEAST_POINTS:
            return None
        sigma = SIGMA_PX * followed.pixel
        pose, covariance, off = resected(places[placed], rays[placed], self._predicted(frame), sigma)
        fits = off < AGREES * sigma
        if fits.sum() < max(LEAST_POINTS, LEAST_SHARE * placed.sum()):
            return None
        self._keep(frame, pose, np.diag(covariance))
        good = np.ones(len(rays), np.bool_)
        good[placed] = fits
        points.add(good, rays @ pose[:3, :3].T, pose[:3, 3], NOISE_PX * followed.pixel)
        self._points = points.only(points.numbers[good])
        return points.numbers[~good]

    def _predicted(self, frame: int) -> Floats:
        """Where the camera would be by its last step."""
        recent = range(max(0, frame - 2 * (1 + MOST_PASSED)), frame)
        before = [number for number in recent if self._parts[number] == self._part][-2:]
        if len(before) < 2:
            return self._poses[before[0]] if before else np.eye(4)
        earlier, last = before
        pose: Floats = self._poses[last].copy()
        pose[:3, 3] += (pose[:3, 3] - self._poses[earlier][:3, 3]) * (frame - last) / (last - earlier)
        return pose

    def _keep(self, frame: int, pose: Floats, variance: Floats) -> None:
        self._poses[frame], self._parts[frame], self._variances[frame] = pose, self._part, variance


def _parallax(first: Floats, second: Floats) -> float:
    """The middle angle between rays (n, 3) of two frames that a turn between them does not explain, radians."""
    weights = np.ones(len(first))
    for _ in range(5):
        left, _, right = np.linalg.svd((second * weights[:, None]).T @ first)
        turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        off = np.linalg.norm(second - first @ turn.T, axis=1)
        weights = 1 / (off + 0.01)
    return float(np.median(off))
