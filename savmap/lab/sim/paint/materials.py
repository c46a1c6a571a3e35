"""Textures of materials: paint, metal, wood, stone, board, film. Values are roots of linear light."""

from collections.abc import Sequence

import cv2
import numpy as np

from savmap.lab.sim.paint.atlas import TILE, Texture
from savmap.lab.sim.paint.faces import Singles
from savmap.lab.sim.paint.noise import Random, cells, clouds, field, mixed, rgb_of, steps, streaks, texture
from savmap.lab.sim.paint.stage import Rgb

STEEL: Rgb = (0.62, 0.62, 0.63)
RUST: Rgb = (0.5, 0.3, 0.2)


def worn(rng: Random, wear: float) -> tuple[Singles, Singles]:
    """Paint (TILE, TILE, 3) and its tinted share: dirt, scratches and chips that show metal or rust."""
    base = 0.97 - 0.18 * wear * clouds(rng, 2) - 0.03 * field(rng, 128, 128)
    dirt = steps(clouds(rng, 3), 0.62 - 0.12 * wear, 0.2) * wear
    base = base * (1 - 0.35 * dirt)
    chips = steps(clouds(rng, 12, 4), 0.82 - 0.13 * wear, 0.04) * (rng.random() < 0.1 + 0.6 * wear)
    scratches = _scratches(rng, int(rng.integers(0, 3 + round(9 * wear)))) * np.float32(0.6)
    bare = np.clip(chips + scratches, 0, 1)
    tone = float(rng.uniform(0.35, 1.0))
    under = STEEL if rng.random() < 0.5 else RUST
    metal: Rgb = (under[0] * tone, under[1] * tone, under[2] * tone)
    return mixed(rgb_of(base.astype(np.float32)), metal, bare), (1 - bare).astype(np.float32)


def _scratches(rng: Random, count: int) -> Singles:
    lines = np.zeros((TILE, TILE), np.float32)
    for _ in range(count):
        start = rng.integers(0, TILE, 2)
        direction = rng.normal(0, 1, 2) * (40, 12)
        end = (start + direction).astype(int)
        cv2.line(lines, start.tolist(), end.tolist(), float(rng.uniform(0.3, 1)), int(rng.integers(1, 3)), cv2.LINE_AA)
    return lines


def galvanised(rng: Random, upright: bool = False) -> Singles:
    """Zinc (TILE, TILE, 3): spangle, brushed, or smooth with a sheen."""
    kind = rng.integers(3)
    if kind == 0:
        grey = 0.66 + 0.2 * (cells(rng, int(rng.integers(60, 260))) - 0.5) + 0.06 * field(rng, 64, 64)
    elif kind == 1:
        grey = 0.55 + 0.28 * streaks(rng, 0.8, not upright)
    else:
        grey = 0.6 + 0.25 * field(rng, 3, 3)
    grey = grey - 0.15 * rng.random() * steps(clouds(rng, 3), 0.6, 0.2)
    tone = 1 + rng.normal(0, 0.012, 3)
    return rgb_of(grey.astype(np.float32), (float(tone[0]), float(tone[1]), float(tone[2])))


def concrete(rng: Random) -> Texture:
    """A floor: stains, scuffs, now and then a joint."""
    grey = 0.62 + 0.25 * (clouds(rng, 2, 7, 0.65) - 0.5) - 0.25 * steps(clouds(rng, 2), 0.68, 0.15) * rng.random()
    for _ in range(int(rng.integers(0, 12))):
        start = rng.integers(0, TILE, 2)
        end = (start + rng.normal(0, 70, 2)).astype(int)
        tone = float(rng.uniform(0.35, 0.6))
        cv2.line(grey, start.tolist(), end.tolist(), tone, int(rng.integers(1, 4)), cv2.LINE_AA)
    if rng.random() < 0.4:
        grey[:2] *= 0.6
        grey[:, :2] *= 0.6
    return texture(grey.astype(np.float32))


def plaster(rng: Random) -> Texture:
    """A smooth wall."""
    return texture((0.9 + 0.12 * (clouds(rng, 2, 7) - 0.5)).astype(np.float32))


