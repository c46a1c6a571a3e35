"""What a scene is made of: boxes with a material, and which of their faces a network should learn to see."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Face = Literal["-x", "+x", "-y", "+y", "-z", "+z"]
FACES: tuple[Face, ...] = ("-x", "+x", "-y", "+y", "-z", "+z")


@dataclass(frozen=True)
class Material:
    """How a surface looks. Colours are linear RGB in 0..1; `texture` names a procedural pattern of the renderers.

    `emission` is the radiance in units of a white wall under the scene's mean light (0 for anything but lamps).
    `scale_m` is the size of the pattern's period, `contrast` 0..1 its strength, `seed` makes it this box's own.
    """

    color: tuple[float, float, float]
    texture: Literal["plain", "noise", "wood", "carton", "holes", "stripes", "wire", "scratches"] = "plain"
    second_color: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale_m: float = 0.05
    contrast: float = 0.3
    roughness: float = 0.5
    metallic: float = 0.0
    emission: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Box:
    """A box: `size` (3,) m along its own axes, `center` (3,) m, `rotation` (3, 3) world_from_box.

    World frame of a scene: x along the aisle, y up from the floor, z out of the first row's face (its face is z = 0).
    `face_labels` names the class that a segmentation network should give the pixels of a face (the others: background).
    `prints`: pictures (h, w, 3) uint8 sRGB that cover upright faces of it (x and z), the right way up as seen from outside.
    """

    center: Floats
    size: Floats
    material: Material
    rotation: Floats = field(default_factory=lambda: np.eye(3))
    face_labels: Mapping[Face, str] = field(default_factory=dict)
    prints: Mapping[Face, NDArray[np.uint8]] = field(default_factory=dict)
