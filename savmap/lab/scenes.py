"""Made-up scenes: what they are made of, what a plugin is told of a place, and what it adds to it.

World frame of a scene: x along the aisle, y up from the floor, z out of the first row's face (its face is z = 0);
metres. A row's frame is the same for a row that faces +z; one that faces -z has its own x axis along -x of the world.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from savmap.errors import SiteError
from savmap.types.common import Floats, array_record

Face = Literal["-x", "+x", "-y", "+y", "-z", "+z"]
FACES: tuple[Face, ...] = ("-x", "+x", "-y", "+y", "-z", "+z")
Rgb = tuple[float, float, float]
Range = tuple[float, float]
Corner = tuple[float, float, float]
Distractor = Literal["goods", "debris", "aisle_marking", "pipes", "skylights", "windows"]
"""What the simulator puts into a place that belongs to no plugin."""
Model = TypeVar("Model", bound=BaseModel)


class SceneError(SiteError):
    """A scene file that cannot be read or does not say what it should."""


@dataclass(frozen=True)
class Material:
    """How a surface looks. Colours are linear RGB in 0..1; `texture` names a procedural pattern of the renderers.

    `emission` is the radiance in units of a white wall under the scene's mean light (0 for anything but lamps).
    `scale_m` is the size of the pattern's period, `contrast` 0..1 its strength, `seed` makes it this box's own.
    """

    color: Rgb
    texture: Literal["plain", "noise", "wood", "carton", "holes", "stripes", "wire", "scratches"] = "plain"
    second_color: Rgb = (0.0, 0.0, 0.0)
    scale_m: float = 0.05
    contrast: float = 0.3
    roughness: float = 0.5
    metallic: float = 0.0
    emission: float = 0.0
    seed: int = 0


@dataclass(frozen=True, eq=False)
@array_record
class Box:
    """A box: `size` (3,) m along its own axes, `center` (3,) m, `rotation` (3, 3) world_from_box.

    `face_labels` names the class that a segmentation network should give the pixels of a face (the others: background).
    `prints`: pictures (h, w, 3) uint8 sRGB that cover upright faces of it (x and z), the right way up as seen from
    outside.
    """

    center: Floats
    size: Floats
    material: Material
    rotation: Floats = field(default_factory=lambda: np.eye(3))
    face_labels: Mapping[Face, str] = field(default_factory=dict)
    prints: Mapping[Face, NDArray[np.uint8]] = field(default_factory=dict)


def span(x: Range, y: Range, z: Range, material: Material) -> Box:
    """The box that fills the ranges x, y and z, in metres."""
    low, high = np.array([x[0], y[0], z[0]]), np.array([x[1], y[1], z[1]])
    return Box((low + high) / 2, high - low, material)


class Strict(BaseModel):
    """A part of a scene file: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def validated(model: type[Model], content: Mapping[str, Any], source: str) -> Model:
    """`content` as a `model`. Raises SceneError with one line that names `source` and each wrong key."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        wrong = "; ".join(f"{'.'.join(str(part) for part in e['loc'])}: {e['msg']}" for e in error.errors())
        raise SceneError(f"{source}: {wrong}") from error


class Hall(Strict):
    """The building: floor, walls, ceiling and what hangs there. The floor spans `x` and `z`."""

    x: tuple[float, float] = (-15.0, 30.0)
    z: tuple[float, float] = (-12.0, 14.0)
    height: float = Field(default=9.0, gt=2)
    floor_color: Rgb = (0.42, 0.42, 0.41)
    floor_texture: Literal["plain", "noise", "scratches"] = "noise"
    wall_color: Rgb = (0.5, 0.52, 0.54)
    ceiling_color: Rgb = (0.35, 0.36, 0.38)
    truss: Literal["none", "beams", "lattice"] = "beams"
    truss_pitch: float = Field(default=5.0, gt=0.5)
    purlin_pitch: float = Field(default=0.0, ge=0)
    steel_color: Rgb = (0.3, 0.3, 0.32)
    pipes: int = Field(default=0, ge=0)
    skylights: int = Field(default=0, ge=0)
    windows: int = Field(default=0, ge=0)
    aisle_marking: bool = False


class Goods(Strict):
    """What stands on the supports that plugins offer: how densely, of which kinds, how far over the edge."""

    density: float = Field(default=0.6, ge=0, le=1)
    overhang: float = Field(default=0.05, ge=0, le=0.4)
    pallets: float = Field(default=0.4, ge=0, le=1)
    wrap: float = Field(default=0.15, ge=0, le=1)
    labels: float = Field(default=0.5, ge=0, le=1)
    colors: tuple[Rgb, ...] = ((0.48, 0.33, 0.2), (0.42, 0.28, 0.16), (0.6, 0.6, 0.6))
    debris: float = Field(default=0.0, ge=0, le=1)
    identical: bool = False


class Exposure(Strict):
    """How the pictures are exposed: `exposure` 1 puts the mean of the scene at a mid grey."""

    exposure: float = Field(default=1.0, gt=0)
    ambient: float = Field(default=0.15, ge=0)
    light_color: Rgb = (1.0, 0.97, 0.92)
    contrast: float = Field(default=1.0, gt=0)
    white_balance: Rgb = (1.0, 1.0, 1.0)
    noise: float = Field(default=0.006, ge=0)
    texel: float = Field(default=0.25, gt=0.02)


class RowPlace(Strict):
    """Where a row's face stands: `x` and `z` of its own origin in the world, and the way it faces.

    `mapped` rows border the camera's aisle: they are surveyed and their fronts carry labels.
    """

    x: float = 0.0
    z: float = 0.0
    facing: Literal["+z", "-z"] = "+z"
    mapped: bool = True


@dataclass(frozen=True, eq=False)
@array_record
class RowFrame:
    """A row's own frame in the world: `world_from_row` (3, 3), `origin` (3,) m; `mapped` as in the scene file."""

    world_from_row: Floats
    origin: Floats
    mapped: bool

    def to_world(self, points: Floats) -> Floats:
        """Points (..., 3) of the row's frame in the world."""
        world: Floats = points @ self.world_from_row.T + self.origin
        return world

    def to_row(self, points: Floats) -> Floats:
        """Points (..., 3) of the world in the row's frame."""
        row: Floats = (points - self.origin) @ self.world_from_row
        return row


