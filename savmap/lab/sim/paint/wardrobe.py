"""The textures that a block of made-up pictures shares, by kind."""

from collections.abc import Callable, Mapping, Sequence
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
