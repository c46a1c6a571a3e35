"""What stands in racks and halls: pallets, cartons, sacks, drums, crates, long things. Everything is background.

Frame of a load: it stands at x 0..width, y 0.., z -depth..0.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from savmap.lab.sim.paint.noise import Random
from savmap.lab.sim.paint.prints import vivid
from savmap.lab.sim.paint.stage import Rgb, Stage, Surface
from savmap.lab.sim.paint.wardrobe import Wardrobe, grey
from savmap_shelves.lab.painted.wardrobe import paint

Load = Callable[[Stage, Wardrobe, "Room"], None]


@dataclass(frozen=True)
class Room:
    """Space for a load: metres, and whether it is seen from near."""

    width: float
    height: float
    depth: float
    near: bool


def colour(rng: Random) -> Rgb:
    """A goods' tint, linear: white, black, brown and grey ones more often than vivid ones."""
    kind = rng.random()
    if kind < 0.35:
        return grey(rng, 0.01, 0.8)
    if kind < 0.55:
        tone = float(rng.uniform(0.1, 0.7))
        return tone, tone * float(rng.uniform(0.6, 0.9)), tone * float(rng.uniform(0.3, 0.75))
    if kind < 0.75:
        return paint(rng, str(rng.choice(["blue", "red", "yellow", "green", "orange", "sky", "navy"]))).tint
    red, green, blue = vivid(rng, 0.1, 0.5) if kind < 0.9 else vivid(rng, 0.4, 0.95)
    return red**2, green**2, blue**2


def muted(rng: Random) -> Rgb:
    """A wall's or floor's tint, linear: hardly coloured, rarely vivid."""
    red, green, blue = vivid(rng, 0.05, 0.35 if rng.random() < 0.85 else 1.0)
    return red**2, green**2, blue**2


def pallet(stage: Stage, wardrobe: Wardrobe, room: Room) -> float:
    """A pallet of boards or plastic; the height it lifts its load to."""
    rng = stage.rng
    height = float(rng.uniform(0.1, 0.16))
    kind, tint = ("crate", colour(rng)) if rng.random() < 0.15 else ("wood", _wooden(rng))
    surface = wardrobe.surface(rng, kind, tint, float(rng.uniform(0.6, 1.2)))
    board = float(rng.uniform(0.015, 0.028))
    w, d = room.width, room.depth
    if not room.near:
        stage.box((0, 0, -d), (w, height, 0), surface, shade=0.6)
        return height
    stage.box((0, height - board, -d), (w, height, 0), surface)
    style = rng.integers(3)
    if style < 2:
        stage.box((0, 0, -d), (w, board, 0), surface)
    if style == 2 or rng.random() < 0.3:
        stage.box((0, height - 2.3 * board, -d), (w, height - 1.2 * board, -0.01), surface, shade=0.9)
    for x in (0.0, w / 2 - 0.05, w - 0.1):
        stage.box((x, 0, -d), (x + 0.1, height - board, -0.004), surface, shade=0.85)
    return height


def _wooden(rng: Random) -> Rgb:
    tone = float(rng.uniform(0.25, 1.25))
    return tone, tone * float(rng.uniform(0.8, 1.0)), tone * float(rng.uniform(0.65, 1.0))


