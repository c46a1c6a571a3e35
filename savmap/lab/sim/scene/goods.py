"""Goods for the simulator: cartons, pallets, bins, drums and wrapped stacks on the supports that plugins offer."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from savmap.lab.scenes import Box, Goods, Material, Rgb, RowFrame, Support, span
from savmap.types import Floats

_WOOD = Material((0.42, 0.28, 0.16), "wood", (0.22, 0.13, 0.07), 0.4, 0.7)
_PAPER = Material((0.8, 0.8, 0.78), "noise", (0.04, 0.04, 0.04), 0.04, 0.5)


def fill(supports: Sequence[Support], goods: Goods, rng: np.random.Generator) -> Iterator[tuple[Support, Box]]:
    """Boxes of goods on all supports, in the frames of their rows, each with its support. Identical goods: the same on
    every support of a height and width."""
    seed = int(rng.integers(1 << 30)) if goods.identical else 0
    for support in supports:
        support_rng = np.random.default_rng([seed, *_place(support)]) if goods.identical else rng
        density = goods.density * support_rng.uniform(0.4, 1.4)
        for box in _goods_on(support, goods, density, support_rng):
            yield support, box


def in_world(support: Support, box: Box) -> Box:
    """A box on a support in the world's frame."""
    frame = support.frame
    return replace(box, center=frame.to_world(box.center), rotation=frame.world_from_row @ box.rotation)


def extents(goods: Sequence[tuple[Support, Box]], frame: RowFrame) -> Floats:
    """Lowest and highest corners (n, 2, 3) m of the boxes on a row's supports, in the row's frame."""
    boxes = [box for support, box in goods if support.frame is frame]
    halves = [np.abs(box.rotation) @ box.size / 2 for box in boxes]
    corners = [(box.center - half, box.center + half) for box, half in zip(boxes, halves, strict=True)]
    return np.array(corners, np.float64).reshape(-1, 2, 3)


def _place(support: Support) -> tuple[int, int]:
    """Height and width, mm."""
    return round(1000 * support.y), round(1000 * (support.x[1] - support.x[0]))


def _goods_on(support: Support, goods: Goods, density: float, rng: np.random.Generator) -> Iterator[Box]:
    room = support.headroom - 0.12
    if room < 0.15:
        return
    x = support.x[0] + rng.uniform(0, 0.15)
    while x < support.x[1] - 0.2:
        width = float(min(rng.uniform(0.25, 1.25), support.x[1] - x))
        if rng.random() < density:
            yield from _item(support, goods, (x, x + width), room, rng)
        else:
            width *= float(rng.uniform(0.3, 1.0))
        x += width + float(rng.exponential(0.04)) + 0.005


def _item(
    support: Support, goods: Goods, x: tuple[float, float], room: float, rng: np.random.Generator
) -> Iterator[Box]:
    front = float(rng.uniform(-0.25, goods.overhang) if rng.random() < 0.7 else rng.uniform(-0.6, 0.0))
    back = float(max(front - rng.uniform(0.3, 1.0), support.z[0] + 0.02))
    if front - back < 0.1:
        return
    base = support.y + 0.001
    if x[1] - x[0] > 0.5 and room > 0.5 and rng.random() < goods.pallets:
        yield from _pallet(x, (back, front), base)
        base, room = base + 0.145, room - 0.145
    height = float(rng.uniform(0.25, 1.0)) * room
    if rng.random() < goods.wrap and height > 0.4:
        yield _wrapped(x, (base, base + height), (back, front), rng)
    elif x[1] - x[0] < 0.65 and rng.random() < 0.12:
        yield from _drum(x, (base, base + min(height, 0.9)), front, rng)
    else:
        yield from _stack(goods, x, (base, base + height), (back, front), rng)


def _pallet(x: tuple[float, float], z: tuple[float, float], y: float) -> Iterator[Box]:
    width = x[1] - x[0]
    yield span(x, (y + 0.1, y + 0.144), z, _WOOD)
    yield span(x, (y, y + 0.02), (z[1] - 0.1, z[1]), _WOOD)
    for share in (0.0, 0.45, 0.9):
        left = x[0] + share * width
        yield span((left, left + 0.1 * width), (y + 0.02, y + 0.1), (z[0], z[1] - 0.001), _WOOD)


