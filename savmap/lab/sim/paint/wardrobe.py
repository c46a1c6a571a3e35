"""The textures that a block of made-up pictures shares, by kind."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from savmap.lab.sim.paint.atlas import Atlas, Texture, atlas_of
from savmap.lab.sim.paint.noise import Random
from savmap.lab.sim.paint.stage import Rgb, Surface

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


def wardrobe_of(rng: Random, recipes: Recipes) -> Wardrobe:
    """New textures of all kinds."""
    textures: list[Texture] = []
    kinds: dict[str, tuple[int, ...]] = {}
    for kind, (count, make) in recipes.items():
        kinds[kind] = tuple(range(len(textures), len(textures) + count))
        textures += [make(rng) for _ in range(count)]
    return Wardrobe(atlas_of(textures), kinds)


def grey(rng: Random, low: float, high: float) -> Rgb:
    """A tint of one tone."""
    tone = float(rng.uniform(low, high))
    return tone, tone, tone
