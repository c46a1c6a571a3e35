"""The textures that a block of made-up pictures shares, by kind; and crops of photographs, from any folder of
pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from savmap.lab.sim.paint.atlas import TILE, Atlas, Texture, atlas_of
from savmap.lab.sim.paint.noise import Random
from savmap.lab.sim.paint.stage import Rgb, Surface
from savmap.video.image_folder import SUFFIXES

_LEAST_PX = 64
Recipes = Mapping[str, tuple[int, Callable[[Random], Texture]]]
"""How many textures of each kind there are, and what makes one."""


@dataclass(frozen=True)
class Wardrobe:
    """An atlas, and which of its tiles are of which kind."""

    atlas: Atlas
    kinds: Mapping[str, tuple[int, ...]]

    def any(self, rng: Random, kind: str) -> int:
        """Some tile of a kind."""
        tiles = self.kinds[kind]
        return tiles[int(rng.integers(len(tiles)))]

    def surface(self, rng: Random, kind: str, tint: Rgb = (1.0, 1.0, 1.0), span: float = 0.0) -> Surface:
        """A surface of some tile of a kind; `span` metres a repetition both ways."""
        return Surface(self.any(rng, kind), tint, (span, span))

    def photographed(self, rng: Random, kind: str, tint: Rgb, span: float, share: float = 0.3) -> Surface:
        """As `surface`, but in a share of cases a crop of a photograph where there are some."""
        real = bool(self.kinds["photograph"]) and rng.random() < share
        return self.surface(rng, "photograph" if real else kind, tint, span)


def wardrobe_of(rng: Random, recipes: Recipes, photographs: Sequence[Texture] = ()) -> Wardrobe:
    """New textures of all kinds, and `photographs` beside them."""
    textures: list[Texture] = []
    kinds: dict[str, tuple[int, ...]] = {}
    for kind, (count, make) in recipes.items():
        kinds[kind] = tuple(range(len(textures), len(textures) + count))
        textures += [make(rng) for _ in range(count)]
    kinds["photograph"] = tuple(range(len(textures), len(textures) + len(photographs)))
    return Wardrobe(atlas_of([*textures, *photographs]), kinds)


def grey(rng: Random, low: float, high: float) -> Rgb:
    """A tint of one tone."""
    tone = float(rng.uniform(low, high))
    return tone, tone, tone


def crop(path: Path, rng: Random) -> Texture | None:
    """A square part of a picture, turned and mirrored at random; None where it cannot be read or is tiny."""
    data = np.frombuffer(path.read_bytes(), np.uint8)
    bgr = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if bgr is None or min(bgr.shape[:2]) < _LEAST_PX:
        return None
    side = int(rng.uniform(0.35, 1.0) * min(bgr.shape[:2]))
    top, left = (int(rng.integers(0, have - side + 1)) for have in bgr.shape[:2])
    part = cv2.resize(bgr[top : top + side, left : left + side], (TILE, TILE), interpolation=cv2.INTER_AREA)
    turned = np.rot90(part, int(rng.integers(4)))[:, :: int(rng.choice([-1, 1])), ::-1]
    texture: Texture = np.dstack([turned, np.full((TILE, TILE), 255, np.uint8)])
    return texture


def crops(folder: Path | None, count: int, rng: Random) -> list[Texture]:
    """Up to `count` crops of a folder's pictures, none without a folder."""
    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES) if folder else []
    if not paths:
        return []
    chosen = rng.choice(len(paths), count, replace=count > len(paths))
    textures = [crop(paths[index], rng) for index in chosen]
    return [texture for texture in textures if texture is not None]