def cartons(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """A stack of cartons: identical or mixed, in columns of their own height."""
    rng = stage.rng
    across = int(rng.integers(1, 5)) if room.near else int(rng.integers(1, 3))
    up = max(1, round(room.height / float(rng.uniform(0.18, 0.5)))) if room.near else int(rng.integers(1, 4))
    up = min(up, 6)
    identical = rng.random() < 0.65
    surfaces = [_carton(rng, wardrobe) for _ in range(1 if identical else 4)]
    full = room.height * float(rng.uniform(0.45, 0.97))
    size = room.width / across, full / up
    gap = float(rng.uniform(0.001, 0.02))
    for column in range(across):
        tall = up if rng.random() < 0.8 else int(rng.integers(0, up + 1))
        for layer in range(tall):
            front, side, lid = surfaces[int(rng.integers(len(surfaces)))]
            back = float(rng.uniform(0, 0.03))
            low = (column * size[0] + gap, layer * size[1] + gap / 2, -room.depth)
            high = ((column + 1) * size[0] - gap, (layer + 1) * size[1] - gap / 2, -back)
            stage.box(low, high, front, side, lid, shade=float(rng.uniform(0.88, 1.0)))


def _carton(rng: Random, wardrobe: Wardrobe) -> tuple[Surface, Surface, Surface]:
    tone = float(np.clip(np.exp(rng.normal(-0.25, 0.3)), 0.3, 1.1))
    tint: Rgb = (tone, tone * float(rng.uniform(0.9, 1.02)), tone * float(rng.uniform(0.8, 1.02)))
    if rng.random() < 0.1:
        tint = colour(rng)
    front = wardrobe.surface(rng, "carton", tint, 0.0)
    side = front if rng.random() < 0.4 else wardrobe.surface(rng, "carton", tint)
    return front, side, wardrobe.surface(rng, "carton", tint)


def loose_cartons(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """Cartons of different sizes side by side, some turned, now and then two high."""
    rng, x = stage.rng, 0.0
    while x < room.width - 0.12:
        wide = min(float(rng.uniform(0.12, 0.6)), room.width - x)
        tall = min(float(rng.uniform(0.1, 0.6)), room.height * 0.95)
        deep = min(float(rng.uniform(0.2, 0.6)), room.depth)
        if rng.random() < 0.85:
            front, side, lid = _carton(rng, wardrobe)
            with stage.frame((x, 0, -float(rng.uniform(0, 0.12))), float(rng.normal(0, 4))):
                for layer in range(int(rng.integers(1, 3)) if 2 * tall < room.height else 1):
                    stage.box((0, layer * tall, -deep), (wide, (layer + 1) * tall - 0.004, 0), front, side, lid)
        x += wide + float(rng.exponential(0.03))


def wrapped(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """A stack in stretched film."""
    rng = stage.rng
    inner = Room(room.width, room.height, room.depth, room.near)
    (cartons if rng.random() < 0.6 else sacks if rng.random() < 0.5 else block)(stage, wardrobe, inner)
    if not room.near:
        return
    tall, opacity = room.height * float(rng.uniform(0.6, 0.97)), float(rng.uniform(0.4, 1.0))
    film = wardrobe.surface(rng, "film", grey(rng, 0.7, 1.1))
    z, w, d = 0.012, room.width + 0.01, room.depth
    stage.quad((-0.01, 0, z), (w + 0.01, 0, 0), (0, tall, 0), film, veil=opacity, two_sided=False)
    stage.quad((w, 0, z), (0, 0, -d), (0, tall, 0), film, veil=opacity, two_sided=False)
    stage.quad((-0.01, 0, -d), (0, 0, d + z), (0, tall, 0), film, veil=opacity, two_sided=False)


def block(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """One thing of some material: a machine, a bale, a covered load."""
    rng = stage.rng
    kind = str(rng.choice(["plain", "cloth", "paint", "carton", "ribbed", "zinc", "wood"]))
    front = wardrobe.surface(rng, kind, colour(rng), 0.0)
    top = float(rng.uniform(0.3, 0.95)) * room.height
    stage.box((0, 0, -room.depth), (room.width, top, -float(rng.uniform(0, 0.1))), front)


_ROUND = (
    (0.06, 0.0),
    (0.94, 0.0),
    (1.0, 0.15),
    (1.0, 0.8),
    (0.92, 0.97),
    (0.75, 1.0),
    (0.25, 1.0),
    (0.08, 0.97),
    (0, 0.8),
    (0, 0.15),
)


def sacks(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """Layers of filled sacks that bulge."""
    rng = stage.rng
    surface = wardrobe.surface(rng, "sack", colour(rng) if rng.random() < 0.6 else grey(rng, 0.4, 1), 0.0)
    thick = float(rng.uniform(0.1, 0.22))
    layers = max(1, min(9, int(room.height * float(rng.uniform(0.4, 0.95)) / thick)))
    across = max(1, round(room.width / float(rng.uniform(0.4, 0.8))))
    wide = room.width / across
    for layer in range(layers):
        for column in range(across):
            x, y = column * wide + float(rng.normal(0, 0.012)), layer * thick * 0.96
            z = float(rng.normal(0, 0.015))
            stage.box((x + 0.02, y, -room.depth), (x + wide - 0.02, y + thick * 0.97, z - 0.03), surface, shade=0.75)
            shade = float(rng.uniform(0.85, 1.0))
            stage.polygon((x - 0.01, y, z), (wide + 0.02, 0, 0), (0, thick * 1.08, -0.01), _ROUND, surface, shade=shade)


def big_bag(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """A bulk bag with loops."""
    rng = stage.rng
    surface = wardrobe.surface(rng, "sack", grey(rng, 0.5, 1.0))
    tall, w, d = room.height * float(rng.uniform(0.6, 0.9)), room.width, room.depth
    stage.box((0.04, 0, -d), (w - 0.04, tall, -0.05), surface, shade=0.85)
    stage.polygon((0, 0, 0), (w, 0, 0), (0, tall, -0.02), _ROUND, surface)


def drums(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """Drums or buckets side by side, one or more high."""
    rng = stage.rng
    radius = min(float(rng.uniform(0.1, 0.31)), room.width / 2, room.depth / 2)
    tall = min(radius * float(rng.uniform(1.7, 3.2)), room.height * 0.95)
    side = wardrobe.surface(rng, "barrel", colour(rng))
    lid = wardrobe.surface(rng, "plain", side.tint if rng.random() < 0.6 else colour(rng))
    across, behind = int(room.width / (2 * radius)), 2 if room.near and room.depth > 4 * radius else 1
    for layer in range(max(1, min(3, int(room.height / tall)))):
        for column in range(across):
            for line in range(behind):
                at = ((2 * column + 1) * radius * 1.01, layer * tall, -radius * (1 + 2 * line))
                stage.cylinder(at, radius, tall * 0.99, side, lid, 12 if room.near else 6)


def crates(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """Totes, crates or open bins in a grid, with rims."""
    rng = stage.rng
    wide, tall = float(rng.uniform(0.2, 0.65)), float(rng.uniform(0.1, 0.4))
    tall = min(tall, room.height * 0.95)
    tints = [colour(rng) for _ in range(int(rng.integers(1, 4)))]
    tile = wardrobe.any(rng, "crate")
    rim = float(rng.uniform(0.0, 0.02))
    for column in range(max(1, int(room.width / wide))):
        layers = int(rng.integers(0 if rng.random() < 0.3 else 1, max(2, int(room.height / tall) + 1)))
        for layer in range(min(layers, 6)):
            surface = Surface(tile, tints[int(rng.integers(len(tints)))])
            x, y = column * wide + 0.008, layer * tall
            z = -float(rng.uniform(0, 0.05))
            stage.box((x, y, -room.depth), (x + wide - 0.016, y + tall * 0.97, z), surface, shade=0.92)
            if rim and room.near:
                band = (x - 0.004, y + tall * 0.82, -room.depth), (x + wide - 0.012, y + tall * 0.95, z + rim)
                stage.box(*band, Surface(wardrobe.kinds["plain"][0], surface.tint))


def long_things(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """Pipes, planks or profiles that lie along the row: the worst of false beams."""
    rng = stage.rng
    size = float(rng.uniform(0.03, 0.16))
    round_ones = rng.random() < 0.5
    kind = str(rng.choice(["wood", "zinc", "plain", "paint", "carton"]))
    surface = wardrobe.surface(rng, kind, colour(rng) if kind != "wood" else _wooden(rng), 0.0)
    y = 0.0
    while y + size < room.height * float(rng.uniform(0.3, 0.9)) and y < 6 * size:
        for line in range(max(1, min(3, int(room.depth / size)))):
            start = float(rng.uniform(-0.15, 0.1))
            end = room.width - float(rng.uniform(-0.15, 0.1))
            z = -line * size * 1.02 + float(rng.normal(0, 0.01))
            if round_ones:
                stage.cylinder(
                    (start, y + size / 2, z - size / 2), size / 2, end - start, surface, surface, 8, lying=True
                )
            else:
                stage.box((start, y, z - size), (end, y + size * 0.97, z), surface)
        y += size


def rolls(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """Rolls whose ends are seen, or that stand."""
    rng = stage.rng
    radius = float(rng.uniform(0.06, 0.25))
    side, lid = wardrobe.surface(rng, "plain", colour(rng)), wardrobe.surface(rng, "cloth", colour(rng))
    for column in range(max(1, int(room.width / (2 * radius)))):
        if rng.random() < 0.85:
            x = (2 * column + 1) * radius
            if 2 * radius < room.height:
                with stage.frame((x, radius, 0.0), 90.0):
                    stage.cylinder((0, 0, 0), radius, room.depth * 0.9, side, lid, 12, lying=True)


def jumble(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """Small things of all kinds, side by side and on one another."""
    rng, x = stage.rng, 0.0
    size = float(rng.uniform(0.06, 0.25)) if room.near else 0.35
    kinds = ("carton", "plain", "crate", "cloth", "label", "poster", "sack", "paint")
    while x < room.width - 0.06:
        wide, y = size * float(rng.uniform(0.3, 1.6)), 0.0
        deep = min(room.depth, size * float(rng.uniform(1, 3)))
        for _ in range(int(rng.integers(1, 4))):
            tall = size * float(rng.uniform(0.2, 1.6))
            if y + tall > room.height:
                break
            item = wardrobe.surface(rng, str(rng.choice(kinds)), colour(rng), 0.0)
            z = -float(rng.uniform(0, 0.1))
            with stage.frame((x, y, z), float(rng.normal(0, 6)), 0.0, float(rng.normal(0, 1.5))):
                if rng.random() < 0.15:
                    radius = min(wide, deep) / 2
                    stage.cylinder((radius, 0, -radius), radius, tall, item, item, 8)
                else:
                    stage.box((0, 0, -deep), (wide, tall, 0), item)
            y += tall
        x += wide * float(rng.uniform(0.9, 1.4))


def bins(stage: Stage, wardrobe: Wardrobe, room: Room) -> None:
    """Open-fronted picking bins: a low front, slanting sides, dark within, things in them."""
    rng = stage.rng
    wide, tall = float(rng.uniform(0.1, 0.35)), float(rng.uniform(0.08, 0.25))
    tints = [colour(rng) for _ in range(int(rng.integers(1, 3)))]
    tile, label = wardrobe.kinds["plain"][0], wardrobe.surface(rng, "label")
    low, back = tall * float(rng.uniform(0.3, 0.6)), -min(0.35, room.depth)
    for layer in range(max(1, min(3, int(room.height / (tall * 1.05))))):
        tint, y = tints[int(rng.integers(len(tints)))], layer * tall * 1.05
        for column in range(max(1, int(room.width / wide))):
            x, surface = column * wide, Surface(tile, tint)
            stage.box((x + 0.004, y, -0.01), (x + wide - 0.004, y + low, 0), surface)
            stage.box((x + 0.004, y, back), (x + wide - 0.004, y + 0.6 * low, -0.02), surface, shade=0.4)
            stage.box((x + 0.004, y, back), (x + wide - 0.004, y + tall, back + 0.01), surface, shade=0.5)
            for side in (x + 0.004, x + wide - 0.004):
                slope = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.6, 1.0), (0.0, low / tall))
                stage.polygon((side, y, 0), (0, 0, back), (0, tall, 0), slope, surface, shade=0.8)
            if room.near and rng.random() < 0.6:
                at, size = (x + 0.25 * wide, y + 0.2 * low, 0.002), (0.5 * wide, 0.6 * low)
                stage.quad(at, (size[0], 0, 0), (0, size[1], 0), label, two_sided=False)


_PALLETED: tuple[tuple[Load, float], ...] = (
    (cartons, 0.4),
    (wrapped, 0.22),
    (sacks, 0.12),
    (drums, 0.08),
    (crates, 0.06),
    (block, 0.08),
    (big_bag, 0.04),
)
_LOOSE: tuple[tuple[Load, float], ...] = (
    (cartons, 0.2),
    (loose_cartons, 0.24),
    (jumble, 0.18),
    (bins, 0.1),
    (crates, 0.14),
    (drums, 0.08),
    (long_things, 0.08),
    (rolls, 0.06),
    (block, 0.05),
    (sacks, 0.05),
)


@dataclass(frozen=True)
class Storage:
    """What a row holds: its loads, on pallets or not, how full and how far out it is."""

    loads: tuple[Load, ...]
    on_pallets: bool
    density: float
    overhang: float
    rims: float


def random_storage(rng: Random, small: bool) -> Storage:
    """A row's goods: one kind, a few, or all."""
    on_pallets = rng.random() < (0.15 if small else 0.75)
    table = _PALLETED if on_pallets else _LOOSE
    weights = np.array([weight for _, weight in table])
    chosen = rng.choice(len(table), int(rng.integers(1, 5)), p=weights / weights.sum())
    density = 0.0 if rng.random() < 0.08 else float(rng.uniform(0.4, 1.5))
    overhang = float(rng.choice([-0.1, 0.0, rng.uniform(0, 0.15)]))
    return Storage(tuple(table[k][0] for k in chosen), on_pallets, density, overhang, float(rng.uniform(0, 0.06)))


def fill_opening(stage: Stage, wardrobe: Wardrobe, storage: Storage, left: float, bottom: float, room: Room) -> None:
    """Fills an opening of a rack: pallets side by side, or goods on the deck."""
    rng = stage.rng
    if rng.random() > storage.density:
        return
    if not storage.on_pallets or room.height < 0.5:
        load = storage.loads[int(rng.integers(len(storage.loads)))]
        with stage.frame((left + 0.02, bottom, storage.overhang - 0.05)):
            load(stage, wardrobe, Room(room.width - 0.04, room.height * 0.92, room.depth - 0.05, room.near))
        return
    count = max(1, int(room.width / float(rng.choice([0.85, 1.05, 1.25]))))
    pitch = room.width / count
    for index in range(count):
        if rng.random() > 0.4 + 0.6 * storage.density:
            continue
        wide = min(pitch - 0.05, 1.25) * float(rng.uniform(0.85, 1.0))
        x = left + index * pitch + (pitch - wide) / 2 + float(rng.normal(0, 0.02))
        with stage.frame((x, bottom, storage.overhang + float(rng.normal(0, 0.03))), float(rng.normal(0, 1.2))):
            palleted(stage, wardrobe, storage.loads, Room(wide, room.height * 0.93, room.depth, room.near))


def palleted(stage: Stage, wardrobe: Wardrobe, loads: tuple[Load, ...], room: Room) -> None:
    """A pallet with a load, or now and then empty ones piled up."""
    rng = stage.rng
    lift = pallet(stage, wardrobe, room)
    if rng.random() < 0.06:
        while lift + 0.2 < min(room.height, 1.2):
            with stage.frame((0, lift, float(rng.normal(0, 0.02)))):
                lift += pallet(stage, wardrobe, room)
        return
    if room.height - lift > 0.15:
        inset = float(rng.uniform(-0.01, 0.06))
        with stage.frame((inset, lift, -inset)):
            most = min(room.height - lift, float(rng.uniform(0.5, 1.9)))
            load = loads[int(rng.integers(len(loads)))]
            load(stage, wardrobe, Room(room.width - 2 * inset, most, room.depth - 2 * inset, room.near))
