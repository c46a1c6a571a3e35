"""Points and straight lines in the pictures of an ordinary lens that is carried along a face.

Such a lens sees little beside what it passes: points leave its picture after a few steps. Corners (Shi and Tomasi 1994)
are followed there and back (Lucas and Kanade 1981) from where the change of the whole picture's shift (phase
correlation: Kuglin and Hines 1975) leads; where few survive, for pictures are missing, from a homography of SIFT
features (Lowe 2004). Pictures that show nearly the same as the one before are passed over: each more is a further
copy of copies, and a path's scale runs away with their number.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Bools, Floats, Ints, Planes, array_record

WIDTH, LINES_WIDTH = 1138, 569
"""Of the pictures that points are followed in, and of those that lines are found in."""
MOST_POINTS, ENOUGH, APART_PX, QUALITY = 600, 0.85, 14, 0.01
"""Points that are followed, and the share of these that lets new ones wait."""
STEP = 0.05
"""Of its width, by which a picture shifts before the next one is looked at."""
COARSER, LEAST_RESPONSE, CLEAR = 8, 0.05, 0.7
"""Of the pictures whose shift is measured; a weaker response tells none, or none by which a picture is passed over."""
PATCH_PX, MOST_RETURN_PX, BORDER_PX = 21, 0.5, 4
LEAST_FOLLOWED = 0.3
"""Of the points; where fewer are, features are matched."""
FEATURES, RATIO, LEAST_MATCHES, AGREES_PX = 1000, 0.8, 15, 8.0
SHORTEST = 1 / 30
"""Of line segments, as a share of the picture's width."""

Grey = NDArray[np.uint8]
Pixels = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
@array_record
class LensTracks:
    """What was followed through the pictures of a clip: the numbers of those that were looked at, `frames` (f,);
    sightings of points, in the order of the pictures: `frame` (n,), an index into these, `point` (n,), and `pixels`
    (n, 2) of pictures `size` (width, height); the line `segments` (m, 4) of each picture, from x, y to x, y."""

    frames: Ints
    frame: Ints
    point: Ints
    pixels: Floats
    segments: tuple[Floats, ...]
    size: tuple[int, int]

    def only(self, wanted: Bools) -> "LensTracks":
        """What was followed through some of the pictures (f,)."""
        seen, number = wanted[self.frame], np.cumsum(wanted) - 1
        segments = tuple(lines for lines, keep in zip(self.segments, wanted.tolist(), strict=True) if keep)
        frame = number[self.frame[seen]]
        return LensTracks(self.frames[wanted], frame, self.point[seen], self.pixels[seen], segments, self.size)


