"""Lamps in the laboratory: for the simulator and for random places."""

from savmap.plugin.hookspecs import hookimpl
from savmap_lights.lab.scene import random_section, scene


class LightsLab:
    """Lines of lamps for the simulator, which light random places."""

    furnishes = True

    scene = staticmethod(hookimpl(scene))
    random_section = staticmethod(hookimpl(random_section))
