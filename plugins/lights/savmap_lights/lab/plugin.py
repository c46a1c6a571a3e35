"""Lamps in the laboratory: for the simulator, for random places, and painted ceilings to train on."""

import numpy as np
from numpy.typing import NDArray

from savmap.plugin.hookspecs import hookimpl
from savmap_lights.lab.scene import random_section, scene


class LightsLab:
    """Lines of lamps for the simulator, which light random places."""

    furnishes = True
    network_classes = ("light",)

    scene = staticmethod(hookimpl(scene))
    random_section = staticmethod(hookimpl(random_section))

    @hookimpl
    def practice_picture(self, seed: int, index: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Painted ceilings."""
        from savmap_lights.lab.painted.pictures import picture  # the painter; only where pictures are made

        return picture(seed, index)
