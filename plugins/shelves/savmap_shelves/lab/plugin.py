"""Racks in the laboratory: for the simulator, for random places, and painted pictures to train on."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from savmap.plugin.hookspecs import hookimpl
from savmap_shelves.lab.random_racks import random_section
from savmap_shelves.lab.scene import scene


class ShelvesLab:
    """Racks of the simulator, which make the faces of random places."""

    furnishes = True
    network_classes = ("upright", "beam", "upright_side", "beam_side")

    scene = staticmethod(hookimpl(scene))
    random_section = staticmethod(hookimpl(random_section))

    @property
    def practice_kinds(self) -> Mapping[str, Any]:
        """Painted racks, and faces of random places in several looks."""
        from savmap_shelves.lab.practice import KINDS  # the painter and the renderer; only where pictures are made

        return KINDS

    @hookimpl
    def practice_picture(self, seed: int, index: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Painted pictures of random racks."""
        from savmap_shelves.lab.painted.pictures import picture  # the painter; only where pictures are made

        return picture(seed, index)
