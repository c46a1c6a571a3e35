"""An endless variety of made-up places for training: building, goods and light, furnished by plugins, by a seed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from savmap.lab.plugins import LabPlugin, furnishing_plugins, lab_plugin
from savmap.lab.scenes import Exposure, Goods, Hall, RandomSection, Rgb, SceneError, Site
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import Scene, parse_scene, row_frame
from savmap.plugin.manager import installed, load_class

_PAINTS = np.array(
    [
        [0.02, 0.2, 0.08], [0.03, 0.28, 0.15], [0.02, 0.08, 0.3], [0.03, 0.15, 0.45], [0.35, 0.36, 0.38],
        [0.12, 0.13, 0.14], [0.6, 0.61, 0.6], [0.75, 0.74, 0.7], [0.8, 0.2, 0.02], [0.85, 0.3, 0.03],
        [0.5, 0.04, 0.03], [0.75, 0.5, 0.03], [0.55, 0.5, 0.4], [0.05, 0.05, 0.05], [0.2, 0.3, 0.35],
    ]
)  # fmt: skip
_CARTONS = [[0.48, 0.33, 0.2], [0.42, 0.28, 0.16], [0.55, 0.42, 0.28], [0.35, 0.24, 0.15]]
_BINS = [[0.6, 0.6, 0.6], [0.7, 0.7, 0.68], [0.03, 0.1, 0.4], [0.5, 0.05, 0.03], [0.04, 0.25, 0.08], [0.1, 0.1, 0.11]]


@dataclass(frozen=True, eq=False)
class FurnishedScene:
    """A random scene, what each plugin gave for it, and what a plugin may know of the place."""

    scene: Scene
    sections: Mapping[str, RandomSection]
    site: Site


def random_scene(seed: int, plugins: Sequence[str] = ()) -> Scene:
    """A place with rows on either side of an aisle; the same seed gives the same scene.

    It holds the structures of the plugins that furnish every place, and those of `plugins`, which change nothing else
    in it. Raises SceneError for a plugin that makes up none, or where no installed plugin furnishes places.
    """
    scene = furnished(seed).scene
    added = [name for name in plugins if name not in scene.structures]
    if not added:
        return scene
    site, sections = build(scene).site, {}
    for name in added:
        plugin, rng = lab_plugin(name), np.random.default_rng([seed, 79, *name.encode()])
        section = plugin.random_section(rng, site, None) if plugin is not None else None
        if section is None:
            raise SceneError(f"--plugin {name}: its `random_section` makes up nothing for a random place")
        sections[name] = section.section
    return scene.model_copy(update={"structures": {**scene.structures, **sections}})


def classes_of(scene: Scene) -> tuple[str, ...]:
    """The classes of a scene's structures: those of each installed plugin, in the order of the scene file."""
    available = installed()
    return tuple(dict.fromkeys(c for name in scene.structures if name in available for c in load_class(name).classes))


def furnished(seed: int) -> FurnishedScene:
    """A place with the structures of the plugins that furnish every place.

    First those that make the rows' faces are asked, of an empty aisle; then, with rows, hall and goods known, the
    others.
    """
    rng = np.random.default_rng([seed, 77])
    aisle = float(rng.uniform(1.8, 4.5))
    plugins = furnishing_plugins()
    empty = Site(Hall(), Goods(), Exposure(), {}, aisle=aisle)
    sections = dict(_answers(plugins, rng, empty))
    if not any(section.rows for section in sections.values()):
        raise SceneError("a random place needs a plugin that makes up rows (`random_section`); none is installed")
    rows = {name: place for section in sections.values() for name, place in section.rows.items()}
    sizes = {name: size for section in sections.values() for name, size in section.sizes.items()}
    tallest = max(size.height for size in sizes.values())
    content: dict[str, Any] = {
        "seed": seed,
        "hall": _hall(rng, tallest, aisle),
        "goods": _goods(rng, [color for section in sections.values() for color in section.colors]),
        "look": _look(rng),
        "cart": {"start": [0.5, aisle / 2], "end": [8.0, aisle / 2], "height": min(3.0, tallest)},
        "rows": {name: place.model_dump(mode="json") for name, place in rows.items()},
    }
    unfurnished = parse_scene(content, f"random scene {seed}")
    frames = {name: row_frame(place) for name, place in rows.items()}
    site = replace(
        empty, hall=unfurnished.hall, goods=unfurnished.goods, exposure=unfurnished.look, frames=frames, sizes=sizes
    )
    sections |= _answers([plugin for plugin in plugins if plugin.name not in sections], rng, site)
    structures = {name: dict(section.section) for name, section in sections.items()}
    return FurnishedScene(unfurnished.model_copy(update={"structures": structures}), sections, site)


