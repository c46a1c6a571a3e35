"""Where cameras are: random views for training, and the cart's drive for footage.

World: x along the aisle, y up, z out of the first row's face. A view's frame is x right, y down, z forward.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from savmap.geometry.pinhole import intrinsics, rays_from_pixels, rig_from_view
from savmap.sim.build import Built
from savmap.sim.course import course
from savmap.sim.primitives import Floats
from savmap.sim.scene import Cart, SceneError

Kind = Literal["shelf", "face", "ceiling", "floor"]

Front = tuple[str, tuple[float, float, float], tuple[float, float, float]]

_FRONT_M = 0.05
_STICKER_M = 0.005


@dataclass(frozen=True)
class CameraSample:
    """A rectilinear camera in the world: `origin` (3,) m, `world_from_view` (3, 3), `hfov_deg` to the outer borders."""

    origin: Floats
    world_from_view: Floats
    hfov_deg: float


def world_from_level(heading: Floats) -> Floats:
    """Rotation (3, 3) of a level camera looking along the horizontal unit vector `heading` (3,)."""
    down = np.array([0.0, -1.0, 0.0])
    return np.stack([np.cross(down, heading), down, heading], axis=1)


def view_rays(width: int, height: int, hfov_deg: float, offset: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """Unit rays (height, width, 3) in the view frame through the pixels' centres, moved by `offset` pixels."""
    u, v = np.meshgrid(np.arange(width) + offset[0], np.arange(height) + offset[1])
    return rays_from_pixels(np.stack([u, v], axis=-1).astype(np.float64), intrinsics(hfov_deg, width, height))


def sample_camera(built: Built, rng: np.random.Generator, kind: Kind = "shelf") -> CameraSample:
    """A random camera in the aisle between the mapped rows, as a panorama's shelf-facing or ceiling-facing views are.

    Views of the kind "face" look straight at it, and hold its height as mapping's views do; those of the kind "floor" look down. Raises SceneError for a scene without a mapped row.
    """
    name = mapped_rows(built)[int(rng.integers(len(mapped_rows(built))))]
    frame, (length, top) = built.frames[name], face_size(built, name)
    aisle = built.aisle_z[1] - built.aisle_z[0]
    away = float(rng.uniform(0.8, max(0.9, min(3.0, aisle - 0.4))))
    height = float(rng.uniform(1.0, max(1.1, min(4.5, top + 0.3, built.scene.hall.height - 0.8))))
    origin = frame.to_world(np.array([rng.uniform(-0.5, length + 0.5), height, away]))
    turn, hfov_deg = _turn(rng, kind) if kind != "face" else _fitted(rng, np.array([-height, top - height]) / away)
    return CameraSample(origin, world_from_level(-frame.world_from_row[:, 2]) @ turn, hfov_deg)


def mapped_rows(built: Built) -> list[str]:
    """The names of the rows with labelled fronts. Raises SceneError where there is none."""
    names = [name for name, frame in built.frames.items() if frame.mapped and row_fronts(built, name)]
    if not names:
        raise SceneError("the scene has no mapped row with labelled structures; see `rows` and `structures`")
    return names


def face_size(built: Built, name: str) -> tuple[float, float]:
    """How far the labelled fronts of a row reach along its x axis and up, in metres."""
    fronts = row_fronts(built, name)
    return max(high[0] for _, _, high in fronts), max(high[1] for _, _, high in fronts)


def row_fronts(built: Built, name: str) -> list[Front]:
    """The labelled structures of a row: label, and their lowest and highest corner (x, y, z) in the row's frame."""
    frame = built.frames[name]
    found: list[Front] = []
    for box in built.boxes:
        if set(box.face_labels) == {"+z"} and box.size[2] > _STICKER_M:
            center, half = frame.to_row(box.center), box.size / 2
            if abs(center[2] + half[2]) < _FRONT_M:
                found.append((box.face_labels["+z"], _corner(center - half), _corner(center + half)))
    return found


