"""The building of a made-up scene: floor, walls, ceiling, steelwork, pipes, daylight and clutter."""

from collections.abc import Iterator

import numpy as np

from savmap.lab.scenes import Box, Goods, Hall, Material, Rgb, span


def hall_boxes(hall: Hall, goods: Goods, rng: np.random.Generator) -> list[Box]:
    """Everything of the building, in the world."""
    parts = (_shell(hall, rng), _trusses(hall, rng), _purlins(hall), _pipes(hall, rng), _daylight(hall, rng))
    boxes = [box for part in parts for box in part]
    return boxes + list(_floor_items(hall, goods, rng))


def _dark(color: Rgb, share: float) -> Rgb:
    return color[0] * share, color[1] * share, color[2] * share


def _shell(hall: Hall, rng: np.random.Generator) -> Iterator[Box]:
    x, z, top = hall.x, hall.z, hall.height
    contrast = float(rng.uniform(0.1, 0.6))
    floor = Material(hall.floor_color, hall.floor_texture, _dark(hall.floor_color, 0.55), 3.0, contrast, roughness=0.4)
    wall = Material(
        hall.wall_color, "stripes" if rng.random() < 0.3 else "noise", _dark(hall.wall_color, 0.8), 1.5, 0.3
    )
    ceiling = Material(hall.ceiling_color, "noise", _dark(hall.ceiling_color, 0.7), 2.5, float(rng.uniform(0, 0.5)))
    yield span(x, (-0.2, 0.0), z, floor)
    yield span(x, (top, top + 0.2), z, ceiling)
    yield span((x[0] - 0.2, x[0]), (-0.2, top + 0.2), z, wall)
    yield span((x[1], x[1] + 0.2), (-0.2, top + 0.2), z, wall)
    yield span((x[0] - 0.2, x[1] + 0.2), (-0.2, top + 0.2), (z[0] - 0.2, z[0]), wall)
    yield span((x[0] - 0.2, x[1] + 0.2), (-0.2, top + 0.2), (z[1], z[1] + 0.2), wall)


def _trusses(hall: Hall, rng: np.random.Generator) -> Iterator[Box]:
    steel = Material(hall.steel_color, "noise", _dark(hall.steel_color, 0.6), 0.8, 0.3)
    if hall.truss == "none":
        return
    drop = min(float(rng.uniform(0.3, 0.6)), hall.height * 0.06)
    for x in np.arange(hall.x[0] + hall.truss_pitch * 0.4, hall.x[1], hall.truss_pitch):
        if hall.truss == "beams":
            yield span((x - 0.12, x + 0.12), (hall.height - drop, hall.height - 0.001), hall.z, steel)
        else:
            yield from _lattice(hall, float(x), drop, steel)


def _lattice(hall: Hall, x: float, drop: float, steel: Material) -> Iterator[Box]:
    bottom = hall.height - drop
    yield span((x - 0.05, x + 0.05), (bottom, bottom + 0.08), hall.z, steel)
    yield span((x - 0.05, x + 0.05), (hall.height - 0.08, hall.height - 0.001), hall.z, steel)
    for index, z in enumerate(np.arange(hall.z[0] + 0.5, hall.z[1] - 0.5, 1.0)):
        slope = np.arctan2(drop, 1.0) * (1 if index % 2 else -1)
        turn = np.array([[1, 0, 0], [0, np.cos(slope), -np.sin(slope)], [0, np.sin(slope), np.cos(slope)]])
        yield Box(np.array([x, hall.height - drop / 2, z]), np.array([0.04, 0.04, np.hypot(drop, 1.0)]), steel, turn)


def _purlins(hall: Hall) -> Iterator[Box]:
    if hall.purlin_pitch <= 0:
        return
    steel = Material(hall.steel_color)
    for z in np.arange(hall.z[0] + 0.3, hall.z[1], max(hall.purlin_pitch, 0.3)):
        yield span(hall.x, (hall.height - 0.14, hall.height - 0.002), (z - 0.04, z + 0.04), steel)


def _pipes(hall: Hall, rng: np.random.Generator) -> Iterator[Box]:
    for _ in range(hall.pipes):
        z, y = rng.uniform(*hall.z), hall.height - rng.uniform(0.05, 0.3)
        radius = rng.uniform(0.02, 0.12)
        color = rng.choice([[0.5, 0.04, 0.03], [0.55, 0.56, 0.58], [0.2, 0.2, 0.22], [0.7, 0.7, 0.68]])
        paint = Material((float(color[0]), float(color[1]), float(color[2])), roughness=0.3)
        yield span(hall.x, (y - radius, y + radius), (z - radius, z + radius), paint)


def _daylight(hall: Hall, rng: np.random.Generator) -> Iterator[Box]:
    sky = Material((0.85, 0.92, 1.0), emission=float(rng.uniform(0.8, 2.5)))
    for x in np.linspace(hall.x[0], hall.x[1], hall.skylights + 2)[1:-1]:
        z = rng.uniform(hall.z[0] + 1, hall.z[1] - 1)
        yield span((x - 0.5, x + 0.5), (hall.height - 0.004, hall.height - 0.0005), (z - 1.2, z + 1.2), sky)
    low = hall.height * 0.6
    for x in np.linspace(hall.x[0], hall.x[1], hall.windows + 2)[1:-1]:
        for side in (hall.z[0] + 0.002, hall.z[1] - 0.002):
            yield span((x - 1, x + 1), (low, low + 1.2), (side - 0.001, side + 0.001), sky)


def _floor_items(hall: Hall, goods: Goods, rng: np.random.Generator) -> Iterator[Box]:
    yellow = Material((0.7, 0.5, 0.03), "noise", (0.3, 0.25, 0.1), 0.6, 0.5)
    if hall.aisle_marking:
        for z in (0.25, 0.9):
            yield span((hall.x[0] + 1, hall.x[1] - 1), (0.0, 0.002), (z - 0.05, z + 0.05), yellow)
    wood = Material((0.42, 0.28, 0.16), "wood", (0.22, 0.13, 0.07), 0.4, 0.7)
    for _ in range(round(goods.debris * 20)):
        x, z = rng.uniform(*hall.x), rng.uniform(-1.0, 0.4)
        size = rng.uniform([0.2, 0.02, 0.05], [1.2, 0.14, 0.5])
        yield span((x, x + size[0]), (0.0, size[1]), (z, z + size[2]), wood)
