"""Signs in the laboratory: plates for the simulator and for random places."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from savmap.lab.scenes import RandomSection, SceneParts, Site
from savmap.plugin.hookspecs import hookimpl
from savmap_signs.lab.random_plates import random_section
from savmap_signs.lab.scene import scene


class SignsLab:
    """Plates for the simulator; in random places only where they are asked for by name."""

    @hookimpl
    def scene(self, section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
        return scene(section, rng, site)

    @hookimpl
    def random_section(self, rng: np.random.Generator, site: Site, drawn: RandomSection | None) -> RandomSection | None:
        return random_section(rng, site, drawn)
