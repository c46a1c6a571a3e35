"""A rack as a scene file describes it, for the simulator; its frame is the row's: x along the aisle, y up, face z =
0."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from savmap.lab.scenes import Rgb, Strict
from savmap.types import Floats

Texture = Literal["plain", "noise", "wood", "carton", "holes", "stripes", "wire", "scratches"]


PERMILLE = 1000.0
PIECES = 12
"""Straight pieces that a bent member is built of."""


class Bay(Strict):
    """One section: clear `width` between its uprights, heights of its beams' bottom edges from the bottom up.

    `tilts` (mm in 1 m, positive where the right end is higher) and `sags` (m, of the middle below the line between the
    ends) are of the beams in this order; empty where all are straight and level.
    """

    width: float = Field(gt=0.01)
    beams: tuple[float, ...] = ()
    tilts: tuple[float, ...] = ()
    sags: tuple[float, ...] = ()
    beam_height: float | None = None
    empty: bool = False

    @model_validator(mode="after")
    def _one_each(self) -> "Bay":
        if any(len(values) not in (0, len(self.beams)) for values in (self.tilts, self.sags)):
            raise ValueError("`tilts` and `sags` have one value for each beam, or none")
        return self


class Rack(Strict):
    """A row's rack.

    `leans` (mm in 1 m, towards +x, about the foot) and `bows` (m towards +x, of the middle from the line between foot
    and top) are of the uprights from the left; empty where all are plumb and straight.
    """

    bays: tuple[Bay, ...] = Field(min_length=1)
    leans: tuple[float, ...] = ()
    bows: tuple[float, ...] = ()
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

    @model_validator(mode="after")
    def _one_each(self) -> "Rack":
        if any(len(values) not in (0, len(self.bays) + 1) for values in (self.leans, self.bows)):
            raise ValueError("`leans` and `bows` have one value for each upright, or none")
        return self


@dataclass(frozen=True, eq=False)
class Curve:
    """How far a member of a length (m) that begins at `start` (m) is off its straight line there: by `slope` times the
    way along it, and by `bow` (m) in its middle, as a parabola."""

    start: float
    length: float
    slope: float = 0.0
    bow: float = 0.0

    def at(self, along: float | Floats) -> Any:
        """m, at places along the member, m."""
        way = (along - self.start) / self.length
        return self.slope * (along - self.start) + 4 * self.bow * way * (1 - way)

    @property
    def is_straight(self) -> bool:
        """Whether it is off nowhere."""
        return not self.slope and not self.bow

    @property
    def mean(self) -> float:
        """m, over the member."""
        return self.slope * self.length / 2 + 2 / 3 * self.bow

    @property
    def pieces(self) -> Iterator[tuple[float, float]]:
        """Where straight pieces of the member begin and end, m: one where it is not bowed."""
        ends = np.linspace(self.start, self.start + self.length, (PIECES if self.bow else 1) + 1)
        yield from pairwise(ends.tolist())


def upright_curve(rack: Rack, number: int) -> Curve:
    """Of an upright (from 0), by height: towards +x."""
    lean, bow = (values[number] if values else 0.0 for values in (rack.leans, rack.bows))
    return Curve(0.0, top_of(rack), lean / PERMILLE, bow)


def beam_curve(rack: Rack, number: int, level: int) -> Curve:
    """Of a beam (bay and level from 0), by x, from its left end, where the uprights stand at its height, to its right
    one: upwards."""
    bay = rack.bays[number]
    tilt, sag = (values[level] if values else 0.0 for values in (bay.tilts, bay.sags))
    left, right = (upright_curve(rack, upright).at(bay.beams[level]) for upright in (number, number + 1))
    start = upright_starts(rack)[number] + rack.upright_width + left
    return Curve(start, bay.width + (right - left), tilt / PERMILLE, -sag)


def curves_of(rack: Rack) -> Iterator[Curve]:
    """Of all uprights and beams."""
    yield from (upright_curve(rack, number) for number in range(len(rack.bays) + 1))
    yield from (beam_curve(rack, n, level) for n, bay in enumerate(rack.bays) for level in range(len(bay.beams)))


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
