"""Records of single frames: panoramas, views, and what is detected and measured in them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry import pinhole
from savmap.types.common import Axis, Floats, Ints, array_record, read_only, require


@dataclass(frozen=True, eq=False)
@array_record
class Panorama:
    """One equirectangular picture: `frame` is its number in the row, `stamp_s` the time in its video, `image` (H, 2H,
    3) uint8 RGB; `seen` (H, 2H) uint8, 255 where the camera sees, else 0; None where it sees all around."""

    frame: int
    stamp_s: float
    image: NDArray[np.uint8]
    seen: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        height = len(self.image)
        require(
            self.image.dtype == np.uint8 and self.image.shape == (height, 2 * height, 3),
            self,
            "image must be (H, 2H, 3) uint8",
        )

    @property
    def height(self) -> int:
        """H, pixels."""
        return len(self.image)


@dataclass(frozen=True)
class ViewSpec:
    """Direction and size of a rectilinear view: angles in degrees as `pinhole.rig_from_view` takes them, size in
    pixels.

    The view is rendered from frames whose number in the row is a multiple of `every`.
    """

    name: str
    yaw_deg: float
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    hfov_deg: float = 90.0
    width: int = 640
    height: int = 480
    every: int = 1

    def __post_init__(self) -> None:
        angles = (self.yaw_deg, self.pitch_deg, self.roll_deg)
        require(all(map(isfinite, angles)), self, f"an angle of view `{self.name}` is not finite")
        require(0 < self.hfov_deg < 175, self, f"hfov_deg {self.hfov_deg} is not between 0 and 175")
        require(self.width > 1 and self.height > 1, self, "a view needs at least 2x2 pixels")
        require(self.every > 0, self, f"every {self.every} is not positive")

    def shows(self, frame: int) -> bool:
        """Whether the view is rendered from this frame of the row."""
        return frame % self.every == 0

    @cached_property
    def rig_from_view(self) -> Floats:
        """Rotation (3, 3)."""
        return read_only(pinhole.rig_from_view(self.yaw_deg, self.pitch_deg, self.roll_deg))

    @cached_property
    def camera(self) -> Floats:
        """Calibration matrix (3, 3)."""
        return read_only(pinhole.intrinsics(self.hfov_deg, self.width, self.height))

    def rig_rays(self, pixels: Floats) -> Floats:
        """Unit rays (..., 3) in the rig frame through view pixels (..., 2)."""
        rays: Floats = pinhole.rays_from_pixels(pixels, self.camera) @ self.rig_from_view.T
        return rays


@dataclass(frozen=True, eq=False)
@array_record
class ViewPlan:
    """The views that a plugin wants of one pass.

    A plugin that locates the face also gives the rig's attitude `world_from_rig` (3, 3) at the start of the pass, and
    `travel`, which way the camera goes along the face (+1: towards +x, -1: towards -x, 0: not known). `notes` are lines
    for the log and the report.
    """

    views: tuple[ViewSpec, ...] = ()
    world_from_rig: Floats | None = None
    travel: int = 0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require(self.travel in (-1, 0, 1), self, f"travel is {self.travel}, not -1, 0 or 1")
        if self.world_from_rig is not None:
            turn = np.asarray(self.world_from_rig)
            proper = turn.shape == (3, 3) and np.allclose(turn @ turn.T, np.eye(3), atol=1e-6)
            require(proper and bool(np.linalg.det(turn) > 0), self, "world_from_rig is not a rotation (3, 3)")


@dataclass(frozen=True, eq=False)
@array_record
class View:
    """A rectilinear picture `image` (height, width, 3) uint8 RGB, rendered from panorama `frame` as `spec` says."""

    spec: ViewSpec
    frame: int
    stamp_s: float
    image: NDArray[np.uint8]

    def __post_init__(self) -> None:
        require(self.image.shape == (self.spec.height, self.spec.width, 3), self, "image has not the size of its spec")


class Thresholds(NamedTuple):
    """Probabilities: above `pixel` a pixel belongs to a class; between `weak` and it where nothing nearby is twice as
    likely; and a region must exceed `seed` somewhere."""

    pixel: float
    weak: float
    seed: float

    @classmethod
    def of(cls, pixel: float, weak: float | None = None, seed: float | None = None) -> "Thresholds":
        """Those of settings, of which only the first must be given: without the others a pixel counts by itself."""
        return cls(pixel, min(pixel, weak or pixel), max(pixel, seed or 0.0))


@dataclass(frozen=True, eq=False)
@array_record
class Detection:
    """One connected region of a class: its label, its mean probability `score`, its `mask` (h, w), and the class's
    `probability` (h, w) float32 over the whole view, which all detections of the class share."""

    label: str
    score: float
    mask: NDArray[np.bool_]
    probability: NDArray[np.float32]

    def __post_init__(self) -> None:
        require(
            self.mask.dtype == np.bool_ and self.mask.shape == self.probability.shape,
            self,
            "mask and probability differ in shape",
        )
        require(isfinite(self.score), self, "its score is not finite")

    @cached_property
    def place(self) -> tuple[slice, slice]:
        """The rows and columns that the mask is in."""
        left, top, width, height = cv2.boundingRect(self.mask.view(np.uint8))
        return slice(top, top + height), slice(left, left + width)


@dataclass(frozen=True, eq=False)
@array_record
class Feature:
    """An observed point (n = 1) or straight edge (n = 2, its ends) in a view.

    `pixels` (n, 2); `covariance` (n, 2, 2) px^2 (an edge's is long along it). `label` is the class, `part` the point or
    edge of the object ("left", "upper left", "centre"). `instance` numbers the object within its frame, view and label;
    `neighbours` are instances that it touches, by role. `axis` is the world axis that an edge follows, if known.
    `readings` are texts read on the object, with confidences 0..1. `object`: id of the found object that it is of;
    empty for what a single frame shows.
    """

    frame: int
    view: str
    label: str
    part: str
    instance: int
    pixels: Floats
    covariance: Floats
    axis: Axis | None = None
    score: float = 1.0
    neighbours: Mapping[str, int] = field(default_factory=dict)
    readings: Mapping[str, float] = field(default_factory=dict)
    object: str = ""

    def __post_init__(self) -> None:
        count = len(self.pixels)
        require(count in (1, 2) and self.pixels.shape == (count, 2), self, "pixels must be (1, 2) or (2, 2)")
        require(self.covariance.shape == (count, 2, 2), self, "covariance must be (n, 2, 2)")
        numbers = (*self.pixels.ravel().tolist(), *self.covariance.ravel().tolist())
        require(all(map(isfinite, numbers)), self, "numbers must be finite")


@dataclass(frozen=True, eq=False)
@array_record
class Flow:
    """Points of any kind, tracked through neighbouring `frames` (k,) of a view: `pixels` (n, k, 2)."""

    frames: Ints
    spec: ViewSpec
    pixels: Floats

    def __post_init__(self) -> None:
        require(self.pixels.shape[1:] == (len(self.frames), 2), self, "pixels must be (n, frames, 2)")

    def take(self, chosen: NDArray[np.bool_]) -> "Flow":
        """The flow of the points where a mask (n,) is true."""
        return replace(self, pixels=self.pixels[chosen])
