"""What is often taken for a rack and is none: people, trucks, ladders, partitions, conveyors, scaffolds. All
background.

Each is built in the present frame, standing on y = 0 about the origin.
"""

import math
from collections.abc import Callable

import numpy as np

from savmap.lab.sim.paint.stage import Stage
from savmap.lab.sim.paint.wardrobe import Wardrobe, grey
from savmap_shelves.lab.painted.goods import (
    Room,
    cartons,
    colour,
    crates,
    long_things,
    pallet,
    palleted,
    sacks,
    wrapped,
)
from savmap_shelves.lab.painted.wardrobe import paint

Thing = Callable[[Stage, Wardrobe], None]


def person(stage: Stage, wardrobe: Wardrobe) -> None:
    """Somebody standing: legs, a vest, arms, a head."""
    rng = stage.rng
    trousers = wardrobe.surface(rng, "cloth", colour(rng))
    vest = wardrobe.surface(rng, "cloth", paint(rng, str(rng.choice(["orange", "yellow", "navy", "white"]))).tint)
    tone = float(rng.uniform(0.1, 0.6))
    skin = wardrobe.surface(rng, "plain", (tone, tone * 0.7, tone * 0.5))
    hat = wardrobe.surface(rng, "plain", colour(rng))
    for x in (-0.1, 0.1):
        stage.cylinder((x, 0, float(rng.normal(0, 0.08))), 0.085, 0.85, trousers, trousers, 8)
        stage.cylinder((2.6 * x, 0.8, 0), 0.055, 0.62, vest if rng.random() < 0.5 else skin, skin, 6)
    stage.cylinder((0, 0.82, 0), 0.2, 0.62, vest, vest, 10)
    stage.cylinder((0, 1.44, 0), 0.06, 0.1, skin, skin, 6)
    stage.cylinder((0, 1.5, 0), 0.1, 0.17, skin, hat, 9)
    stage.cylinder((0, 1.65, 0), 0.11, 0.08, hat, hat, 9)


def truck(stage: Stage, wardrobe: Wardrobe) -> None:
    """A fork lift: body, roof on posts, a mast of channels, forks, perhaps a load."""
    rng = stage.rng
    body = wardrobe.surface(rng, "paint", paint(rng).tint, 1.0)
    dark = wardrobe.surface(rng, "plain", grey(rng, 0.01, 0.08))
    tall = float(rng.uniform(2.0, 4.5))
    stage.box((-0.55, 0.25, -1.2), (0.55, 1.0, 0.6), body)
    stage.box((-0.5, 1.0, -1.2), (0.5, 1.3, -0.7), body)
    for x in (-0.55, 0.47):
        for z in (-1.0, 0.5):
            stage.box((x, 1.0, z), (x + 0.08, 2.1, z + 0.08), dark)
        for z in (-0.8, 0.4):
            stage.box((x - 0.04, 0, z - 0.28), (x + 0.14, 0.56, z + 0.28), dark)
        stage.box((x * 0.7, 0.1, 0.62), (x * 0.7 + 0.1, tall, 0.78), dark)
        stage.box((x * 0.5, 0.1, 0.7), (x * 0.5 + 0.08, tall * 0.95, 0.82), body if rng.random() < 0.3 else dark)
        stage.box((x * 0.6, 0.1, 0.85), (x * 0.6 + 0.1, 0.15, 1.95), dark)
    stage.box((-0.55, 2.1, -1.1), (0.55, 2.16, 0.6), dark)
    for y in (0.3, 0.7, tall * 0.5, tall * 0.93):
        stage.box((-0.45, y, 0.78), (0.45, y + 0.1, 0.84), dark)
    if rng.random() < 0.5:
        with stage.frame((-0.55, 0.2, 1.95)):
            palleted(stage, wardrobe, (cartons, wrapped, sacks), Room(1.1, 1.5, 1.0, True))


