"""What kind of pictures these are: one whole panorama each, or something else that is twice as wide as high.

In an equirectangular panorama the left and right edges are neighbours, and the top and bottom rows are one point each.
Two eyes beside or above one another are alike, patch by patch, but for their parallax; two fisheye circles leave black
corners. Measured on stored and simulated footage: halves of panoramas correlate by 0.67 at most, those of stereo by
0.94 or more.
"""

from collections.abc import Callable, Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import MapWarning, Panorama
from savmap.video.motion import small_grey

WIDTH, HEIGHT = 256, 128
PATCH, REACH, SLACK = 24, 10, 2
LEAST_TEXTURE, LEAST_PATCHES = 3.0, 8
ALIKE, NEARLY_ALIKE = 0.85, 0.75
FAR_COLUMNS = (40, 70, 100, 128)
"""Distances of columns that have little in common."""
BROKEN, UNLIKE, LEAST_CONTRAST = 0.6, 0.35, 5.0
SURELY_BROKEN, SURELY_UNLIKE = 0.85, 0.2
"""Panoramas of rendered and real clips have steps of 0.3 at most between their edges, which are alike by 0.5 at least;
of parts of panoramas, 0.99 and 0.11."""
SMOOTH_PX = 6.0
UNEVEN, EVEN = 0.5, 0.3
BLACK, BLACK_SHARE = 8.0, 0.15
WHOLE = "write one whole panorama a frame in the camera maker's program"
NAMED = "say which (`--camera pinhole`, `--hfov`; docs/video.md)"

Grey = NDArray[np.float32]


def kind_of(keys: Sequence[Panorama]) -> tuple[str, tuple[MapWarning, ...]]:
    """What the pictures of a pass seem to be where they are certainly no panoramas, and what to do ("" where they may
    be some), and the warnings where it is not certain."""
    pictures = [np.asarray(small_grey(panorama, WIDTH), np.float32) for panorama in keys]
    refusal = next(_refusals(pictures), "")
    return (refusal, ()) if refusal else ("", tuple(_warnings(pictures)))


def _refusals(pictures: Sequence[Grey]) -> Iterator[str]:
    if _usual(pictures, fisheyes) > 0.5:
        yield f"seems to hold two fisheye pictures (black corners), no stitched panorama: {WHOLE}"
    if _usual(pictures, side_by_side) > ALIKE:
        packing = "stereo or VR180, side by side, no panorama"
        yield f"its left and right halves show the same: it seems to be {packing}: {WHOLE}"
    if _usual(pictures, over_under) > ALIKE:
        packing = "stereo, one eye above the other, no panorama"
        yield f"its upper and lower halves show the same: it seems to be {packing}: {WHOLE}"
    if _is_broken(pictures) and _usual(pictures, unevenness) > EVEN:
        flaws = "its left and right edges do not meet, nor are its top and bottom rows even"
        yield f"{flaws}: it seems to be no panorama: {WHOLE}, or, of another lens, {NAMED}"
    elif _is_broken(pictures, SURELY_BROKEN, SURELY_UNLIKE):
        yield f"its left and right edges do not meet: it seems to be a part of a panorama, no whole one: {WHOLE}"


def _warnings(pictures: Sequence[Grey]) -> Iterator[MapWarning]:
    likeness = {"left and right": _usual(pictures, side_by_side), "upper and lower": _usual(pictures, over_under)}
    for halves, alike in likeness.items():
        if alike > NEARLY_ALIKE:
            line = f"the {halves} halves of the pictures are much alike: check that it is no stereo video"
            yield MapWarning("bad-panorama", details=(line,))
    if _is_broken(pictures):
        yield MapWarning("bad-panorama", details=("the pictures' side edges do not meet",))
    elif _usual(pictures, unevenness) > UNEVEN:
        yield MapWarning("bad-panorama", details=("the pictures' first and last lines are uneven",))


def _usual(pictures: Sequence[Grey], measure: Callable[[Grey], float]) -> float:
    """The median of a measure over the pictures that have one; nan where none has."""
    values = [value for value in map(measure, pictures) if np.isfinite(value)]
    return float(np.median(values)) if values else float("nan")