def _color(goods: Goods, rng: np.random.Generator) -> Rgb:
    base = np.array(goods.colors[int(rng.integers(len(goods.colors)))])
    r, g, b = np.clip(base * rng.uniform(0.75, 1.25) * rng.uniform(0.95, 1.05, 3), 0.01, 0.9)
    return float(r), float(g), float(b)


def _carton(goods: Goods, rng: np.random.Generator) -> Material:
    color = _color(goods, rng)
    return Material(
        color,
        "carton" if rng.random() < 0.7 else "noise",
        (color[0] * 0.6, color[1] * 0.55, color[2] * 0.5),
        float(rng.uniform(0.3, 0.9)),
        float(rng.uniform(0.2, 0.9)),
        seed=int(rng.integers(1 << 30)),
    )


def _wrapped(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], rng: np.random.Generator) -> Box:
    grey = float(rng.uniform(0.35, 0.75))
    film = Material(
        (grey, grey, grey * 1.02), "scratches", (grey * 0.6,) * 3, 0.7, 0.6, 0.2, seed=int(rng.integers(1 << 30))
    )
    return _turned(span(x, y, z, film), rng, 2.0)


def _turned(box: Box, rng: np.random.Generator, sigma_deg: float) -> Box:
    angle = np.radians(rng.normal(0, sigma_deg))
    c, s = np.cos(angle), np.sin(angle)
    return replace(box, rotation=np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))


def _drum(x: tuple[float, float], y: tuple[float, float], front: float, rng: np.random.Generator) -> Iterator[Box]:
    diameter = x[1] - x[0]
    color = rng.choice([[0.03, 0.1, 0.35], [0.4, 0.4, 0.4], [0.45, 0.04, 0.03], [0.05, 0.05, 0.05]])
    paint = Material((float(color[0]), float(color[1]), float(color[2])), "scratches", contrast=0.2, roughness=0.3)
    side = diameter * 0.414
    for angle in np.radians([0.0, 45.0, 90.0, 135.0]):
        c, s = np.cos(angle), np.sin(angle)
        center = np.array([(x[0] + x[1]) / 2, (y[0] + y[1]) / 2, front - diameter / 2])
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        yield Box(center, np.array([side, y[1] - y[0] + 0.001 * angle, diameter]), paint, turn)


def _stack(
    goods: Goods, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], rng: np.random.Generator
) -> Iterator[Box]:
    layers = int(rng.integers(1, 4)) if y[1] - y[0] > 0.35 else 1
    columns = int(rng.integers(1, 4)) if x[1] - x[0] > 0.45 else 1
    heights = np.linspace(y[0], y[1], layers + 1)
    edges = np.linspace(x[0], x[1], columns + 1)
    shared = _carton(goods, rng)
    uneven = rng.random() < 0.4
    for layer in range(layers):
        for column in range(columns):
            if uneven and layer == layers - 1 and layers > 1 and rng.random() < 0.4:
                continue
            paint = replace(shared, seed=int(rng.integers(1 << 30))) if rng.random() < 0.7 else _carton(goods, rng)
            cell = (float(edges[column]) + 0.002, float(edges[column + 1]) - 0.002)
            z_front = z[1] - float(rng.exponential(0.02))
            carton = span(cell, (float(heights[layer]) + 0.001, float(heights[layer + 1])), (z[0], z_front), paint)
            carton = _turned(carton, rng, 1.0)
            yield carton
            if rng.random() < goods.labels:
                yield _label(carton, rng)


def _label(carton: Box, rng: np.random.Generator) -> Box:
    size = np.array([*(rng.uniform(0.2, 0.5, 2) * carton.size[:2]), 0.002])
    size[:2] = np.minimum(size[:2], [0.3, 0.2])
    offset = np.array([*(rng.uniform(-0.4, 0.4, 2) * (carton.size[:2] - size[:2])), carton.size[2] / 2 + 0.0015])
    center: Floats = carton.center + carton.rotation @ offset
    return Box(center, size, replace(_PAPER, seed=int(rng.integers(1 << 30))), carton.rotation)