def _corner(point: Floats) -> tuple[float, float, float]:
    return float(point[0]), float(point[1]), float(point[2])


def _turn(rng: np.random.Generator, kind: Kind) -> tuple[Floats, float]:
    if kind == "floor":
        return _floor_turn(rng), float(rng.uniform(85, 120))
    turn, widest = (_ceiling_turn(rng), 125) if kind == "ceiling" else (_shelf_turn(rng), 155)
    return turn, float(rng.uniform(80, widest))


def _fitted(rng: np.random.Generator, ends: Floats) -> tuple[Floats, float]:
    """Rotation and field of view, degrees, of a 4:3 view that holds a face between two elevations (2,), as tangents."""
    low, high = np.degrees(np.arctan(ends))
    tangent = np.tan(np.radians((high - low) / 2)) * float(rng.uniform(0.9, 1.3)) * 4 / 3
    hfov_deg = float(np.clip(np.degrees(2 * np.arctan(tangent)), 80, 155))
    yaw, pitch, roll = rng.normal(0, [3, 2, 2])
    return rig_from_view(float(yaw), float(low + high) / 2 + float(pitch), float(roll)), hfov_deg


def _shelf_turn(rng: np.random.Generator) -> Floats:
    yaw = rng.uniform(-35, 35) if rng.random() < 0.85 else rng.choice([-1, 1]) * rng.uniform(35, 90)
    return rig_from_view(float(yaw), float(rng.uniform(-20, 20)), float(rng.uniform(-10, 10)))


def _floor_turn(rng: np.random.Generator) -> Floats:
    yaw, pitch, roll = rng.uniform([-40, -90, -8], [40, -35, 8])
    return rig_from_view(float(yaw), float(pitch), float(roll))


def _ceiling_turn(rng: np.random.Generator) -> Floats:
    about_up = rig_from_view(float(rng.uniform(-180, 180)), 0.0, 0.0)
    return about_up @ rig_from_view(0.0, float(rng.uniform(60, 120)), float(rng.uniform(-180, 180)))


@dataclass(frozen=True)
class Drive:
    """The cart's drive: `stamps_s` (n,), `origins` (n, 3) m and `world_from_rig` (n, 3, 3)."""

    stamps_s: Floats
    origins: Floats
    world_from_rig: Floats


def drive(cart: Cart, seed: int) -> Drive:
    """Poses of the panorama's rig along the drive. Without sway, weave, bounce and tilt it follows the line or path."""
    rng = np.random.default_rng([seed, 3])
    path = course(cart, rng)
    sway, yaw, bounce, pitch, roll = (_wander(path.share, rng) for _ in range(5))
    origins = np.stack([path.ground[:, 0], cart.height + cart.bounce * bounce, path.ground[:, 1]], axis=1)
    levels = [world_from_level(np.array([x, 0.0, z])) for x, z in path.facing]
    origins += cart.sway * sway[:, None] * np.stack([level[:, 0] for level in levels])
    mount = rig_from_view(cart.yaw, cart.pitch, cart.roll)
    angles = np.stack([cart.weave * yaw, cart.tilt * pitch, cart.tilt * roll], axis=1)
    turns = [rig_from_view(float(a), float(b), float(c)) @ mount for a, b, c in angles]
    return Drive(path.stamps_s, origins, np.stack([level @ turn for level, turn in zip(levels, turns, strict=True)]))


def _wander(share: Floats, rng: np.random.Generator) -> Floats:
    waves = rng.uniform([0.8, 2.0, 4.0], [1.6, 4.0, 9.0])
    phases = rng.uniform(0, 2 * np.pi, 3)
    weights = np.array([0.6, 0.3, 0.1])
    wave: Floats = (weights[:, None] * np.sin(2 * np.pi * waves[:, None] * share + phases[:, None])).sum(0)
    return wave if len(share) > 1 else np.zeros(1)