def fisheyes(picture: Grey) -> float:
    """1 where the corners between two inscribed circles are black and the circles are not, else 0."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    across, down = np.abs(x % (WIDTH / 2) - WIDTH / 4) / (HEIGHT / 2), np.abs(y - HEIGHT / 2) / (HEIGHT / 2)
    corners = picture[(across > 0.85) & (down > 0.65)]
    inside = picture[(across < 0.5) & (down > 0.4) & (down < 0.75)]
    limit = max(BLACK, BLACK_SHARE * float(np.median(inside)))
    return float(np.percentile(corners, 95) < limit and float(np.median(inside)) > 2 * limit)


def side_by_side(picture: Grey) -> float:
    """How alike the left and right halves are: the usual correlation of a patch with the best place near its own in the
    other half."""
    return _likeness(picture[:, : WIDTH // 2], picture[:, WIDTH // 2 :])


def over_under(picture: Grey) -> float:
    """The same of the upper and lower halves."""
    return _likeness(picture[: HEIGHT // 2], picture[HEIGHT // 2 :])


def _likeness(first: Grey, second: Grey) -> float:
    height, width = first.shape
    corners = [
        (y, x)
        for y in range(SLACK, height - PATCH - SLACK + 1, PATCH)
        for x in range(REACH, width - PATCH - REACH + 1, PATCH)
    ]
    likeness = []
    for y, x in corners:
        patch = first[y : y + PATCH, x : x + PATCH]
        if patch.std() > LEAST_TEXTURE:
            around = second[y - SLACK : y + PATCH + SLACK, x - REACH : x + PATCH + REACH]
            likeness.append(float(cv2.matchTemplate(around, patch, cv2.TM_CCOEFF_NORMED).max()))
    return float(np.median(likeness)) if len(likeness) >= LEAST_PATCHES else float("nan")


def _is_broken(pictures: Sequence[Grey], step: float = BROKEN, unlike: float = UNLIKE) -> bool:
    """Whether the left and right edges do not meet in most pictures: what stands at the seam may look so in a few. A
    step of exposure alone does not break them."""
    seams = np.array([(seam_step(picture), seam_likeness(picture)) for picture in pictures]).reshape(-1, 2)
    seams = seams[np.isfinite(seams).all(axis=1)]
    return bool(2 * np.count_nonzero((seams[:, 0] > step) & (seams[:, 1] < unlike)) > len(seams))


def seam_step(picture: Grey) -> float:
    """The step from the right edge to the left, over that between columns far apart; nan where those hardly differ."""
    usual = float(np.median([np.abs(picture - np.roll(picture, -columns, axis=1)).mean() for columns in FAR_COLUMNS]))
    return float(np.abs(picture[:, 0] - picture[:, -1]).mean()) / usual if usual > LEAST_CONTRAST else float("nan")


def seam_likeness(picture: Grey) -> float:
    """The correlation of the left and the right edge in what changes quickly along them; nan where nothing does."""
    left, right = (_quick(picture[:, column]) for column in (0, -1))
    power = float(np.sqrt((left @ left) * (right @ right)))
    return float(left @ right) / power if power > HEIGHT else float("nan")


def _quick(column: Grey) -> Grey:
    upright = column.reshape(-1, 1)
    smooth = cv2.GaussianBlur(upright, (1, 31), sigmaX=1, sigmaY=SMOOTH_PX)
    return np.asarray(upright - smooth, np.float32).ravel()


def unevenness(picture: Grey) -> float:
    """How much the more even of the top and the bottom row changes from column to column, over what is usual between
    them; a few steps, as at the seams of lenses that were exposed differently, do not count."""
    smooth = cv2.GaussianBlur(picture, (13, 1), sigmaX=2.0, sigmaY=1)
    changes = np.sort(np.abs(np.diff(smooth, axis=1)), axis=1)[:, : -WIDTH // 10].mean(axis=1)
    usual = float(np.median(changes[HEIGHT // 4 : -HEIGHT // 4]))
    return min(float(changes[0]), float(changes[-1])) / (usual + 0.1)
