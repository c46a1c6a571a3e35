"""Records of a row: frames, path, tracks, and the structures of its map."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from savmap.types.common import Attribute, Axis, Floats, Ints, Place, require
from savmap.types.pictures import ViewSpec


@dataclass(frozen=True)
class Track:
    """One physical point seen in many frames.

    `name` is its label in the map ("section 3 / beam 2 / upper left"), `label` its class, `place` where in the structure
    it is: numbers and words of the plugin's own, for its later hooks. frames (n,), views n names, pixels (n, 2), covariances (n, 2, 2) px^2.
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
        require(
            len(self.views) == count and self.pixels.shape == (count, 2),
            self,
            "frames, views and pixels differ in number",
        )
        require(self.covariances.shape == (count, 2, 2), self, "covariances must be (n, 2, 2)")


@dataclass(frozen=True)
class FrameTable:
    """The frames of a row in order: number (n,) = 0..n-1, time in their video (n,), name of their pass."""

    stamps_s: Floats
    passes: tuple[str, ...]

    def __post_init__(self) -> None:
        require(len(self.stamps_s) == len(self.passes), self, "stamps and passes differ in number")

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
        require(self.world_from_rig.shape == (len(self.frames), 4, 4), self, "world_from_rig must be (n, 4, 4)")


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
    """One mapped thing: vertices (n, 3) m in the row's frame with covariances (n, 3, 3), their labels, and edges (m, 2).

    `attributes`: what else is known of it, by a name that ends with its unit ("height_m"); a `Measured` has a standard deviation.
    """

    id: str
    label: str
    vertices: Floats
    covariances: Floats
    vertex_labels: tuple[str, ...]
    edges: Ints
    attributes: Mapping[str, Attribute] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.vertices)
        require(
            self.vertices.shape == (count, 3) and self.covariances.shape == (count, 3, 3),
            self,
            "vertices (n, 3), covariances (n, 3, 3)",
        )
        require(len(self.vertex_labels) == count, self, "a label a vertex")


@dataclass(frozen=True)
class CrossRowLandmark:
    """A mapped thing that another row may have mapped too: its structure's id, its kind (within which one may be taken for
    another), its place (3,) m in the row's frame with covariance (3, 3), and the row's axes along which both rows see it in one
    place. `behind_m`: shared only by rows back to back with their faces no further apart than that; None: by any rows."""

    id: str
    kind: str
    place: Floats
    covariance: Floats
    axes: tuple[Axis, ...] = ("x", "y", "z")
    behind_m: float | None = None

    def __post_init__(self) -> None:
        require(self.place.shape == (3,) and self.covariance.shape == (3, 3), self, "place (3,), covariance (3, 3)")
        require(bool(self.axes), self, "an axis at least")


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
class Placement:
    """Where a row stands in the site's frame (y up, metres): its origin at (x, 0, z), its x axis turned by `heading_deg` about y,
    counter-clockwise as seen from above. `covariance` (3, 3) of x m, z m and heading in degrees."""

    x_m: float
    z_m: float
    heading_deg: float
    covariance: Floats

    def __post_init__(self) -> None:
        require(self.covariance.shape == (3, 3), self, "covariance must be (3, 3)")

    @property
    def site_from_row(self) -> Floats:
        """Transform (4, 4)."""
        turn = np.deg2rad(self.heading_deg)
        cos, sin = np.cos(turn), np.sin(turn)
        moved: Floats = np.array([[cos, 0, sin, self.x_m], [0, 1, 0, 0], [-sin, 0, cos, self.z_m], [0, 0, 0, 1]])
        return moved

    def points(self, points: Floats) -> Floats:
        """Points (n, 3) of the row in the site's frame."""
        transform = self.site_from_row
        moved: Floats = points @ transform[:3, :3].T + transform[:3, 3]
        return moved

    def covariances(self, points: Floats, covariances: Floats) -> Floats:
        """Covariances (n, 3, 3) of points (n, 3) of the row, in the site's frame: with what is not known of the row's place."""
        turn = self.site_from_row[:3, :3]
        arm = points @ turn.T
        slopes = np.zeros((len(points), 3, 3))
        slopes[:, 0, 0] = slopes[:, 2, 1] = 1.0
        slopes[:, 0, 2], slopes[:, 2, 2] = np.deg2rad(arm[:, 2]), -np.deg2rad(arm[:, 0])
        whole: Floats = turn @ covariances @ turn.T + slopes @ self.covariance @ np.swapaxes(slopes, 1, 2)
        return whole


@dataclass(frozen=True)
class Tie:
    """A thing that two rows see, by their ids for it, with what is left between its two places in the site's frame: residual
    (3,) m, and its standard deviation (3,) m; NaN along axes that the thing does not tell."""

    row_a: str
    row_b: str
    id_a: str
    id_b: str
    residual_m: Floats
    sigma_m: Floats


@dataclass(frozen=True)
class SiteMap:
    """The rows that were mapped, by name, and what made them (software, models); the rows that failed, and why; where rows
    stand in the site's frame, and the things by which neighbouring rows hang together, where that is known."""

    rows: Mapping[str, RowMap]
    made_by: Mapping[str, str]
    failed: Mapping[str, str] = field(default_factory=dict)
    placed: Mapping[str, Placement] = field(default_factory=dict)
    ties: tuple[Tie, ...] = ()