def ladder(stage: Stage, wardrobe: Wardrobe) -> None:
    """A ladder that leans, or steps on wheels."""
    rng = stage.rng
    metal = wardrobe.surface(rng, str(rng.choice(["zinc", "paint"])), paint(rng).tint, 0.5)
    tall, wide = float(rng.uniform(1.8, 4.5)), float(rng.uniform(0.35, 0.7))
    with stage.frame((0, 0, 0), 0.0, -float(rng.uniform(5, 35))):
        for x in (0.0, wide):
            stage.box((x, 0, 0), (x + 0.05, tall, 0.07), metal)
        for y in np.arange(0.25, tall, 0.28):
            stage.box((0, y, 0.01), (wide, y + 0.035, float(rng.choice([0.05, 0.18]))), metal)


def conveyor(stage: Stage, wardrobe: Wardrobe) -> None:
    """Rollers between rails, on legs, with goods."""
    rng = stage.rng
    metal = wardrobe.surface(rng, "paint", paint(rng).tint, 1.0)
    zinc = wardrobe.surface(rng, "zinc", grey(rng, 0.4, 1.0), 0.5)
    length, y = float(rng.uniform(3, 9)), float(rng.uniform(0.3, 1.2))
    for z in (0.0, 0.6):
        stage.box((0, y, z), (length, y + 0.12, z + 0.04), metal)
    for x in np.arange(0.1, length, 0.25):
        stage.box((x, y + 0.04, 0.04), (x + 0.06, y + 0.1, 0.6), zinc)
    for x in np.arange(0.2, length, 1.5):
        for z in (0.0, 0.56):
            stage.box((x, 0, z), (x + 0.06, y, z + 0.06), metal)
    for x in np.arange(0.3, length - 0.6, float(rng.uniform(0.7, 3))):
        with stage.frame((x, y + 0.12, 0.5)):
            (cartons if rng.random() < 0.6 else crates)(stage, wardrobe, Room(0.5, 0.4, 0.4, True))


def partition(stage: Stage, wardrobe: Wardrobe) -> None:
    """A mesh fence or glazed wall between posts and rails."""
    rng = stage.rng
    frame = wardrobe.surface(rng, "paint", paint(rng).tint, 1.0)
    wide, tall, size = float(rng.uniform(0.9, 2.5)), float(rng.uniform(1.2, 3.2)), float(rng.uniform(0.03, 0.07))
    for k in range(int(rng.integers(2, 7))):
        x = k * wide
        stage.box((x, 0, 0), (x + size, tall, size), frame)
        for y in (0.1, tall / 2, tall - size)[:: int(rng.choice([1, 2]))]:
            stage.box((x, y, 0), (x + wide, y + size * 0.7, size * 0.7), frame)
        pitch = float(rng.uniform(0.05, 0.12))
        stage.quad((x, 0.1, 0.01), (wide, 0, 0), (0, tall - 0.1, 0), frame, mesh=(wide / pitch, tall / pitch, 0.12))


def handrail(stage: Stage, wardrobe: Wardrobe) -> None:
    """Rails on posts, barriers, bollards: striped or plain."""
    rng = stage.rng
    kind = str(rng.choice(["hazard", "paint", "zinc"]))
    metal = wardrobe.surface(rng, kind, paint(rng, "yellow").tint if kind == "paint" else (0.9, 0.9, 0.9), 0.6)
    size, tall, length = float(rng.uniform(0.04, 0.14)), float(rng.uniform(0.3, 1.2)), float(rng.uniform(1.5, 7))
    for x in np.arange(0, length + 0.1, float(rng.uniform(0.9, 2.0))):
        stage.box((x, 0, 0), (x + size, tall, size), metal)
    for y in (tall - size, tall / 2)[: int(rng.integers(1, 3))]:
        stage.box((0, y, 0), (length, y + size, size), metal)


