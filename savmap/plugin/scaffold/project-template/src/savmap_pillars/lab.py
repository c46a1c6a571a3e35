"""Pillars in the laboratory: posts for the simulator, magenta unless the scene says otherwise, with their survey."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from savmap.lab.scenes import RandomSection, SceneParts, Site
from savmap.lab.sim.posts import build_posts, random_posts
from savmap.plugin import hookimpl


class PillarsLab:
    """What only simulation and training ask."""

    @hookimpl
    def scene(self, section: Mapping[str, Any], site: Site) -> SceneParts:
        """A box for each pillar (savmap.lab.scenes says of what else a scene is made), and foot and top of its front in
        every mapped row."""
        return build_posts(section, site, "pillars", "pillar")

    @hookimpl
    def random_section(self, rng: np.random.Generator, site: Site) -> RandomSection:
        """Pillars of any size and colour before the mapped faces of a random place, to train a network on."""
        return random_posts(rng, site)
