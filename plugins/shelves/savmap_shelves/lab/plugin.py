"""Racks in the laboratory: for the simulator, for random places, and painted pictures against forgetting."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from savmap.lab.scenes import RandomSection, SceneParts, Site
from savmap.plugin.hookspecs import hookimpl
from savmap_shelves.lab.random_racks import random_section
from savmap_shelves.lab.scene import scene


class ShelvesLab:
    """Racks of the simulator, which make the faces of random places."""

    furnishes = True

    @hookimpl
    def scene(self, section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
        return scene(section, rng, site)

    @hookimpl
    def random_section(self, rng: np.random.Generator, site: Site, drawn: RandomSection | None) -> RandomSection | None:
        return random_section(rng, site, drawn)

    @hookimpl
    def practice_pictures(self, folder: Path, count: int, seed: int) -> None:
        """Painted pictures of random racks."""
        from savmap_shelves.lab.painted.pictures import write_pictures  # the painter; only where pictures are made

        write_pictures(folder, count, seed)