def tiles(rng: Random) -> Texture:
    """Tiles or bricks with joints."""
    rows = int(rng.integers(3, 13))
    columns = max(1, rows // int(rng.integers(1, 4)))
    tone = field(rng, columns, rows) if rows > 1 else np.zeros((TILE, TILE), np.float32)
    grey = 0.8 + 0.12 * (tone - 0.5) + 0.08 * field(rng, 100, 100)
    height, width = TILE // rows, TILE // columns
    joint = float(rng.uniform(0.5, 1.15))
    shifted = rng.random() < 0.6
    for row in range(rows + 1):
        grey[row * height : row * height + 2] *= joint
        for column in range(columns + 1):
            x = (column * width + (row % 2) * shifted * width // 2) % TILE
            grey[row * height : (row + 1) * height, x : x + 2] *= joint
    return texture(grey.astype(np.float32))


def ribbed(rng: Random, upright: bool = True) -> Texture:
    """Profiled sheet: ribs with a bright and a dark edge; or panels with seams."""
    count = int(rng.integers(1, 24))
    phase = np.arange(TILE) / TILE * count % 1
    share = rng.uniform(0.2, 0.7)
    soft = 0.5 * rng.random()
    profile = 0.85 - soft * 0.25 * (phase < share) - 0.3 * (np.abs(phase - share) < 0.06) + 0.1 * (phase > 0.94)
    grey = np.tile(profile.astype(np.float32), (TILE, 1)) + 0.06 * (clouds(rng, 3) - 0.5)
    return texture((grey if upright else grey.T).astype(np.float32))


def wood(rng: Random) -> Texture:
    """Sawn boards with level grain, knots and dirt."""
    grain = streaks(rng, 0.6) + 0.5 * (clouds(rng, 2, 4) - 0.5)
    base = 0.68 + 0.22 * (grain - 0.5) - 0.2 * rng.random() * steps(clouds(rng, 3), 0.62, 0.2)
    for _ in range(int(rng.integers(0, 5))):
        at = rng.integers(0, TILE, 2).tolist()
        cv2.ellipse(base, at, (int(rng.integers(3, 9)), 3), 0, 0, 360, 0.4, -1, cv2.LINE_AA)
    warm = float(rng.uniform(0.0, 1.0))
    colour = (1.08, 1.08 - 0.22 * warm, 1.08 - 0.48 * warm)
    return texture(rgb_of(base.astype(np.float32), colour))


def chipboard(rng: Random) -> Texture:
    """Pressed wood chips."""
    grey = 0.74 + 0.2 * (clouds(rng, 24, 4, 0.9) - 0.5) + 0.1 * (cells(rng, 300) - 0.5)
    return texture(rgb_of(grey.astype(np.float32), (1.0, 0.86, 0.66)))


def woven(rng: Random) -> Texture:
    """A filled sack's side: bulging, folded, with a weave."""
    y, x = np.mgrid[-1 : 1 : TILE * 1j, -1 : 1 : TILE * 1j].astype(np.float32)
    bulge = 1 - 0.45 * np.maximum(np.abs(x) ** 5, np.abs(y) ** 3)
    folds = 0.3 * (clouds(rng, 3, 3) - 0.5) + 0.05 * streaks(rng, 0.9, bool(rng.random() < 0.5))
    return texture(((0.92 + folds) * bulge).astype(np.float32))


def film(rng: Random) -> Texture:
    """Stretched film for a veil: bright folds, level or slanting; opacity in the last channel."""
    folds = streaks(rng, float(rng.uniform(0.3, 1.0))) + 0.7 * (clouds(rng, 3) - 0.5)
    turn = cv2.getRotationMatrix2D((TILE / 2, TILE / 2), float(rng.normal(0, 25)), 1.5)
    folds = cv2.warpAffine(folds, turn, (TILE, TILE), borderMode=cv2.BORDER_REFLECT)
    opacity = np.clip(0.12 + 1.1 * steps(folds.astype(np.float32), float(rng.uniform(0.6, 0.8)), 0.3), 0, 0.95)
    bright = 0.8 + 0.2 * field(rng, 20, 40)
    return texture(bright.astype(np.float32), opacity.astype(np.float32))


def shadow(rng: Random) -> Texture:
    """A soft dark blot for a veil."""
    y, x = np.mgrid[-1 : 1 : TILE * 1j, -1 : 1 : TILE * 1j].astype(np.float32)
    edge = float(rng.uniform(0.15, 0.6))
    opacity = steps(1 - np.maximum(np.abs(x), np.abs(y)), edge / 2, edge)
    return texture(np.zeros((TILE, TILE), np.float32), cv2.GaussianBlur(opacity, (0, 0), 8).astype(np.float32))


def shine(rng: Random) -> Texture:
    """A soft bright blot for a veil: a lamp in a glossy surface."""
    y, x = np.mgrid[-1 : 1 : TILE * 1j, -1 : 1 : TILE * 1j].astype(np.float32)
    reach = np.sqrt(x**2 + y**2) * (1.05 + 0.1 * (clouds(rng, 3) - 0.5))
    opacity = np.clip(1 - reach, 0, 1) ** np.float32(rng.uniform(1.0, 3.0))
    return texture(np.ones((TILE, TILE), np.float32), opacity.astype(np.float32))


def stripes(rng: Random, colours: Sequence[Rgb]) -> Texture:
    """Slanting bands in turn of colours."""
    y, x = np.mgrid[:TILE, :TILE]
    count = int(rng.integers(2, 6))
    slope = int(rng.choice([-1, 1]))
    band = ((x + slope * y) * count // TILE) % len(colours)
    worn_off = 1 - 0.5 * steps(clouds(rng, 4), 0.65, 0.1)
    return texture((np.array(colours, np.float32)[band] * worn_off[..., None]).astype(np.float32), 0.0)