class LensFollower:
    """Follows points through the pictures of an ordinary lens, in order."""

    def __init__(self) -> None:
        self._frames = list[int]()
        self._seen = list[tuple[Ints, Pixels]]()
        self._segments = list[Floats]()
        self._before: Grey | None = None
        self._small: Floats | None = None
        self._numbers, self._next = np.zeros(0, np.int64), 0
        self._points, self._flow = np.zeros((0, 1, 2), np.float32), np.zeros((0, 2), np.float32)
        self._shift: Floats = np.zeros(2)
        self._detector = cv2.createLineSegmentDetector(0)

    @property
    def tracks(self) -> LensTracks:
        """What was followed so far."""
        counts = [len(numbers) for numbers, _ in self._seen]
        high, wide = (0, 0) if self._before is None else self._before.shape
        return LensTracks(
            np.array(self._frames, np.int64),
            np.repeat(np.arange(len(counts)), counts),
            np.concatenate([numbers for numbers, _ in self._seen] or [np.zeros(0, np.int64)]),
            np.concatenate([pixels for _, pixels in self._seen] or [np.zeros((0, 2), np.float32)]).astype(np.float64),
            tuple(self._segments),
            (wide, high),
        )

    def update(self, number: int, taken: NDArray[np.uint8] | Planes) -> None:
        """Take the next picture of the clip, of this number there."""
        picture = taken.luma if isinstance(taken, Planes) else cv2.cvtColor(taken, cv2.COLOR_RGB2GRAY)
        high = round(WIDTH * picture.shape[0] / picture.shape[1])
        kind = cv2.INTER_CUBIC if picture.shape[1] < WIDTH else cv2.INTER_AREA
        small = cv2.resize(picture, (WIDTH // COARSER, high // COARSER), interpolation=cv2.INTER_AREA).astype(float)
        shift, response = self._shift_to(small)
        if shift is not None and response > CLEAR and np.hypot(*shift) < STEP * WIDTH:
            return
        grey = np.asarray(cv2.resize(picture, (WIDTH, high), interpolation=kind), np.uint8)
        if self._before is not None and len(self._points):
            self._move(self._before, grey, self._shift if shift is None else shift)
        self._begin(grey)
        self._frames.append(number)
        self._seen.append((self._numbers, self._points[:, 0]))
        self._segments.append(self._lines(grey))
        self._before, self._small = grey, small

    def _shift_to(self, small: Floats) -> tuple[Floats | None, float]:
        """By how many pixels (2,) the whole picture shifted since the last one, None where that is not seen; and how
        clearly."""
        if self._small is None:
            return None, 0.0
        window = cv2.createHanningWindow((small.shape[1], small.shape[0]), cv2.CV_64F)
        move, response = cv2.phaseCorrelate(self._small, small, window)
        return (COARSER * np.array(move) if response > LEAST_RESPONSE else None), response

    def _move(self, before: Grey, grey: Grey, shift: Floats) -> None:
        points = self._points
        led = np.where(np.isnan(self._flow), shift, self._flow + shift - self._shift)[:, None]
        moved, good = followed(before, grey, points, points + led)
        if good.sum() < LEAST_FOLLOWED * len(points) and (lead := matched(before, grey)) is not None:
            second = followed(before, grey, points, np.asarray(cv2.perspectiveTransform(points, lead)))
            if second[1].sum() > good.sum():
                moved, good = second
                middle = np.array([[[grey.shape[1] / 2, grey.shape[0] / 2]]])
                shift = np.asarray(cv2.perspectiveTransform(middle, lead), np.float64)[0, 0] - middle[0, 0]
        self._flow, self._points, self._numbers = (moved - points)[good, 0], moved[good], self._numbers[good]
        self._shift = shift

    def _begin(self, grey: Grey) -> None:
        if len(self._points) >= ENOUGH * MOST_POINTS:
            return
        free = np.full_like(grey, 255)
        for x, y in self._points[:, 0].astype(int).tolist():
            cv2.circle(free, (x, y), APART_PX, 0, -1)
        corners = cv2.goodFeaturesToTrack(grey, MOST_POINTS - len(self._points), QUALITY, APART_PX, mask=free)
        if corners is not None:
            new = corners.reshape(-1, 1, 2)
            self._points = np.concatenate([self._points, new]).astype(np.float32)
            self._flow = np.concatenate([self._flow, np.full((len(new), 2), np.nan, np.float32)])
            self._numbers = np.append(self._numbers, self._next + np.arange(len(new)))
            self._next += len(new)

    def _lines(self, grey: Grey) -> Floats:
        scale = LINES_WIDTH / grey.shape[1]
        small = cv2.resize(grey, (LINES_WIDTH, round(scale * grey.shape[0])), interpolation=cv2.INTER_AREA)
        detected = self._detector.detect(small)[0]
        lines = np.zeros((0, 4)) if detected is None else np.asarray(detected, np.float64).reshape(-1, 4)
        long = np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1]) > SHORTEST * LINES_WIDTH
        return np.asarray((lines[long] + 0.5) / scale - 0.5)


def followed(before: Grey, grey: Grey, points: Pixels, guess: NDArray[Any]) -> tuple[Pixels, Bools]:
    """Where points (n, 1, 2) of one picture are in the next, near a guess, and which (n,) were tracked there and
    back."""
    options = {
        "winSize": (PATCH_PX, PATCH_PX),
        "criteria": (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.03),
        "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
    }
    moved, ok, _ = cv2.calcOpticalFlowPyrLK(  # type: ignore[call-overload]
        before, grey, points, guess.astype(np.float32), maxLevel=3, **options
    )
    back, ok_back, _ = cv2.calcOpticalFlowPyrLK(  # type: ignore[call-overload]
        grey, before, moved, points.copy(), maxLevel=1, **options
    )
    size = np.array(grey.shape[::-1])
    inside = ((moved[:, 0] > BORDER_PX - 1) & (moved[:, 0] < size - BORDER_PX)).all(axis=1)
    returned = np.linalg.norm(back - points, axis=2)[:, 0] < MOST_RETURN_PX
    return moved, np.asarray((ok[:, 0] == 1) & (ok_back[:, 0] == 1) & returned & inside)


def matched(before: Grey, grey: Grey) -> Floats | None:
    """The homography (3, 3) that most features of two pictures agree with; None where too few are alike."""
    sift = cv2.SIFT.create(FEATURES)
    (first, first_told), (second, second_told) = (sift.detectAndCompute(picture, None) for picture in (before, grey))
    if first_told is None or second_told is None or len(second) < 2:
        return None
    nearest = cv2.BFMatcher().knnMatch(first_told, second_told, k=2)
    pairs = [best for best, other in nearest if best.distance < RATIO * other.distance]
    if len(pairs) < LEAST_MATCHES:
        return None
    a = np.array([first[pair.queryIdx].pt for pair in pairs], np.float32)
    b = np.array([second[pair.trainIdx].pt for pair in pairs], np.float32)
    homography = cv2.findHomography(a, b, cv2.RANSAC, AGREES_PX)[0]
    return None if homography is None else np.asarray(homography, np.float64)
