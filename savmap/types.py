"""The records that flow through savmap. Frames and conventions: docs/conventions.md.

World frame of a row: metres; x along the aisle to the right as one faces the row, y up from the floor, z out of the face
towards the camera; the face is z = 0. Rig frame (panorama) and view frame: x right, y down, z forward. Pixel centres are
at integer coordinates.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from savmap.geometry import pinhole

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Axis = Literal["x", "y", "z"]
Place = Mapping[str, int | str]


def _require(condition: bool, record: object, what: str) -> None:
    if not condition:
        raise ValueError(f"{type(record).__name__}: {what}")


@dataclass(frozen=True)
class Panorama:
    """One equirectangular picture: frame number in the row, time in its video, image (H, 2H, 3) uint8 RGB."""

    frame: int
    stamp_s: float
    image: NDArray[np.uint8]

    def __post_init__(self) -> None:
        height = len(self.image)
        _require(
            self.image.dtype == np.uint8 and self.image.shape == (height, 2 * height, 3),
            self,
            "image must be (H, 2H, 3) uint8",
        )


@dataclass(frozen=True)
class ViewSpec:
    """Which way a rectilinear view looks: angles as `pinhole.rig_from_view` takes them, degrees; size in pixels."""

    name: str
    yaw_deg: float
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    hfov_deg: float = 90.0
    width: int = 640
    height: int = 480

    def __post_init__(self) -> None:
        _require(0 < self.hfov_deg < 175, self, f"hfov_deg {self.hfov_deg} is not between 0 and 175")
        _require(self.width > 1 and self.height > 1, self, "a view needs at least 2x2 pixels")

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
class Aim:
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
        _require(self.image.shape == (self.spec.height, self.spec.width, 3), self, "image is not of the view's size")


@dataclass(frozen=True)
class Detection:
    """One connected region a network saw: class label, mean probability, mask (h, w) bool, and the probability
    (h, w) float32 of that class over the whole view (shared by all detections of the class)."""

    label: str
    score: float
    mask: NDArray[np.bool_]
    probability: NDArray[np.float32]

    def __post_init__(self) -> None:
        _require(
            self.mask.dtype == np.bool_ and self.mask.shape == self.probability.shape,
            self,
            "mask and probability differ in shape",
        )


@dataclass(frozen=True)
class Feature:
    """An observed point (n = 1) or straight edge (n = 2, its ends) in a view.

    pixels (n, 2); covariance (n, 2, 2) px^2 (an edge's is long along it). `label` is the class, `part` which point or edge
    of the thing it is ("left", "upper left", "centre"). `instance` numbers the thing within its frame and view and label;
    `neighbours` are instances it touches, by role. `axis` is the world axis that an edge follows, if known.
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

    def __post_init__(self) -> None:
        count = len(self.pixels)
        _require(count in (1, 2) and self.pixels.shape == (count, 2), self, "pixels must be (1, 2) or (2, 2)")
        _require(self.covariance.shape == (count, 2, 2), self, "covariance must be (n, 2, 2)")
        _require(
            bool(np.isfinite(self.pixels).all() and np.isfinite(self.covariance).all()), self, "numbers must be finite"
        )


@dataclass(frozen=True)
class Track:
    """One physical point seen in many frames.

    `name` is its label in the map ("section 3 / beam 2 / upper left"), `label` its class, `place` where in the structure
    it is, as the plugin numbers it. frames (n,), views n names, pixels (n, 2), covariances (n, 2, 2) px^2.
    """

    name: str
    label: str
    place: Place
    frames: Ints
    views: tuple[str, ...]
    pixels: Floats
    covariances: Floats

    def __post_init__(self) -> None:
        count = len(self.frames)
        _require(
            len(self.views) == count and self.pixels.shape == (count, 2),
            self,
            "frames, views and pixels differ in number",
        )
        _require(self.covariances.shape == (count, 2, 2), self, "covariances must be (n, 2, 2)")


@dataclass(frozen=True)
class FrameTable:
    """The frames of a row in order: number (n,) = 0..n-1, time in their video (n,), name of their pass."""

    stamps_s: Floats
    passes: tuple[str, ...]

    def __post_init__(self) -> None:
        _require(len(self.stamps_s) == len(self.passes), self, "stamps and passes differ in number")

    def __len__(self) -> int:
        return len(self.passes)

    def of_pass(self, name: str) -> Ints:
        """Numbers of the frames of one pass, in order."""
        return np.array([i for i, own in enumerate(self.passes) if own == name], dtype=np.int64)


@dataclass(frozen=True)
class Trajectory:
    """world_from_rig (n, 4, 4) for the frames (n,) that are known, and the position's standard deviation (n, 3) m, or None."""

    frames: Ints
    world_from_rig: Floats
    sigma_m: Floats | None = None

    def __post_init__(self) -> None:
        _require(self.world_from_rig.shape == (len(self.frames), 4, 4), self, "world_from_rig must be (n, 4, 4)")


@dataclass(frozen=True)
class RowFacts:
    """What a plugin may know of its row: the frames, the views by name, and, per pass, which way the camera went along
    the face (+1: towards +x, -1: towards -x, 0: not known)."""

    name: str
    frames: FrameTable
    views: Mapping[str, ViewSpec]
    travel: Mapping[str, int]


@dataclass(frozen=True)
class Structure:
    """One mapped thing: vertices (n, 3) m in the row's frame with covariances (n, 3, 3), their labels, and edges (m, 2)."""

    id: str
    label: str
    vertices: Floats
    covariances: Floats
    vertex_labels: tuple[str, ...]
    edges: Ints
    attributes: Mapping[str, float | int | str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.vertices)
        _require(
            self.vertices.shape == (count, 3) and self.covariances.shape == (count, 3, 3),
            self,
            "vertices (n, 3), covariances (n, 3, 3)",
        )
        _require(len(self.vertex_labels) == count, self, "a label a vertex")


@dataclass(frozen=True)
class ReferenceUse:
    """A reference as it went into the solve: name, given value, sigma, the solution's value, all in `unit`."""

    name: str
    value: float
    sigma: float
    solved: float
    unit: str = "m"


@dataclass(frozen=True)
class RowMap:
    """The map of one row: trajectory, structures by plugin, references, views, and figures worth reporting."""

    name: str
    frames: FrameTable
    views: Mapping[str, ViewSpec]
    trajectory: Trajectory
    structures: Mapping[str, tuple[Structure, ...]]
    references: tuple[ReferenceUse, ...]
    report: Mapping[str, float | int | str] = field(default_factory=dict)


@dataclass(frozen=True)
class SiteMap:
    """The rows that were mapped, by name, and what made them (software, models)."""

    rows: Mapping[str, RowMap]
    made_by: Mapping[str, str]