def _answers(plugins: Sequence[LabPlugin], rng: np.random.Generator, site: Site) -> Iterator[tuple[str, RandomSection]]:
    for plugin in plugins:
        section = plugin.random_section(rng, site, None)
        if section is not None:
            yield plugin.name, section


def _chance(rng: np.random.Generator, share: float) -> bool:
    return bool(rng.random() < share)


def random_color(rng: np.random.Generator) -> list[float]:
    """A paint of industrial steel, or now and then any colour: linear RGB."""
    base = _PAINTS[int(rng.integers(len(_PAINTS)))]
    if _chance(rng, 0.15):
        base = rng.uniform(0.02, 0.8, 3)
    return [float(c) for c in np.clip(base * rng.uniform(0.7, 1.3) * rng.uniform(0.9, 1.1, 3), 0.01, 0.9)]


def _hall(rng: np.random.Generator, tallest: float, aisle: float) -> dict[str, Any]:
    grey = rng.uniform(0.1, 0.65)
    tint = rng.uniform(0.9, 1.1, (4, 3))
    levels = (grey, rng.uniform(0.15, 0.75), rng.uniform(0.05, 0.8), rng.uniform(0.05, 0.7))
    floor, wall, ceiling, steel = (
        np.clip(level * row, 0, 0.85).tolist() for level, row in zip(levels, tint, strict=True)
    )
    painted = {"floor_color": random_color(rng)} if _chance(rng, 0.15) else {"floor_color": floor}
    return {
        "x": [-float(rng.uniform(3, 15)), float(rng.uniform(16, 32))],
        "z": [-float(rng.uniform(5, 14)), aisle + float(rng.uniform(5, 14))],
        "height": tallest + float(rng.uniform(0.9, 3.5)),
        **painted,
        "floor_texture": str(rng.choice(["plain", "noise", "noise", "scratches"])),
        "wall_color": wall,
        "ceiling_color": ceiling,
        "steel_color": steel,
        "truss": str(rng.choice(["none", "beams", "beams", "lattice"])),
        "truss_pitch": float(rng.uniform(2.5, 6)),
        "purlin_pitch": float(rng.uniform(0.6, 2)) if _chance(rng, 0.35) else 0.0,
        "pipes": int(rng.integers(0, 5)),
        "skylights": int(rng.choice([0, 0, 0, 0, 2, 5])),
        "windows": int(rng.choice([0, 0, 3])),
        "aisle_marking": _chance(rng, 0.3),
    }


def _goods(rng: np.random.Generator, matching: Sequence[Rgb]) -> dict[str, Any]:
    colors = list(_CARTONS) + [color for color in _BINS if _chance(rng, 0.4)]
    if _chance(rng, 0.25):
        colors += [list(color) for color in matching]
    if _chance(rng, 0.15):
        colors = [random_color(rng) for _ in range(4)]
    return {
        "density": float(rng.uniform(0.2, 0.9)),
        "overhang": float(rng.choice([0.0, 0.04, 0.1, 0.2])),
        "pallets": float(rng.uniform(0, 0.9)),
        "wrap": float(rng.choice([0.0, 0.1, 0.4])),
        "labels": float(rng.uniform(0, 0.8)),
        "colors": colors,
        "debris": float(rng.choice([0.0, 0.1, 0.4])),
    }


def _look(rng: np.random.Generator) -> dict[str, Any]:
    warm = float(rng.uniform(-1, 1))
    return {
        "exposure": float(np.exp(rng.normal(0, 0.3))),
        "ambient": float(rng.uniform(0.03, 0.5)),
        "light_color": [1.0, 1.0 - 0.07 * abs(warm), 1.0 - 0.25 * warm if warm > 0 else 1.0],
        "contrast": float(rng.uniform(0.8, 1.3)),
        "white_balance": [float(c) for c in rng.uniform(0.92, 1.08, 3)],
        "noise": float(rng.uniform(0.0, 0.02)),
        "texel": float(rng.uniform(0.18, 0.4)),
    }
