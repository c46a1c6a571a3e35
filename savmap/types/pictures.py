"""Records of what is looked at and what is seen in one frame."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from savmap.geometry import pinhole
from savmap.types.common import Axis, Floats, Ints, require


@dataclass(frozen=True)
class Panorama:
    """One equirectangular picture: frame number in the row, time in its video, image (H, 2H, 3) uint8 RGB."""

    frame: int
    stamp_s: float
    image: NDArray[np.uint8]

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
    """Which way a rectilinear view looks: angles as `pinhole.rig_from_view` takes them, degrees; size in pixels. It is cut
    from frames whose number in the row is a multiple of `every`."""

    name: str
    yaw_deg: float
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    hfov_deg: float = 90.0
    width: int = 640
    height: int = 480
    every: int = 1

    def __post_init__(self) -> None:
        require(0 < self.hfov_deg < 175, self, f"hfov_deg {self.hfov_deg} is not between 0 and 175")
        require(self.width > 1 and self.height > 1, self, "a view needs at least 2x2 pixels")
        require(self.every > 0, self, f"every {self.every} is not positive")

    def shows(self, frame: int) -> bool:
        """Whether the view is cut from a frame of the row."""
        return frame % self.every == 0

    @property
    def rig_from_view(self) -> Floats:
        """Rotation (3, 3)."""
        return pinhole.rig_from_view(self.yaw_deg, self.pitch_deg, self.roll_deg)

    @property
    def camera(self) -> Floats:
        """Calibration matrix (3, 3)."""
        return pinhole.intrinsics(self.hfov_deg, self.width, self.height)

    def rig_rays(self, pixels: Floats) -> Floats:
        """Unit rays (..., 3) in the rig frame through view pixels (..., 2)."""
        rays: Floats = pinhole.rays_from_pixels(pixels, self.camera) @ self.rig_from_view.T
        return rays


@dataclass(frozen=True)
class ViewPlan:
    """What a plugin wants to look at in one pass: its views, and, if it knows the face, the first attitude of the rig
    world_from_rig (3, 3) and which way the camera goes along the face (+1: towards +x, -1: towards -x, 0: not known).

    `notes` are lines for the log and the report.
    """

    views: tuple[ViewSpec, ...]
    world_from_rig: Floats | None = None
    travel: int = 0
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class View:
    """A rectilinear picture (height, width, 3) uint8 RGB cut from panorama `frame` as `spec` says."""

    spec: ViewSpec
    frame: int
    stamp_s: float
    image: NDArray[np.uint8]

    def __post_init__(self) -> None:
        require(self.image.shape == (self.spec.height, self.spec.width, 3), self, "image is not of the view's size")


@dataclass(frozen=True)
class Detection:
    """One connected region a network saw: class label, mean probability, mask (h, w) bool, and the probability
    (h, w) float32 of that class over the whole view (shared by all detections of the class)."""

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


@dataclass(frozen=True)
class Feature:
    """An observed point (n = 1) or straight edge (n = 2, its ends) in a view.

    pixels (n, 2); covariance (n, 2, 2) px^2 (an edge's is long along it). `label` is the class, `part` which point or edge
    of the thing it is ("left", "upper left", "centre"). `instance` numbers the thing within its frame and view and label;
    `neighbours` are instances it touches, by role. `axis` is the world axis that an edge follows, if known. `readings`: what
    was read on the thing, with confidences 0..1.
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

    def __post_init__(self) -> None:
        count = len(self.pixels)
        require(count in (1, 2) and self.pixels.shape == (count, 2), self, "pixels must be (1, 2) or (2, 2)")
        require(self.covariance.shape == (count, 2, 2), self, "covariance must be (n, 2, 2)")
        numbers = (*self.pixels.ravel().tolist(), *self.covariance.ravel().tolist())
        require(all(map(isfinite, numbers)), self, "numbers must be finite")


@dataclass(frozen=True)
class Flow:
    """Points of any kind, followed through neighbouring frames (k,) of a view: pixels (n, k, 2)."""

    frames: Ints
    spec: ViewSpec
    pixels: Floats

    def __post_init__(self) -> None:
        require(self.pixels.shape[1:] == (len(self.frames), 2), self, "pixels must be (n, frames, 2)")

    def take(self, chosen: NDArray[np.bool_]) -> "Flow":
        """Those of its points where a mask (n,) is true."""
        return replace(self, pixels=self.pixels[chosen])
