"""Signs in the laboratory: plates for the simulator and for random places."""

from savmap.plugin.hookspecs import hookimpl
from savmap_signs.lab.random_plates import random_section
from savmap_signs.lab.scene import scene


class SignsLab:
    """Plates for the simulator; in random places only where they are asked for by name."""

    scene = staticmethod(hookimpl(scene))
    random_section = staticmethod(hookimpl(random_section))
