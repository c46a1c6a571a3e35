"""Upright posts on the floor: the simplest objects that a plugin can have built, for a plugin's `scene` hook to start
from."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field

from savmap.lab.scenes import FACES, Box, Material, RandomSection, Rgb, SceneParts, Site, Strict, validated


class Stand(Strict):
    """One post: where the middle of its front stands in the scene's frame, and how tall and how wide it is, m."""

    x: float
    z: float
    height: float = Field(default=2.5, gt=0.05)
    width: float = Field(default=0.08, gt=0.01)


class Posts(Strict):
    """The section of a scene file; the default colour is the magenta that a new plugin's network knows."""

    stands: tuple[Stand, ...]
    color: Rgb = (0.75, 0.01, 0.5)


def build_posts(section: Mapping[str, Any], site: Site, name: str, label: str) -> SceneParts:
    """A box for each post, whose faces have the class `label`, and, for each mapped row's survey, foot and top (n, 2,
    3) m of their fronts under `name`. Raises SceneError for a section that is not as above."""
    posts = validated(Posts, section, f"structures.{name}")
    fronts = np.array([[[stand.x, y, stand.z] for y in (0.0, stand.height)] for stand in posts.stands]).reshape(
        -1, 2, 3
    )
    mapped = {row: frame for row, frame in site.frames.items() if frame.mapped}
    survey = {row: {name: frame.to_row(fronts).round(9).tolist()} for row, frame in mapped.items()}
    return SceneParts([_box(stand, posts.color, label) for stand in posts.stands], survey)


def random_posts(rng: np.random.Generator, site: Site) -> RandomSection:
    """A section with posts of any size and colour in front of the mapped faces of a random place, to train a network
    on."""
    stands = []
    for frame in (frame for frame in site.frames.values() if frame.mapped):
        for x in rng.uniform(0.0, 9.0, int(rng.integers(1, 5))):
            at = frame.to_world(np.array([x, 0.0, rng.uniform(0.2, 0.8)]))
            height, width = rng.uniform(0.8, 3.5), rng.uniform(0.05, 0.2)
            stands.append({"x": float(at[0]), "z": float(at[2]), "height": float(height), "width": float(width)})
    return RandomSection({"stands": stands, "color": rng.uniform(0.02, 0.8, 3).tolist()})


def _box(stand: Stand, color: Rgb, label: str) -> Box:
    middle = np.array([stand.x, stand.height / 2, stand.z - stand.width / 2])
    size = np.array([stand.width, stand.height, stand.width])
    return Box(middle, size, Material(color), face_labels=dict.fromkeys(FACES, label))