@dataclass(frozen=True)
class RowSize:
    """How far a row's structure reaches from the row's origin, m: `length` along the aisle, `height` above the
    floor."""

    length: float
    height: float


@dataclass(frozen=True)
class Front:
    """A labelled front in a row's face: its class, its lowest and its highest corner (x, y, z) in the row's frame,
    m."""

    label: str
    low: Corner
    high: Corner


@dataclass(frozen=True, eq=False)
class Site:
    """What a plugin may know of the place around its structure.

    `frames`: the rows by name. `sizes` and `fronts`, by row: what the plugins before it in the scene file have built
    there. `aisle`: the width of the camera's aisle, m, where it has a face on both sides or is still to be furnished.
    """

    hall: Hall
    goods: Goods
    exposure: Exposure
    frames: Mapping[str, RowFrame]
    sizes: Mapping[str, RowSize] = field(default_factory=dict)
    fronts: Mapping[str, Sequence[Front]] = field(default_factory=dict)
    aisle: float | None = None


@dataclass(frozen=True, eq=False)
class Support:
    """A level surface that goods may stand on: in the frame of its row, x and z ranges, height y, free height above."""

    frame: RowFrame
    x: Range
    z: Range
    y: float
    headroom: float


@dataclass(frozen=True, eq=False)
class SceneParts:
    """What a plugin adds to a scene: boxes, its entries of each mapped row's survey, and surfaces for goods.

    `sizes`: how large the rows are whose face the structure makes. `distractors`: boxes that look like the structure
    and are none; they are never labelled. `without`: what the simulator must leave out of the place, because it would
    be taken for the structure or hide it. `references` and `site_rows`, by row: what a user would know of the row
    without mapping it (references.json), and how the row's entry in the site file says that.
    """

    boxes: Sequence[Box]
    survey: Mapping[str, Mapping[str, Any]]
    supports: Sequence[Support] = ()
    sizes: Mapping[str, RowSize] = field(default_factory=dict)
    distractors: Sequence[Box] = ()
    without: frozenset[Distractor] = frozenset()
    references: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    site_rows: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class RandomSection:
    """What a random scene holds of a plugin's structure: the `section` that its `scene` hook takes.

    A structure that makes the rows' faces also gives these `rows`, with their `sizes`, and the `colors` that goods may
    share with it.
    """

    section: Mapping[str, Any]
    rows: Mapping[str, RowPlace] = field(default_factory=dict)
    sizes: Mapping[str, RowSize] = field(default_factory=dict)
    colors: Sequence[Rgb] = ()
