"""Square fiducial markers (AprilTag, ArUco): searched for all around every few frames, then tracked from frame to
frame.

Corners are OpenCV's with AprilTag's own refinement (Wang and Olson, "AprilTag 2", 2016), which fits lines to the
borders: on drawn panoramas with borders a pixel soft its sides were unbiased to 0.1 %, where `cornerSubPix` made them
up to 1 % too short.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.errors import SiteError
from savmap.types import Floats, Panorama, Track, ViewSpec, array_record
from savmap.vision.views import Renderer

SEARCH_EVERY = 5
SEARCH_PITCH_DEG, SEARCH_HFOV_DEG, SEARCH_VFOV_DEG = -15.0, 75.0, 105.0
SEARCH_FOCAL_PX = 600.0
FINER, EDGE_PX = 2.0, 100.0
MARGIN_DEG, WIDEST_DEG = 8.0, 100.0
APRILTAG_SHIFT_PX = 0.5
SIGMA_PX = 0.3

Label = tuple[str, int]


@dataclass(frozen=True, eq=False)
@array_record
class MarkerTracks:
    """Four tracks of corners for each marker that was detected, by its name "tag36h11 7", and the views of their pixels
    by name."""

    tracks: Mapping[str, Sequence[Track]]
    views: Mapping[str, ViewSpec]


@dataclass(frozen=True, eq=False)
@array_record
class _Sighting:
    """A marker's corners (4, 2) px in a view of a frame, with their standard deviation, px."""

    frame: int
    spec: ViewSpec
    corners: Floats
    sigma_px: float


class MarkerTracker:
    """Tracks the wanted markers, given as (dictionary, number), through the panoramas of a row in order.

    Raises SiteError for a number that the dictionary does not have.
    """

    def __init__(self, wanted: Iterable[Label]) -> None:
        self._sightings: dict[Label, list[_Sighting]] = {label: [] for label in wanted}
        self._near: dict[Label, ViewSpec] = {}
        self._renderer = Renderer()
        for dictionary, number in self._sightings:
            count = len(_dictionary(dictionary).bytesList)
            if number >= count:
                raise SiteError(f"references.markers: {dictionary} has the numbers 0 to {count - 1}, not {number}")

    def update(self, panorama: Panorama) -> None:
        """Detect the markers in the next frame: near their last places, and all around if one is lost, or in every
        fifth frame while any is not tracked."""
        lost = self._track(panorama, tuple(self._near))
        due = panorama.frame % SEARCH_EVERY == 0 and len(self._near) < len(self._sightings)
        if lost or due:
            self._track(panorama, self._search(panorama))

    def _track(self, panorama: Panorama, labels: Iterable[Label]) -> bool:
        """Measure the markers whose views are known, and move these views; true if any marker was lost."""
        resolution, lost = panorama.height / np.pi, False
        for label in labels:
            spec = self._near.pop(label)
            corners = _detected(self._renderer.render(panorama, spec).image, label[0], fine=True).get(label[1])
            if corners is None:
                lost = True
                continue
            sigma = SIGMA_PX * max(float(spec.camera[0, 0]) / resolution, 1.0)
            self._sightings[label].append(_Sighting(panorama.frame, spec, corners, sigma))
            self._near[label] = _around(spec.rig_rays(corners), resolution)
        return lost

    @property
    def marks(self) -> MarkerTracks:
        """The tracks of the markers that were detected."""
        detected = {" ".join(map(str, label)): sightings for label, sightings in self._sightings.items() if sightings}
        views = {
            _view(name, sighting.frame): sighting.spec for name, sightings in detected.items() for sighting in sightings
        }
        tracks = {
            name: [_corner_track(name, corner, sightings) for corner in range(4)]
            for name, sightings in detected.items()
        }
        return MarkerTracks(tracks, views)

    def _search(self, panorama: Panorama) -> list[Label]:
        """The markers that are not tracked and are detected anywhere around; views are set at them."""
        resolution = panorama.height / np.pi
        detected: dict[Label, ViewSpec] = {}
        for spec in _ring(resolution):
            image = self._renderer.render(panorama, spec).image
            for dictionary in dict.fromkeys(name for name, _ in self._sightings):
                for number, corners in _detected(image, dictionary, fine=False).items():
                    label = dictionary, number
                    if label in self._sightings and label not in self._near:
                        detected[label] = _around(spec.rig_rays(corners), resolution)
        self._near |= detected
        return list(detected)


def _corner_track(name: str, corner: int, sightings: Sequence[_Sighting]) -> Track:
    return Track(
        f"marker {name} / corner {corner + 1}",
        "marker",
        {"corner": corner + 1},
        np.array([sighting.frame for sighting in sightings]),
        tuple(_view(name, sighting.frame) for sighting in sightings),
        np.array([sighting.corners[corner] for sighting in sightings]),
        np.array([sighting.sigma_px**2 * np.eye(2) for sighting in sightings]),
    )


def _view(name: str, frame: int) -> str:
    return f"marker {name} / frame {frame}"


def _ring(resolution: float) -> tuple[ViewSpec, ...]:
    """Six views around that overlap by 15 degrees, from steeply down to well above the horizon."""
    focal = min(1.5 * resolution, SEARCH_FOCAL_PX)
    width, tall = (_width_px(angle, focal) for angle in (SEARCH_HFOV_DEG, SEARCH_VFOV_DEG))
    return tuple(
        ViewSpec("around", yaw, SEARCH_PITCH_DEG, 0.0, SEARCH_HFOV_DEG, width, tall)
        for yaw in np.arange(0.0, 360.0, 60.0).tolist()
    )


def _around(rays: Floats, resolution: float) -> ViewSpec:
    """The view at a marker whose corners are at rays (4, 3): `FINER` times as fine as the panorama (px/rad), but no
    finer than shows its sides `EDGE_PX` long, since soft borders many pixels wide are not taken for lines."""
    middle = rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0))
    reach = float(np.arccos(np.clip(rays @ middle, -1, 1)).max())
    hfov = min(2 * (float(np.degrees(reach)) + MARGIN_DEG), WIDEST_DEG)
    width = _width_px(hfov, min(FINER * resolution, EDGE_PX / (np.sqrt(2) * reach)))
    yaw, pitch = np.degrees([np.arctan2(middle[0], middle[2]), -np.arcsin(middle[1])])
    return ViewSpec("marker", float(yaw), float(pitch), 0.0, hfov, width, width)


def _width_px(angle_deg: float, focal: float) -> int:
    return int(2 * focal * np.tan(np.radians(angle_deg) / 2))


def _detected(image: NDArray[np.uint8], dictionary: str, fine: bool) -> dict[int, Floats]:
    """Corners (4, 2) px of the markers in a picture, by number, clockwise from the marker's upper left one."""
    corners, numbers, _ = _detector(dictionary, fine).detectMarkers(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    if numbers is None:
        return {}
    shift = APRILTAG_SHIFT_PX if fine else 0.0
    return {
        int(number): quad.reshape(4, 2).astype(np.float64) - shift
        for number, quad in zip(numbers.ravel(), corners, strict=True)
    }


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary for a site file's word, such as "tag36h11" or "5x5_100"."""
    constant = f"DICT_APRILTAG_{name.removeprefix('tag').upper()}" if name.startswith("tag") else f"DICT_{name.upper()}"
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, constant))


@lru_cache
def _detector(dictionary: str, fine: bool) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG if fine else cv2.aruco.CORNER_REFINE_NONE
    return cv2.aruco.ArucoDetector(_dictionary(dictionary), parameters)
