"""Random views of a scene, as training pictures show it.

World: x along the aisle, y up, z out of the first row's face. A view's frame is x right, y down, z forward.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from savmap.geometry.pinhole import intrinsics, rays_from_pixels, rig_from_view
from savmap.lab.sim.drive.cart import world_from_level
from savmap.lab.sim.scene.build import Built, face_size, mapped_rows, row_fronts
from savmap.types import Floats

Kind = Literal["row", "face", "close", "ceiling", "floor"]


@dataclass(frozen=True, eq=False)
class CameraSample:
    """A rectilinear camera in the world: `origin` (3,) m, `world_from_view` (3, 3), `hfov_deg` to the outer borders."""

    origin: Floats
    world_from_view: Floats
    hfov_deg: float


def view_rays(width: int, height: int, hfov_deg: float, offset: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """Unit rays (height, width, 3) in the view frame through the pixels' centres, moved by `offset` pixels."""
    u, v = np.meshgrid(np.arange(width) + offset[0], np.arange(height) + offset[1])
    return rays_from_pixels(np.stack([u, v], axis=-1).astype(np.float64), intrinsics(hfov_deg, width, height))


def sample_camera(built: Built, rng: np.random.Generator, kind: Kind = "row") -> CameraSample:
    """A random camera in the aisle between the mapped rows, as a panorama's row-facing or ceiling-facing views are.

    Views of the kind "face" look straight at it, and hold its height as mapping's views do; those of the kind
    "close" look at a part of it, 0.6 to 1.3 m away, often steeply, through an ordinary lens; those of the kind "floor"
    look down. Raises SceneError for a scene without a mapped row.
    """
    name = mapped_rows(built)[int(rng.integers(len(mapped_rows(built))))]
    frame, (length, top) = built.frames[name], face_size(built, name)
    aisle = built.aisle_z[1] - built.aisle_z[0]
    nearest, farthest = (0.6, 1.3) if kind == "close" else (0.8, max(0.9, min(3.0, aisle - 0.4)))
    away = float(rng.uniform(nearest, farthest))
    height = float(rng.uniform(1.0, max(1.1, min(4.5, top + 0.3, built.scene.hall.height - 0.8))))
    origin = frame.to_world(np.array([rng.uniform(-0.5, length + 0.5), height, away]))
    turn, hfov_deg = _turn(rng, kind) if kind != "face" else _fitted(rng, np.array([-height, top - height]) / away)
    return CameraSample(origin, world_from_level(-frame.world_from_row[:, 2]) @ turn, hfov_deg)


def sought_labels(built: Built, kind: Kind) -> set[str]:
    """The classes that views of a kind are for: luminous ones at the ceiling, those of the rows' faces, or what else is
    labelled."""
    faces = {front.label for name in built.frames for front in row_fronts(built, name)}
    if kind == "ceiling":
        return built.labels(luminous=True)
    return (built.labels(luminous=False) - faces or faces) if kind == "floor" else faces


def _turn(rng: np.random.Generator, kind: Kind) -> tuple[Floats, float]:
    """Rotation and field of view, degrees."""
    if kind == "close":
        yaw, pitch, roll = rng.uniform([-30, -50, -8], [30, 40, 8])
        return rig_from_view(float(yaw), float(pitch), float(roll)), float(rng.uniform(60, 100))
    if kind == "floor":
        yaw, pitch, roll = rng.uniform([-40, -90, -8], [40, -35, 8])
        return rig_from_view(float(yaw), float(pitch), float(roll)), float(rng.uniform(85, 120))
    if kind == "ceiling":
        about_up = rig_from_view(float(rng.uniform(-180, 180)), 0.0, 0.0)
        turn = rig_from_view(0.0, float(rng.uniform(60, 120)), float(rng.uniform(-180, 180)))
        return about_up @ turn, float(rng.uniform(80, 125))
    yaw = rng.uniform(-35, 35) if rng.random() < 0.85 else rng.choice([-1, 1]) * rng.uniform(35, 90)
    turn = rig_from_view(float(yaw), float(rng.uniform(-20, 20)), float(rng.uniform(-10, 10)))
    return turn, float(rng.uniform(80, 155))


def _fitted(rng: np.random.Generator, ends: Floats) -> tuple[Floats, float]:
    """Rotation and field of view, degrees, of a 4:3 view that holds a face between two elevations (2,), as tangents."""
    low, high = np.degrees(np.arctan(ends))
    tangent = np.tan(np.radians((high - low) / 2)) * float(rng.uniform(0.9, 1.3)) * 4 / 3
    hfov_deg = float(np.clip(np.degrees(2 * np.arctan(tangent)), 80, 155))
    yaw, pitch, roll = rng.normal(0, [3, 2, 2])
    return rig_from_view(float(yaw), float(low + high) / 2 + float(pitch), float(roll)), hfov_deg
