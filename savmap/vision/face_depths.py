"""How deep behind a face lies what its strips show: a plane sweep, cell by cell, once the camera's path is solved.

What lies in the face's plane moves with the face from frame to frame; what lies behind moves less. For each cell, the
frame that shows it best is compared with its neighbours on planes in front of and behind the face (Collins 1996, "A
space-sweep approach to true multi-image matching"). On the plane that has the depth of what is shown there, windows of
all of them correlate. Posts and beams hide some cells from some frames, so that the better half of the neighbours
counts (Kang, Szeliski and Chai 2001, "Handling occlusions in dense multi-view stereo").
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import FaceDepths, Floats, PlanePatch, RowStrips, Trajectory, array_record
from savmap.vision.orthophoto import Canvas, Shot, pixel_m, shots_of

Bytes = NDArray[np.uint8]
Singles = NDArray[np.float32]

NEAREST_M, FARTHEST_M = -0.2, 1.6
"""Behind the face: from what stands out of it to beyond its rear."""
BASELINES = (-0.4, -0.2, 0.2, 0.4)
"""Where the neighbours of a frame are, in its distances from the face; strips are 0.9 of that wide."""
LEAST_BASELINE, MOST_BASELINE = 0.08, 0.7
STEP_PX = 2.5
"""From plane to plane, what the farthest neighbours show moves by so much: windows still correlate."""
PIXEL_M = 0.008
WINDOW_PX = 9
NOISE = 2.0
"""The variance, of grey levels, that compression leaves of flat paint: it shall agree with nothing."""
KEPT_PICTURES = 16


def face_depths(face: PlanePatch, strips: RowStrips, path: Trajectory) -> FaceDepths | None:
    """The sweep over a face, from strips whose frames were taken along a path. Face and path are in metres. None where
    no strip shows it."""
    shots = list(shots_of(face, strips, path))
    if not shots:
        return None
    canvas = Canvas.over(face, max(pixel_m(face, shots), PIXEL_M))
    owners = canvas.owners(shots)
    sweep = _Sweep(canvas, shots, swept_depths(float(np.median([shot.place[2] for shot in shots])), canvas.pixel))
    scores = np.zeros((len(sweep.depths), *owners.shape), np.float32)

    def fill(number: int) -> None:
        shown = np.flatnonzero((owners == number).any(axis=0))
        columns = slice(int(shown[0]), int(shown[-1]) + 1)
        mine = owners[:, columns] == number
        scores[:, :, columns][:, mine] = sweep.scores(number, columns)[:, mine]

    in_order = sorted(np.unique(owners[owners >= 0]).tolist(), key=lambda k: float(shots[k].place[0]))
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # each fills cells of its shot alone
        list(pool.map(fill, in_order))
    cameras = np.where((owners >= 0)[..., None], np.array([shot.place for shot in shots])[owners], np.nan)
    return FaceDepths(face.origin, face.right, face.up, canvas.cell, sweep.depths, scores, cameras)


def swept_depths(distance: float, pixel: float) -> Floats:
    """The planes' depths behind the face (k,) m for cameras at a distance from it: the face is one of them."""
    step = STEP_PX * pixel / (BASELINES[-1] * distance)
    first, last = (depth / (distance + depth) / step for depth in (NEAREST_M, FARTHEST_M))
    shares = step * np.arange(np.ceil(first), np.floor(last) + 1)
    return np.asarray(distance * shares / (1 - shares))


def neighbours(shots: Sequence[Shot], number: int) -> list[int]:
    """The shots nearest to the wanted baselines on both sides of a shot."""
    distance = float(shots[number].place[2])
    shares = np.array([shot.place[0] - shots[number].place[0] for shot in shots]) / distance
    nearest = sorted({int(np.abs(shares - baseline).argmin()) for baseline in BASELINES})
    return [k for k in nearest if LEAST_BASELINE < abs(shares[k]) < MOST_BASELINE]


@dataclass(frozen=True, eq=False)
@array_record
class _Windows:
    """The windows around a picture's pixels (h, w), grey levels: their means and their standard deviations, of noise,
    too."""

    picture: Singles
    mean: Singles
    sigma: Singles

    @classmethod
    def of(cls, picture: Singles) -> "_Windows":
        mean = _averaged(picture)
        variance = np.maximum(_averaged(picture * picture) - mean * mean, 0) + np.float32(NOISE)
        return cls(picture, mean, np.sqrt(variance))

    def correlation(self, other: "_Windows") -> Singles:
        """How well windows at the same places agree (h, w), -1 to 1."""
        both = _averaged(self.picture * other.picture) - self.mean * other.mean
        return np.asarray(both / (self.sigma * other.sigma))


def _averaged(picture: Singles) -> Singles:
    return np.asarray(cv2.blur(picture, (WINDOW_PX, WINDOW_PX)), np.float32)


class _Sweep:
    """Shots of a face and the depths that are tried."""

    def __init__(self, canvas: Canvas, shots: Sequence[Shot], depths: Floats) -> None:
        self.canvas, self.shots, self.depths = canvas, shots, depths
        self._grey: Callable[[int], Bytes] = lru_cache(KEPT_PICTURES)(lambda number: shots[number].grey())

    def scores(self, number: int, columns: slice) -> Singles:
        """How well a shot agrees with the better half of its neighbours at each depth (k, rows, columns); 0 where it
        has none."""
        near, canvas = neighbours(self.shots, number), self.canvas
        size = (columns.stop - columns.start) * canvas.times, canvas.rows * canvas.times
        middle = slice(canvas.times // 2, None, canvas.times)
        result = np.zeros((len(self.depths), canvas.rows, columns.stop - columns.start), np.float32)
        if not near:
            return result
        face_from_part = canvas.face_from_part(0, columns.start, canvas.pixel)
        target = _Windows.of(self._laid(number, face_from_part, size))
        for score, depth in zip(result, self.depths.tolist(), strict=True):
            agreements = np.empty((len(near), *score.shape), np.float32)
            for agreement, k in zip(agreements, near, strict=True):
                moved = seen_from(self.shots[number].place, self.shots[k].place, depth) @ face_from_part
                agreement[:] = target.correlation(_Windows.of(self._laid(k, moved, size)))[middle, middle]
            agreements.partition(len(near) // 2, axis=0)
            score[:] = agreements[len(near) // 2 :].mean(axis=0)
        return result

    def _laid(self, number: int, face_from_part: Floats, size: tuple[int, int]) -> Singles:
        """A shot's grey levels on a part of the face, 0 where it does not show it."""
        matrix = self.shots[number].pixels_from_face @ face_from_part
        laid = cv2.warpPerspective(self._grey(number), matrix, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        return laid.astype(np.float32)


def seen_from(first: Floats, second: Floats, depth: float) -> Floats:
    """The transform (3, 3) of places on the face, right and up: from where a camera at `first` (3,) sees a point at a
    depth behind it to where one at `second` does."""
    away, back = depth / first[2], second[2] / (second[2] + depth)
    shift = (1 - back) * second[:2] - back * away * first[:2]
    scale = back * (1 + away)
    return np.array([[scale, 0, shift[0]], [0, scale, shift[1]], [0, 0, 1.0]])
