"""Pillars for the simulator: magenta posts, with their survey."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field

from savmap.types import Floats
from savmap.types.scenes import FACES, Box, Material, RandomSection, Rgb, SceneParts, Site, Strict, validated


class Stand(Strict):
    """One pillar: where the middle of its front stands in the scene's frame, and how tall and how wide it is, m."""

    x: float
    z: float
    height: float = Field(default=2.5, gt=0.05)
    width: float = Field(default=0.08, gt=0.01)


class Pillars(Strict):
    """The section of a scene file."""

    stands: tuple[Stand, ...]
    color: Rgb = (0.75, 0.01, 0.5)


def scene(section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
    """A box for each pillar, and foot and top of its front in every mapped row's frame."""
    pillars = validated(Pillars, section, "structures.pillars")
    boxes = [_box(stand, pillars.color) for stand in pillars.stands]
    fronts = np.array([_front(stand) for stand in pillars.stands]).reshape(-1, 2, 3)
    survey = {
        name: {"pillars": frame.to_row(fronts).round(9).tolist()} for name, frame in site.frames.items() if frame.mapped
    }
    return SceneParts(boxes, survey)


def random_section(rng: np.random.Generator, site: Site, drawn: RandomSection | None) -> RandomSection | None:
    """Pillars of any size and colour in front of the mapped faces of a random place, to train a network on."""
    stands = []
    for frame in (frame for frame in site.frames.values() if frame.mapped):
        for x in rng.uniform(0.0, 9.0, int(rng.integers(1, 5))):
            at = frame.to_world(np.array([x, 0.0, rng.uniform(0.2, 0.8)]))
            height, width = rng.uniform(0.8, 3.5), rng.uniform(0.05, 0.2)
            stands.append({"x": float(at[0]), "z": float(at[2]), "height": float(height), "width": float(width)})
    return RandomSection({"stands": stands, "color": rng.uniform(0.02, 0.8, 3).tolist()})


def _box(stand: Stand, color: Rgb) -> Box:
    middle = np.array([stand.x, stand.height / 2, stand.z - stand.width / 2])
    size = np.array([stand.width, stand.height, stand.width])
    return Box(middle, size, Material(color), face_labels=dict.fromkeys(FACES, "pillar"))


def _front(stand: Stand) -> Floats:
    return np.array([[stand.x, 0.0, stand.z], [stand.x, stand.height, stand.z]])
