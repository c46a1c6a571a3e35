"""Lamps in the laboratory: for the simulator and for random places."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from savmap.lab.scenes import RandomSection, SceneParts, Site
from savmap.plugin.hookspecs import hookimpl
from savmap_lights.lab.scene import random_section, scene


class LightsLab:
    """Lines of lamps for the simulator, which light random places."""

    furnishes = True

    @hookimpl
    def scene(self, section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
        return scene(section, rng, site)

    @hookimpl
    def random_section(self, rng: np.random.Generator, site: Site, drawn: RandomSection | None) -> RandomSection | None:
        return random_section(rng, site, drawn)