def scaffold(stage: Stage, wardrobe: Wardrobe) -> None:
    """Tubes crossing: a scaffold, a trolley, a cage of bars."""
    rng = stage.rng
    tube = wardrobe.surface(rng, str(rng.choice(["zinc", "plain"])), paint(rng).tint)
    wide, tall, radius = float(rng.uniform(0.6, 2.5)), float(rng.uniform(0.9, 4.0)), float(rng.uniform(0.012, 0.03))
    for x in (0.0, wide):
        for z in (0.0, -0.8):
            stage.cylinder((x, 0, z), radius, tall, tube, tube, 6)
    for y in np.arange(0.2, tall, float(rng.uniform(0.25, 1.2))):
        for z in (0.0, -0.8):
            stage.cylinder((0, y, z), radius, wide, tube, tube, 6, lying=True)
    with stage.frame((0, 0.2, 0), 0.0, 0.0, math.degrees(math.atan2(tall - 0.4, wide))):
        stage.box((0, 0, 0), (math.hypot(wide, tall - 0.4), radius, radius), tube)


def table(stage: Stage, wardrobe: Wardrobe) -> None:
    """A bench with legs and drawers, and things on it."""
    rng = stage.rng
    top = wardrobe.surface(rng, "wood", grey(rng, 0.3, 1.0))
    legs = wardrobe.surface(rng, "paint", paint(rng).tint)
    wide = float(rng.uniform(1.0, 2.4))
    stage.box((0, 0.85, -0.7), (wide, 0.9, 0), top)
    for x in (0.0, wide - 0.06):
        stage.box((x, 0, -0.06), (x + 0.06, 0.85, 0), legs)
        stage.box((x, 0, -0.7), (x + 0.06, 0.85, -0.64), legs)
    stage.box((0.1, 0.7, -0.6), (wide - 0.1, 0.85, -0.02), legs)
    with stage.frame((0.1, 0.9, -0.05)):
        (cartons if rng.random() < 0.5 else crates)(stage, wardrobe, Room(wide - 0.2, 0.5, 0.5, True))


def stack(stage: Stage, wardrobe: Wardrobe) -> None:
    """Goods on the floor: pallets with loads, empty pallets, planks."""
    rng = stage.rng
    kind = rng.random()
    for k in range(int(rng.integers(1, 5))):
        with stage.frame((1.3 * k, 0, float(rng.normal(0, 0.1))), float(rng.normal(0, 6))):
            if kind < 0.6:
                palleted(
                    stage,
                    wardrobe,
                    (cartons, wrapped, sacks, crates),
                    Room(1.1, float(rng.uniform(0.8, 2.2)), 0.9, True),
                )
            elif kind < 0.8:
                height = 0.0
                for _ in range(int(rng.integers(2, 13))):
                    with stage.frame((0, height, float(rng.normal(0, 0.02)))):
                        height += pallet(stage, wardrobe, Room(1.15, 1.0, 0.9, True))
            else:
                long_things(stage, wardrobe, Room(float(rng.uniform(1, 4)), 1.2, 0.8, True))


def board(stage: Stage, wardrobe: Wardrobe) -> None:
    """A notice on legs, or a screen."""
    rng = stage.rng
    poster, leg = wardrobe.surface(rng, "poster"), wardrobe.surface(rng, "plain", grey(rng, 0.02, 0.5))
    wide, tall, low = float(rng.uniform(0.4, 2.0)), float(rng.uniform(0.4, 1.4)), float(rng.uniform(0.2, 1.4))
    stage.box((0, low, 0), (wide, low + tall, 0.04), poster, leg)
    for x in (0.05, wide - 0.1):
        stage.box((x, 0, -0.02), (x + 0.04, low, 0.03), leg)


THINGS: tuple[Thing, ...] = (
    person,
    person,
    truck,
    ladder,
    conveyor,
    partition,
    handrail,
    scaffold,
    table,
    stack,
    stack,
    board,
)
