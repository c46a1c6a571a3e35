"""Which way the camera goes along a face: from the pictures' motion between close frames."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry import pinhole
from savmap.stages.render import Renderer
from savmap.types import Panorama, ViewSpec

CORNERS = 300
LEAST_TRACKS = 20
LEAST_MOTION_PX = 0.7
ALONG_OVER_ACROSS = 1.5


def travel_direction(pairs: Sequence[tuple[Panorama, Panorama]], spec: ViewSpec, renderer: Renderer) -> int:
    """+1 where the camera moves to the right as it looks along `spec` (towards the face's +x), -1 to the left, 0 unknown.

    What the view and the one opposite have in common is the rig's turning; half their difference is its motion. That must
    exceed the motion found the same way in the two views across, as it does only when looking across the way.
    """
    along = sum(_sideways(pair, spec, renderer) for pair in pairs)
    across = sum(_sideways(pair, _turned(spec, 90), renderer) for pair in pairs)
    if not pairs or abs(along) < max(LEAST_MOTION_PX * len(pairs), ALONG_OVER_ACROSS * abs(across)):
        return 0
    return 1 if along > 0 else -1


def _turned(spec: ViewSpec, degrees: float) -> ViewSpec:
    """A 90 degree view turned about the vertical of `spec`."""
    rotation = spec.rig_from_view @ pinhole.rig_from_view(degrees, 0, 0)
    return ViewSpec("travel", *pinhole.angles_from_rotation(rotation), hfov_deg=90)


def _sideways(pair: tuple[Panorama, Panorama], spec: ViewSpec, renderer: Renderer) -> float:
    """Motion to the right in pixels of a 90 degree view, free of turning; 0 where too little can be followed."""
    ahead, behind = (_shift(pair, _turned(spec, turn), renderer) for turn in (0, 180))
    return 0.0 if np.isnan(ahead + behind) else (behind - ahead) / 2


def _shift(pair: tuple[Panorama, Panorama], spec: ViewSpec, renderer: Renderer) -> float:
    """Median shift of the picture's corners to the right, pixels; nan where too few can be followed."""
    first, second = (np.asarray(cv2.cvtColor(renderer.render(p, spec).image, cv2.COLOR_RGB2GRAY), np.uint8) for p in pair)
    found = cv2.goodFeaturesToTrack(first, CORNERS, 0.01, 8)
    if found is None:
        return float("nan")
    corners = np.asarray(found, np.float32)
    there = _follow(first, second, corners)
    back = _follow(second, first, there)
    good = np.linalg.norm(back - corners, axis=-1).ravel() < 1.0
    return float(np.median((there - corners)[good, 0, 0])) if good.sum() >= LEAST_TRACKS else float("nan")


def _follow(first: NDArray[np.uint8], second: NDArray[np.uint8], points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Where points (n, 1, 2) of the first picture are in the second."""
    moved, _, _ = cv2.calcOpticalFlowPyrLK(first, second, points, points.copy(), winSize=(21, 21), maxLevel=4)
    return np.asarray(moved, np.float32)
