"""Pillars for the simulator, with their survey: magenta posts unless the scene file says otherwise."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from savmap.lab.sim.posts import build_posts, random_posts
from savmap.types.scenes import RandomSection, SceneParts, Site


def scene(section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
    """A box for each pillar (savmap.lab.sim.primitives has other shapes), and foot and top of its front in every mapped
    row."""
    return build_posts(section, site, "pillars", "pillar")


def random_section(rng: np.random.Generator, site: Site, drawn: RandomSection | None) -> RandomSection:
    """Pillars of any size and colour in front of the mapped faces of a random place, to train a network on."""
    return random_posts(rng, site)
