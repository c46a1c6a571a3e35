"""Racks in the laboratory: for the simulator, for random places, and painted pictures against forgetting."""

from pathlib import Path

from savmap.plugin.hookspecs import hookimpl
from savmap_shelves.lab.random_racks import random_section
from savmap_shelves.lab.scene import scene


class ShelvesLab:
    """Racks of the simulator, which make the faces of random places."""

    furnishes = True

    scene = staticmethod(hookimpl(scene))
    random_section = staticmethod(hookimpl(random_section))

    @hookimpl
    def practice_pictures(self, folder: Path, count: int, seed: int) -> None:
        """Painted pictures of random racks."""
        from savmap_shelves.lab.painted.pictures import write_pictures  # the painter; only where pictures are made

        write_pictures(folder, count, seed)
