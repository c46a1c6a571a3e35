"""Which way the camera goes along a face, from the motion of the pictures between close frames."""

from collections.abc import Sequence

import cv2
import numpy as np

from savmap.geometry import pinhole
from savmap.types import Floats, Panorama, ViewSpec
from savmap.vision.flow import lucas_kanade
from savmap.vision.views import Renderer

CORNERS = 300
LEAST_TRACKS = 20
LEAST_MOTION_PX = 0.5
ALONG_OVER_ACROSS = 1.5
# shifts of four views, turned by 90 degrees each: what turning adds, and moving along the first and the second
SHIFTS = np.array([[1.0, -1, 0], [1, 0, -1], [1, 1, 0], [1, 0, 1]])


def travel_directions(
    pairs: Sequence[tuple[Panorama, Panorama]], spec: ViewSpec, renderer: Renderer
) -> tuple[int, int, int, int]:
    """Which way the camera moves along `spec` and the views turned from it to the right by 90, 180 and 270 degrees: +1
    to the right as it looks along the view (towards the face's +x), -1 to the left, 0 unknown.

    The rig's turning shifts all views alike; half the difference of opposite views is its motion. That must exceed the
    motion measured in the same way in the two views across, which it does only when looking across the way. One view
    may be too bare to track anything in.
    """
    views = [_turned(spec, turn) for turn in (0.0, 90.0, 180.0, 270.0)]
    shifts = np.array([[_shift(pair, view, renderer) for view in views] for pair in pairs]).reshape(-1, 4)
    along, across = np.array([_motion(row) for row in shifts]).reshape(-1, 2).sum(axis=0).tolist()
    least = max(LEAST_MOTION_PX * len(pairs), 1e-9)
    first = int(np.sign(along)) if abs(along) > max(least, ALONG_OVER_ACROSS * abs(across)) else 0
    second = int(np.sign(across)) if abs(across) > max(least, ALONG_OVER_ACROSS * abs(along)) else 0
    return first, second, -first, -second


def parallax_rad(pairs: Sequence[tuple[Panorama, Panorama]], spec: ViewSpec, renderer: Renderer) -> float:
    """The angle by which objects straight ahead move in a view across the way from one used frame to the next; nan if
    unknown."""
    view = _turned(spec, 0.0)
    shifts = np.abs([_shift(pair, view, renderer) for pair in pairs])
    known = shifts[np.isfinite(shifts)]
    return float(np.median(known) / view.camera[0, 0]) if len(known) else float("nan")


def _motion(shifts: Floats) -> Floats:
    """Motion (2,) to the right of the first and the second of four views' shifts (4,) px; 0 where two or more are
    nan."""
    known = np.isfinite(shifts)
    if known.sum() < 3:
        return np.zeros(2)
    motion: Floats = np.linalg.lstsq(SHIFTS[known], shifts[known], rcond=None)[0][1:]
    return motion


def _turned(spec: ViewSpec, degrees: float) -> ViewSpec:
    """A small 90 degree view turned about the vertical of `spec`."""
    rotation = spec.rig_from_view @ pinhole.rig_from_view(degrees, 0, 0)
    return ViewSpec("travel", *pinhole.angles_from_rotation(rotation), hfov_deg=90, width=320, height=240)


def _shift(pair: tuple[Panorama, Panorama], spec: ViewSpec, renderer: Renderer) -> float:
    """Median shift of the picture's corners to the right, pixels; nan where too few can be tracked."""
    first, second = (
        np.asarray(cv2.cvtColor(renderer.render(p, spec).image, cv2.COLOR_RGB2GRAY), np.uint8) for p in pair
    )
    detected = cv2.goodFeaturesToTrack(first, CORNERS, 0.01, 5)
    if detected is None:
        return float("nan")
    corners = np.asarray(detected, np.float32)
    there, _ = lucas_kanade(first, second, corners)
    back, _ = lucas_kanade(second, first, there)
    good = np.linalg.norm(back - corners, axis=-1).ravel() < 1.0
    return float(np.median((there - corners)[good, 0, 0])) if good.sum() >= LEAST_TRACKS else float("nan")
