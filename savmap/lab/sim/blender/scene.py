"""A scene set up for the path tracer: its pictures as a camera delivers them, and their class masks.

Masks are cast by rays through the pixels' centres at the very triangles that are rendered.
"""

import importlib.util
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.errors import SavmapError
from savmap.lab.sim.blender.domain_randomization import domain_randomization
from savmap.lab.sim.blender.mesh import Mesh, Shader, join, meshes_by_shader
from savmap.lab.sim.blender.style import Lens, RenderStyle, Rng, area_lamps
from savmap.lab.sim.drive.views import CameraSample, Kind, sought_labels, view_rays
from savmap.lab.sim.render.raycast import TriangleCaster
from savmap.lab.sim.scene.build import Built
from savmap.types import Floats

IGNORED = 255
_TOO_FAR_M = 14.0
_FOCUS_M = 2.5

Image = NDArray[np.uint8]
Mask = NDArray[np.uint8]


class BlenderError(SavmapError):
    """The path tracer is an optional tool for training only."""


@dataclass(frozen=True)
class Quality:
    """The pictures' size in pixels, and the work that goes into them."""

    width: int = 640
    height: int = 480
    samples: int = 2
    threads: int = 2


class BlenderScene:
    """A scene set up in Blender, of which there can be one at a time. Raises BlenderError without the bpy wheel."""

    def __init__(self, built: Built, classes: Sequence[str], style: RenderStyle, rng: Rng, quality: Quality) -> None:
        if importlib.util.find_spec("bpy") is None:
            raise BlenderError("path-traced pictures need the bpy wheel: install the `blender` extra (Python 3.11)")
        from savmap.lab.sim.blender import cycles  # needs bpy

        self._built, self._classes = built, list(classes)
        self._style, self._quality, self._render = style, quality, cycles.render
        meshes = meshes_by_shader(domain_randomization(built.boxes, style.number, rng), classes)
        self._caster = MaskCaster(meshes, self._numbers(built.labels(luminous=True)))
        self._width = 4 * round(quality.width / style.lens.softness / 4)
        effort = cycles.Effort(
            self._width, self._width * quality.height // quality.width, quality.samples, threads=quality.threads
        )
        lamps = area_lamps(built.boxes, style.light.lamp_gain, style.light.lamp_color, rng)
        cycles.set_up(meshes, style, lamps, effort)

    def _numbers(self, labels: Collection[str]) -> list[int]:
        return [number for number, name in enumerate(self._classes, start=1) if name in labels]

    def sees(self, eye: CameraSample, kind: Kind) -> bool:
        """Whether a camera sees something of its kind and does not stand in or right at a box."""
        mask, distance = self._caster.cast(eye, 64, 48)
        sought = np.isin(mask, self._numbers(sought_labels(self._built, kind)))
        return bool(sought.mean() > 0.005 and (distance < 0.3).mean() < 0.05)

    def picture(self, eye: CameraSample, rng: Rng) -> tuple[Image, Mask]:
        """RGB (height, width, 3) and mask (height, width)."""
        size = self._quality.width, self._quality.height
        mask, _ = self._caster.cast(eye, *size)
        raw = self._render(eye, self._style.lens, self._width, _FOCUS_M, int(rng.integers(1 << 30)))
        return develop(raw, self._style.lens, size, rng), mask


class MaskCaster:
    """Casts masks of a scene. Wire decks are left out: the camera sees through them. Raises RayCasterMissingError
    without embreex."""

    def __init__(self, meshes: Mapping[Shader, Mesh], far_labels: Collection[int]) -> None:
        solid = join([mesh for name, mesh in meshes.items() if name != "wire"])
        self._labels = np.append(solid.labels, np.uint8(0))
        self._far_labels = sorted(far_labels)
        self._caster = TriangleCaster(solid.vertices[solid.triangles])

    def cast(self, eye: CameraSample, width: int, height: int) -> tuple[Mask, Floats]:
        """The mask (height, width) and the distances (m, inf for nothing). Fronts beyond 14 m are 255: not to be
        judged.

        `far_labels`, given to the caster, are the classes that count at any distance.
        """
        rays = (view_rays(width, height, eye.hfov_deg) @ eye.world_from_view.T).reshape(-1, 3)
        triangle, distance = self._caster.first(eye.origin, rays)
        labels = self._labels[triangle]
        labels[(labels > 0) & ~np.isin(labels, self._far_labels) & (distance > _TOO_FAR_M)] = IGNORED
        return labels.reshape(height, width), distance.reshape(height, width)


def _shade(width: int, height: int, strength: float) -> Floats:
    u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    shade: Floats = 1 - strength * (u**2 + v**2) / 2
    return shade[..., None]


def _grain(shape: tuple[int, int], strength: float, rng: Rng) -> Floats:
    """Noise in 0..255 units, partly the same in all channels, partly two pixels wide as after demosaicing."""
    fine = rng.normal(0, 1, (*shape, 3))
    coarse = cv2.resize(rng.normal(0, 1, ((shape[0] + 1) // 2, (shape[1] + 1) // 2, 3)), shape[::-1])
    grain: Floats = 14 * strength * (0.5 * fine + 0.5 * coarse + 0.5 * fine[..., :1])
    return grain


def _compressed(picture: Image, quality: int) -> Image:
    if not quality:
        return picture
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)


def develop(picture: Image, lens: Lens, size: tuple[int, int], rng: Rng) -> Image:
    """The picture as the camera delivers it, at `size` (width, height); pixel centres keep their directions."""
    width, height = size
    full = cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC).astype(np.float64)
    full = full * _shade(width, height, lens.vignette) * np.array(lens.tint)
    full += _grain((height, width), lens.noise, rng)
    return _compressed(np.clip(np.round(full), 0, 255).astype(np.uint8), lens.quality)
