"""What lamps hang among: a roof with skylights, girders, purlins, pipes and ducts; walls and racks at the picture's
rim. All background.

World: x along the aisle, y up, the camera at x = z = 0.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from savmap.lab.sim.paint import materials, prints
from savmap.lab.sim.paint.noise import Random, texture
from savmap.lab.sim.paint.stage import Rgb, Stage, Surface
from savmap.lab.sim.paint.wardrobe import Recipes, Wardrobe, grey

TEXTURES: Recipes = {
    "paint": (6, lambda rng: texture(*materials.worn(rng, float(rng.random())))),
    "zinc": (6, lambda rng: texture(materials.galvanised(rng), 1.0)),
    "plaster": (4, materials.plaster),
    "concrete": (4, materials.concrete),
    "ribbed": (8, materials.ribbed),
    "decking": (8, lambda rng: materials.ribbed(rng, upright=False)),
    "tiles": (4, materials.tiles),
    "wood": (3, materials.wood),
    "carton": (10, prints.carton),
    "plain": (1, lambda rng: texture(np.ones((256, 256), np.float32))),
}
_PIECE_M = 2.0
_NEAR_M, _NEAR_PIECE_M = 12.0, 1.0
"""Bars are lit piece by piece as far as this, so that lamps brighten them near by."""


@dataclass(frozen=True)
class Hall:
    """Metres: how far it reaches along and across, and its height; `under`: of the lowest girders."""

    along: float
    across: float
    height: float
    under: float


def tinted(rng: Random, low: float, high: float) -> Rgb:
    """A tint of nearly one tone, or, now and then, of some colour."""
    spread = 0.06 if rng.random() < 0.75 else 0.5
    red, green, blue = np.clip(np.array(grey(rng, low, high)) * np.exp(rng.normal(0, spread, 3)), 0.005, 0.95)
    return float(red), float(green), float(blue)


def build_hall(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    """The roof and what is below it."""
    _roof(stage, wardrobe, hall)
    _walls(stage, wardrobe, hall)
    for build, share in _PARTS.items():
        if stage.rng.random() < share:
            build(stage, wardrobe, hall)


def _bar(stage: Stage, length: float, y: tuple[float, float], z: tuple[float, float], surface: Surface) -> None:
    """A box along x of the present frame, `length` metres either way."""
    near = np.arange(-min(length, _NEAR_M), min(length, _NEAR_M) + 0.01, _NEAR_PIECE_M)
    for low, high in pairwise([-length, *near.tolist(), length]):
        stage.box((low, y[0], z[0]), (high, y[1], z[1]), surface)


def _roof(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    """A slab, sheets, panels or boards, in pieces, so that the light of lamps falls off along it."""
    rng = stage.rng
    kind = str(rng.choice(["plaster", "ribbed", "ribbed", "decking", "decking", "tiles", "wood", "concrete"]))
    surface = wardrobe.surface(rng, kind, tinted(rng, 0.04, 0.92), float(rng.uniform(0.6, 4.0)))
    for x in np.arange(-hall.along, hall.along, _PIECE_M):
        for z in np.arange(-hall.across, hall.across, _PIECE_M):
            stage.quad((x, hall.height, z), (_PIECE_M, 0, 0), (0, 0, _PIECE_M), surface)


def _walls(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    rng = stage.rng
    surface = wardrobe.surface(rng, str(rng.choice(["plaster", "ribbed", "tiles"])), tinted(rng, 0.05, 0.8), 2.0)
    along, across, high = 2 * hall.along, 2 * hall.across, (0.0, hall.height, 0.0)
    for z in (-hall.across, hall.across):
        stage.quad((-hall.along, 0, z), (along, 0, 0), high, surface)
    for x in (-hall.along, hall.along):
        stage.quad((x, 0, -hall.across), (0, 0, across), high, surface)
    if rng.random() < 0.25:
        _windows(stage, wardrobe, hall)


def _windows(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    """A band of windows under the roof."""
    rng = stage.rng
    glass = wardrobe.surface(rng, "plain", grey(rng, 3.0, 14.0))
    tall, wide = float(rng.uniform(0.5, 1.5)), float(rng.uniform(0.8, 3.0))
    low = hall.height - tall - float(rng.uniform(0.1, 1.0))
    for x in np.arange(-hall.along + 1, hall.along, wide + float(rng.uniform(0.1, 2.0))):
        stage.quad((x, low, -hall.across + 0.02), (wide, 0, 0), (0, tall, 0), glass)


def _skylights(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    """Bright fields in the roof: strips of translucent sheet, domes, or small ones that look like lamps."""
    rng = stage.rng
    glass = wardrobe.surface(rng, str(rng.choice(["plain", "decking", "ribbed"])), grey(rng, 1.5, 12.0), 1.0)
    long, wide = float(rng.uniform(0.8, 8.0)), float(rng.uniform(0.5, 2.0))
    if rng.random() < 0.3:
        long, wide = float(rng.uniform(0.3, 1.5)), float(rng.uniform(0.15, 0.6))
    pitch_x, pitch_z = long + float(rng.uniform(0.5, 8.0)), wide + float(rng.uniform(1.0, 8.0))
    across = rng.random() < 0.4
    first = float(rng.uniform(-pitch_x, 0))
    for x in np.arange(first - 2 * pitch_x, hall.along - long, pitch_x):
        for z in np.arange(-hall.across + float(rng.uniform(0, pitch_z)), hall.across - long, pitch_z):
            along, sideways = ((0, 0, long), (wide, 0, 0)) if across else ((long, 0, 0), (0, 0, wide))
            stage.quad((x, hall.height - 0.02, z), along, sideways, glass)


def _steel(stage: Stage, wardrobe: Wardrobe) -> Surface:
    rng = stage.rng
    kind = str(rng.choice(["paint", "zinc", "plain", "wood", "concrete"], p=[0.35, 0.2, 0.25, 0.1, 0.1]))
    return wardrobe.surface(rng, kind, tinted(rng, 0.03, 0.85), 1.0)


def _girders(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    """Beams or trusses, across the aisle or along it."""
    rng = stage.rng
    steel = _steel(stage, wardrobe)
    tall, thick = float(rng.uniform(0.12, 0.9)), float(rng.uniform(0.06, 0.4))
    pitch, lattice, along = float(rng.uniform(1.5, 7.0)), rng.random() < 0.4, rng.random() < 0.25
    reach, length = (hall.across, hall.along) if along else (hall.along, hall.across)
    for at in np.arange(-reach + float(rng.uniform(0, pitch)), reach, pitch):
        with stage.frame((0.0, 0.0, float(at)) if along else (float(at), 0.0, 0.0), 0.0 if along else 90.0):
            if lattice:
                _truss(stage, steel, hall, length, thick / 2, tall + 0.3)
            else:
                _bar(stage, length, (hall.under, hall.under + tall), (0.0, thick), steel)


def _truss(stage: Stage, steel: Surface, hall: Hall, length: float, thick: float, tall: float) -> None:
    """A lattice along x of the present frame."""
    for y in (hall.under, hall.under + tall):
        _bar(stage, length, (y, y + thick), (0.0, thick), steel)
    count = min(60, int(2 * length / tall))
    for k in range(count):
        with stage.frame((-length + k * tall, hall.under, thick / 3), 0.0, 0.0, 45.0 if k % 2 else -45.0):
            low, high = ((0.0, 0.0, 0.0), (1.41 * tall, thick / 2, thick / 2))
            stage.box(low, high, steel)


def _purlins(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    rng = stage.rng
    steel = _steel(stage, wardrobe)
    wide, pitch = float(rng.uniform(0.03, 0.15)), float(rng.uniform(0.6, 3.0))
    tall, across = float(rng.uniform(0.05, 0.25)), rng.random() < 0.3
    reach, length = (hall.along, hall.across) if across else (hall.across, hall.along)
    for at in np.arange(-reach + float(rng.uniform(0, pitch)), reach, pitch):
        with stage.frame((float(at), 0.0, 0.0) if across else (0.0, 0.0, float(at)), 90.0 if across else 0.0):
            _bar(stage, length, (hall.height - tall, hall.height), (0.0, wide), steel)


def _pipes(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    """Pipes, trays and ducts, mostly above or beside the lamps, some below; sprinklers hang from some."""
    rng = stage.rng
    for _ in range(int(rng.integers(1, 5))):
        surface, radius = _steel(stage, wardrobe), float(rng.uniform(0.015, 0.12))
        y = hall.height - float(rng.uniform(0.1, max(0.2, min(2.0, hall.height - 2.8))))
        along = rng.random() < 0.55
        at, length = float(rng.uniform(-3, 3)), hall.along if along else hall.across
        with stage.frame((0.0, y, at) if along else (at, y, 0.0), 0.0 if along else 90.0):
            if rng.random() < 0.4:
                wide = float(rng.uniform(0.1, 0.8))
                _bar(stage, length, (0.0, radius + 0.03), (-wide / 2, wide / 2), surface)
            else:
                stage.cylinder((-length, 0.0, 0.0), radius, 2 * length, surface, surface, 7, lying=True)
                if rng.random() < 0.4:
                    for x in np.arange(-length, length, 2.5):
                        stage.box((x, -0.12, -0.015), (x + 0.03, 0.0, 0.015), surface)


def _racks(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    """The tops of rows of racks on either side of the aisle, with goods that are bright at times."""
    rng = stage.rng
    half, top = float(rng.uniform(0.8, 1.8)), min(float(rng.uniform(2.5, 8.0)), hall.under - 0.3)
    steel, beams = _steel(stage, wardrobe), _steel(stage, wardrobe)
    tall = float(rng.choice([0.02, 0.05, 0.11]))
    for side in (-1, 1):
        with stage.frame((0.0, 0.0, 0.0), 0.0 if side < 0 else 180.0):
            for x in np.arange(-hall.along, hall.along, 2.7):
                stage.box((x, 0.0, -half - 0.1), (x + 0.09, top, -half), steel)
                goods = wardrobe.surface(rng, "carton" if rng.random() < 0.7 else "plain", tinted(rng, 0.1, 0.9))
                stage.box(
                    (x + 0.2, 0.0, -half - 1.1), (x + 2.5, top - float(rng.uniform(0.0, 2.0)), -half - 0.05), goods
                )
            for y in np.arange(top - 0.2, 1.0, -1.6):
                _bar(stage, hall.along, (y, y + tall), (-half - 0.06, -half), beams)


def _placards(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    """White boards that hang over the aisle: bright, and no lamps."""
    rng = stage.rng
    white = wardrobe.surface(rng, "plain", tinted(rng, 0.6, 0.95))
    y = hall.under - float(rng.uniform(0.1, 0.8))
    for x in np.arange(-hall.along + float(rng.uniform(0, 6)), hall.along, float(rng.uniform(4, 12))):
        wide = float(rng.uniform(0.3, 1.2))
        stage.box((x, y - 0.4, -wide / 2), (x + 0.02, y, wide / 2), white)


_Builder = Callable[[Stage, Wardrobe, Hall], None]
_PARTS: Mapping[_Builder, float] = {
    _skylights: 0.3,
    _girders: 0.7,
    _purlins: 0.5,
    _pipes: 0.6,
    _racks: 0.7,
    _placards: 0.1,
}
"""What a hall may have, and how often."""
