"""A rack as a scene file describes it, for the simulator; its frame is the row's: x along the aisle, y up, face z =
0."""

from typing import Literal

import numpy as np
from pydantic import Field

from savmap.lab.scenes import Rgb, Strict

Texture = Literal["plain", "noise", "wood", "carton", "holes", "stripes", "wire", "scratches"]


class Bay(Strict):
    """One section: clear `width` between its uprights, heights of its beams' bottom edges from the bottom up."""

    width: float = Field(gt=0.01)
    beams: tuple[float, ...] = ()
    beam_height: float | None = None
    empty: bool = False


class Rack(Strict):
    """A row's rack."""

    bays: tuple[Bay, ...] = Field(min_length=1)
    height: float | None = None
    depth: float = Field(default=1.1, gt=0.3)
    upright_width: float = Field(default=0.1, gt=0.02)
    upright_depth: float = Field(default=0.08, gt=0.02)
    beam_height: float = Field(default=0.1, gt=0.02)
    beam_thickness: float = Field(default=0.05, gt=0.005)
    setback: float = Field(default=0.005, ge=0)
    upright_color: Rgb = (0.03, 0.22, 0.09)
    upright_texture: Texture = "holes"
    hole_pitch: float = Field(default=0.05, gt=0.01)
    beam_color: Rgb = (0.35, 0.37, 0.4)
    beam_texture: Texture = "plain"
    deck: Literal["none", "steel", "wire", "wood"] = "steel"
    deck_color: Rgb = (0.3, 0.32, 0.35)
    rear_color: Rgb | None = None
    bracing: bool = True
    guards: float = Field(default=0.0, ge=0, le=1)
    labels: float = Field(default=0.3, ge=0, le=1)
    signs: float = Field(default=0.0, ge=0, le=1)
    metallic: float = Field(default=0.0, ge=0, le=1)
    roughness: float = Field(default=0.5, ge=0, le=1)


def upright_starts(rack: Rack) -> list[float]:
    """The left edges of a rack's uprights."""
    widths = [bay.width + rack.upright_width for bay in rack.bays]
    return [0.0, *(float(x) for x in np.cumsum(widths))]


def top_of(rack: Rack) -> float:
    """The height of a rack's uprights."""
    if rack.height is not None:
        return rack.height
    highest = max((bay.beams[-1] for bay in rack.bays if bay.beams), default=2.0)
    return highest + rack.beam_height + 0.15
