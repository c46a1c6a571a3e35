"""Scene files: what a made-up place looks like and how a camera cart drives through it.

A scene is a YAML file, checked strictly: an unknown key is an error. Keys of a plugin's structure stand under
`structures: {plugin: ...}` and are checked by that plugin's `scene` function. Lengths in metres, angles in degrees.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, TypeVar

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from savmap.errors import SiteError
from savmap.files.atomic import reason
from savmap.sim.primitives import Box, Floats

Rgb = tuple[float, float, float]
Model = TypeVar("Model", bound=BaseModel)


class SceneError(SiteError):
    """A scene file that cannot be read or does not say what it should."""


class Strict(BaseModel):
    """A part of a scene file: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


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


class Look(Strict):
    """How the pictures are exposed: `exposure` 1 puts the mean of the scene at a mid grey."""

    exposure: float = Field(default=1.0, gt=0)
    ambient: float = Field(default=0.15, ge=0)
    light_color: Rgb = (1.0, 0.97, 0.92)
    contrast: float = Field(default=1.0, gt=0)
    white_balance: Rgb = (1.0, 1.0, 1.0)
    noise: float = Field(default=0.006, ge=0)
    texel: float = Field(default=0.25, gt=0.02)


class CartPath(Strict):
    """A drive through several aisles: past `points` (x, z), whose corners are rounded with `radius`.

    Speeds are m/s, `acceleration` m/s^2; `stops` are (metres along the path, seconds). Where the path turns back on itself
    the cart stops and goes on in reverse, without turning, until it does so again.
    """

    points: Annotated[tuple[tuple[float, float], ...], Field(min_length=2)]
    radius: float = Field(default=1.4, gt=0)
    speed: float = Field(default=1.0, gt=0, le=20)
    turn_speed: float = Field(default=0.6, gt=0, le=20)
    acceleration: float = Field(default=0.6, gt=0)
    stops: tuple[tuple[float, float], ...] = ()

    @field_validator("points")
    @classmethod
    def _apart(cls, points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        if any(np.hypot(b[0] - a[0], b[1] - a[1]) < 0.1 for a, b in pairwise(points)):
            raise ValueError("points of a path that follow one another are at least 0.1 m apart")
        return points


class Cart(Strict):
    """The camera's drive: from `start` to `end` (x, z), with sway (sideways, m), weave (yaw), bounce (m) and tilt.

    `path` instead of them is a drive through several aisles: `frames` then follows from it. `speed_variation` 0..0.9 is the share by which the speed changes along the way. `yaw`, `pitch`, `roll` say how the
    camera is mounted: at zero its panorama's centre looks along the drive.
    """

    start: tuple[float, float] = (-0.5, 1.3)
    end: tuple[float, float] = (14.5, 1.3)
    path: CartPath | None = None
    height: float = Field(default=3.0, gt=0)
    sway: float = Field(default=0.05, ge=0)
    weave: float = Field(default=2.0, ge=0)
    bounce: float = Field(default=0.008, ge=0)
    tilt: float = Field(default=0.6, ge=0)
    speed_variation: float = Field(default=0.25, ge=0, lt=0.95)
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    fps: float = Field(default=15.0, gt=0)
    frames: int = Field(default=100, ge=1)
    width: int = Field(default=2048, ge=64)

    @field_validator("width")
    @classmethod
    def _even_halves(cls, width: int) -> int:
        if width % 4:
            raise ValueError("the panorama's width must be a multiple of 4 (2:1 with even sides)")
        return width


class RowPlace(Strict):
    """Where a row's face stands: `x` and `z` of its own origin in the world, and the way it faces.

    A row facing "-z" has its own x axis along -x of the world. `mapped` rows border the camera's aisle: they are
    surveyed and their fronts carry labels.
    """

    x: float = 0.0
    z: float = 0.0
    facing: Literal["+z", "-z"] = "+z"
    mapped: bool = True


class Scene(Strict):
    """A whole scene file."""

    seed: int = 0
    hall: Hall = Hall()
    goods: Goods = Goods()
    look: Look = Look()
    cart: Cart = Cart()
    rows: dict[str, RowPlace] = Field(default_factory=lambda: {"A": RowPlace()})
    structures: dict[str, dict[str, Any]] = Field(default_factory=dict)


@dataclass(frozen=True)
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
class Site:
    """What a plugin's `scene` function may know of the place around its structure."""

    hall: Hall
    goods: Goods
    look: Look
    frames: Mapping[str, RowFrame]


@dataclass(frozen=True)
class Support:
    """A level surface that goods may stand on: in the frame of its row, x and z ranges, height y, free height above."""

    frame: RowFrame
    x: tuple[float, float]
    z: tuple[float, float]
    y: float
    headroom: float


@dataclass(frozen=True)
class SceneParts:
    """What a plugin adds to a scene: boxes, its entries of each mapped row's survey, and surfaces for goods."""

    boxes: Sequence[Box]
    survey: Mapping[str, Mapping[str, Any]]
    supports: Sequence[Support] = field(default_factory=tuple)


class SceneMaker(Protocol):
    """The signature of a plugin's `scene` function."""

    def __call__(self, section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts: ...


def row_frame(place: RowPlace) -> RowFrame:
    """The frame of a row from its place."""
    turn = np.eye(3) if place.facing == "+z" else np.diag([-1.0, 1.0, -1.0])
    return RowFrame(turn, np.array([place.x, 0.0, place.z]), place.mapped)


def load_scene(path: Path) -> Scene:
    """A scene from a YAML file. Raises SceneError with the file, the key and what is wrong with it."""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read as a scene file: {reason(error)}") from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise SceneError(f"{path}: cannot be read as a scene file: {' '.join(str(error).split())}") from error
    return parse_scene(content, str(path))


def parse_scene(content: object, source: str = "scene") -> Scene:
    """A scene from plain data. Raises SceneError naming `source`."""
    if not isinstance(content, dict):
        raise SceneError(f"{source}: a scene file holds keys such as `rows`, `structures` and `cart`")
    return validated(Scene, content, source)


def validated(model: type[Model], content: Mapping[str, Any], source: str) -> Model:
    """`content` as a `model`. Raises SceneError with one line a wrong key."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        wrong = "; ".join(f"{'.'.join(str(part) for part in e['loc'])}: {e['msg']}" for e in error.errors())
        raise SceneError(f"{source}: {wrong}") from error
