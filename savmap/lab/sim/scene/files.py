"""Scene files: what a made-up place looks like and how a camera cart drives through it.

A scene is a YAML file, checked strictly: an unknown key is an error. Keys of a plugin's structure stand under
`structures: {plugin: ...}` and are checked by that plugin's `scene` hook. Lengths in metres, angles in degrees.
"""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, field_validator

from savmap.files import yaml_text
from savmap.files.atomic import reason
from savmap.files.texts import bounded_text
from savmap.lab.scenes import Exposure, Goods, Hall, RowFrame, RowPlace, SceneError, Strict, validated


class CartPath(Strict):
    """A drive through several aisles: past `points` (x, z), whose corners are rounded with `radius`.

    Speeds are m/s, `acceleration` m/s^2; `stops` are (metres along the path, seconds). Where the path turns back on
    itself the cart stops and goes on in reverse, without turning, until it does so again.
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

    `path` instead of them is a drive through several aisles: `frames` then follows from it. `speed_variation` 0..0.9 is
    the share by which the speed changes along the way. `yaw`, `pitch`, `roll` say how the camera is mounted: at zero
    its panorama's centre looks along the drive.
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


class Scene(Strict):
    """A whole scene file."""

    seed: int = 0
    hall: Hall = Hall()
    goods: Goods = Goods()
    look: Exposure = Exposure()
    cart: Cart = Cart()
    rows: dict[str, RowPlace] = Field(default_factory=lambda: {"A": RowPlace()})
    structures: dict[str, dict[str, Any]] = Field(default_factory=dict)
    mapped: tuple[str, ...] = ()


def row_frame(place: RowPlace) -> RowFrame:
    """The frame of a row from its place."""
    turn = np.eye(3) if place.facing == "+z" else np.diag([-1.0, 1.0, -1.0])
    return RowFrame(turn, np.array([place.x, 0.0, place.z]), place.mapped)


def load_scene(path: Path) -> Scene:
    """A scene from a YAML file. Raises SceneError with the file, the key and what is wrong with it."""
    try:
        content = yaml_text.load(bounded_text(path, yaml_text.MOST_MB))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read as a scene file: {reason(error)}") from error
    except yaml_text.YamlError as error:
        where = f"{path}:{error.line}" if error.line else str(path)
        raise SceneError(f"{where}: cannot be read as a scene file: {error}") from error
    except ValueError as error:
        raise SceneError(f"{path}: cannot be read as a scene file: it {error}") from error
    return parse_scene(content, str(path))


def parse_scene(content: object, source: str = "scene") -> Scene:
    """A scene from plain data. Raises SceneError naming `source`."""
    if not isinstance(content, dict):
        raise SceneError(f"{source}: a scene file holds keys such as `rows`, `structures` and `cart`")
    if _is_site(content):
        raise SceneError(
            f"{source}: is a site file, which `savmap map` takes; `savmap simulate` takes a scene (docs/simulator.md)"
        )
    return validated(Scene, content, source)


def _is_site(content: Mapping[Any, Any]) -> bool:
    rows = content.get("rows")
    sections = rows.values() if isinstance(rows, Mapping) else ()
    passes = any(isinstance(row, Mapping) and "passes" in row for row in sections)
    return passes or content.get("format") == "savmap-site"
