"""The hall around: floor, walls, roof, lamps, columns, pipes; all background. World: y up, z = 0 the first row's
face."""

from dataclasses import dataclass

import numpy as np

from savmap.lab.sim.paint.faces import Lighting
from savmap.lab.sim.paint.noise import Random
from savmap.lab.sim.paint.stage import Rgb, Stage
from savmap.lab.sim.paint.wardrobe import Wardrobe, grey
from savmap.types import Floats
from savmap_shelves.lab.painted.goods import colour, muted
from savmap_shelves.lab.painted.wardrobe import paint


@dataclass(frozen=True)
class Hall:
    """Extents in metres."""

    left: float
    right: float
    back: float
    front: float
    height: float


def build_hall(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    """Floor with lines, walls with seams and openings, a roof with girders."""
    rng = stage.rng
    _floor(stage, wardrobe, hall)
    _walls(stage, wardrobe, hall)
    _roof(stage, wardrobe, hall)
    if rng.random() < 0.2:
        _columns(stage, wardrobe, hall)
    for _ in range(int(rng.integers(0, 5))):
        _pipe(stage, wardrobe, hall)


def _floor(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    rng = stage.rng
    tint = grey(rng, 0.12, 0.8) if rng.random() < 0.8 else muted(rng)
    surface = wardrobe.surface(rng, "floor", tint, float(rng.uniform(1.5, 5)))
    step = 4.0
    for x in np.arange(hall.left, hall.right, step):
        for z in np.arange(hall.back, hall.front, step):
            stage.quad((x, 0, z + step), (step, 0, 0), (0, 0, -step), surface, two_sided=False)
    line = wardrobe.surface(rng, "paint", paint(rng, str(rng.choice(["yellow", "white", "amber"]))).tint, 1.0)
    for _ in range(int(rng.integers(0, 4))):
        z, wide = float(rng.uniform(0.05, 3.0)), float(rng.uniform(0.05, 0.15))
        stage.quad((hall.left, 0.004, z + wide), (hall.right - hall.left, 0, 0), (0, 0, -wide), line, two_sided=False)
    if rng.random() < 0.3:
        x = float(rng.uniform(-5, 8))
        stage.quad((x, 0.004, hall.front), (0.1, 0, 0), (0, 0, hall.back - hall.front), line, two_sided=False)


def _walls(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    rng = stage.rng
    kind = str(rng.choice(["plaster", "tiles", "ribbed", "decking", "plaster"]))
    tint = grey(rng, 0.03, 0.6) if rng.random() < 0.65 else muted(rng)
    wall = wardrobe.surface(rng, kind, tint, float(rng.uniform(0.8, 5)))
    width, depth, height = hall.right - hall.left, hall.front - hall.back, hall.height
    sides = (
        ((hall.left, 0.0, hall.back), (1.0, 0.0), width),
        ((hall.left, 0.0, hall.front), (0.0, -1.0), depth),
        ((hall.right, 0.0, hall.back), (0.0, 1.0), depth),
        ((hall.right, 0.0, hall.front), (-1.0, 0.0), width),
    )
    for (x, y, z), (dx, dz), length in sides:
        count = max(1, int(length / 4))
        piece = length / count
        for k in range(count):
            at = (x + dx * piece * k, y, z + dz * piece * k)
            stage.quad(at, (dx * piece, 0, dz * piece), (0, height, 0), wall, two_sided=False)
            if rng.random() < 0.2:
                _opening(stage, wardrobe, at, (dx, dz), piece, height)


def _opening(
    stage: Stage,
    wardrobe: Wardrobe,
    at: tuple[float, float, float],
    along: tuple[float, float],
    piece: float,
    height: float,
) -> None:
    """A door, a window, a gate, a poster on a wall."""
    rng = stage.rng
    kind = rng.integers(4)
    wide = min(float(rng.uniform(0.8, 3.5)), piece * 0.9)
    low = 0.0 if kind in (0, 2) else float(rng.uniform(0.8, max(1.0, height - 2)))
    tall = float(rng.uniform(2.0, min(4.0, height))) if kind in (0, 2) else float(rng.uniform(0.4, 1.6))
    surface = {
        0: wardrobe.surface(rng, "paint", paint(rng).tint),
        1: wardrobe.surface(rng, "plain", grey(rng, 2.0, 9.0)),
        2: wardrobe.surface(rng, "decking", colour(rng)),
        3: wardrobe.surface(rng, "poster"),
    }[int(kind)]
    inward = (-along[1], along[0])
    start = (at[0] + 0.03 * inward[0], low, at[2] + 0.03 * inward[1])
    stage.quad(start, (along[0] * wide, 0, along[1] * wide), (0, tall, 0), surface)


def _roof(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    rng = stage.rng
    roof = wardrobe.surface(rng, str(rng.choice(["ribbed", "plaster", "decking"])), grey(rng, 0.05, 0.8), 2.0)
    step = 8.0
    for x in np.arange(hall.left, hall.right, step):
        for z in np.arange(hall.back, hall.front, step):
            stage.quad((x, hall.height, z), (step, 0, 0), (0, 0, step), roof)
    steel = wardrobe.surface(rng, str(rng.choice(["paint", "zinc", "plain"])), paint(rng).tint, 1.0)
    tall, thick = float(rng.uniform(0.15, 0.6)), float(rng.uniform(0.1, 0.25))
    pitch, under = float(rng.uniform(2.5, 7)), hall.height - float(rng.uniform(0, 0.6))
    lattice = rng.random() < 0.5
    if rng.random() < 0.8:
        for x in np.arange(hall.left + 1, hall.right, pitch):
            if lattice:
                _truss(stage, (float(x), under, hall.back), hall.front - hall.back, tall + 0.5, steel.tint, wardrobe)
            else:
                stage.box((x, under - tall, hall.back), (x + thick, under, hall.front), steel)
    if rng.random() < 0.6:
        for z in np.arange(hall.back + 0.7, hall.front, float(rng.uniform(1.2, 4))):
            stage.box((hall.left, under, z), (hall.right, under + 0.15, z + 0.08), steel, shade=0.8)


def _truss(
    stage: Stage, at: tuple[float, float, float], length: float, height: float, tint: Rgb, wardrobe: Wardrobe
) -> None:
    """A lattice girder along z."""
    steel = wardrobe.surface(stage.rng, "plain", tint)
    x, top, z = at
    for y in (top - 0.08, top - height):
        stage.box((x, y, z), (x + 0.08, y + 0.08, z + length), steel)
    run = height
    for k in range(min(40, int(length / run))):
        with stage.frame((x, top - height, z + k * run), 0.0, -45.0 if k % 2 else -135.0):
            stage.box((0, 0, 0), (0.05, 0.05, run * 1.41), steel)


def _columns(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    rng = stage.rng
    kind = str(rng.choice(["plaster", "paint", "floor", "hazard"]))
    surface = wardrobe.surface(rng, kind, paint(rng).tint if kind == "paint" else grey(rng, 0.2, 0.9), 1.0)
    size, z = float(rng.uniform(0.15, 0.6)), float(rng.uniform(0.3, 4.5))
    for x in np.arange(hall.left + 2, hall.right, float(rng.uniform(4, 9))):
        stage.box((x, 0, z), (x + size, hall.height, z + size), surface)


def _pipe(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> None:
    """A pipe, duct or cable tray under the roof or down a wall."""
    rng = stage.rng
    surface = wardrobe.surface(rng, str(rng.choice(["plain", "zinc", "paint"])), paint(rng).tint)
    y = hall.height - float(rng.uniform(0.3, 2.0))
    z = float(rng.uniform(hall.back + 0.3, 4.0))
    radius = float(rng.uniform(0.02, 0.2))
    if rng.random() < 0.4:
        stage.box((hall.left, y, z), (hall.right, y + radius, z + 3 * radius), surface)
    else:
        stage.cylinder((hall.left, y, z), radius, hall.right - hall.left, surface, surface, 7, lying=True)


def lamps(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> Floats:
    """Hangs lamps in lines; their places (L, 3), at most nine of them near the middle."""
    rng = stage.rng
    bright = wardrobe.surface(rng, "plain", grey(rng, 3.0, 20.0))
    y = hall.height - float(rng.uniform(0.1, 2.0))
    along = rng.random() < 0.6
    places = []
    for z in (float(rng.uniform(0.8, 3.5)), float(rng.uniform(-9, 8))):
        for x in np.arange(hall.left + 1, hall.right, float(rng.uniform(2, 7))):
            places.append((float(x), y, z))
            if rng.random() < 0.9:
                wide, deep = (1.3, 0.12) if along else (0.4, 0.4)
                stage.box((x, y, z), (x + wide, y + 0.07, z + deep), bright)
    chosen = rng.choice(len(places), min(len(places), 9), replace=False)
    return np.array([places[k] for k in sorted(chosen)]) - (0, 0.1, 0)


def reflections(stage: Stage, wardrobe: Wardrobe, places: Floats, eye: Floats) -> None:
    """Lamps that shine in the floor, where a mirror would show them."""
    rng = stage.rng
    strength = float(rng.uniform(0.1, 0.7))
    shine = wardrobe.surface(rng, "shine", grey(rng, 1.0, 4.0))
    for place in places:
        share = eye[1] / (eye[1] + place[1])
        away = place[[0, 2]] - eye[[0, 2]]
        length = float(np.linalg.norm(away))
        if length < 0.5:
            continue
        forth = away / length * float(rng.uniform(0.6, 3.0))
        across = np.array([-forth[1], forth[0]]) * 0.4
        x, z = eye[[0, 2]] + share * away - 0.5 * (forth + across)
        u, v = (float(across[0]), 0.0, float(across[1])), (float(forth[0]), 0.0, float(forth[1]))
        stage.quad((float(x), 0.008, float(z)), u, v, shine, veil=strength)


def lighting(rng: Random, places: Floats, height: float) -> Lighting:
    """Even light, lamps alone, or a dim hall with a lamp at the camera."""
    strength = float(rng.uniform(0.0, 2.5)) if rng.random() < 0.8 else float(rng.uniform(2.5, 8))
    power = strength * height * rng.uniform(0.2, 1.0, len(places))
    by_camera = float(rng.uniform(0.5, 6.0)) if rng.random() < 0.15 else 0.0
    return Lighting(places, power, float(rng.uniform(0.1, 0.6)), float(rng.uniform(0.2, 0.9)), by_camera)
