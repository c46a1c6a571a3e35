"""What the network is trained on: painted racks, and the faces of random places in several looks."""

from collections.abc import Callable, Iterable
from functools import partial

from savmap.lab.sim.dataset import Sample
from savmap.lab.sim.random_scene import random_scene
from savmap.lab.sim.scene.files import Scene
from savmap.lab.train.made.pictures import Kind, views
from savmap_shelves.lab.looks import dark_scene, dim_scene, grey_scene, pale_scene
from savmap_shelves.lab.painted.pictures import CLASSES, picture

LOOKS: dict[str, tuple[float, Callable[[int], Scene], int]] = {
    "random": (1 / 3, random_scene, 24),
    "grey": (1 / 6, grey_scene, 24),
    "pale": (1 / 6, pale_scene, 0),
    "dark": (1 / 6, dark_scene, 24),
    "dim": (1 / 6, dim_scene, 0),
}
"""Shares of a third each of random, grey and dark places, and how many of their faces only measure."""
FACES, CLOSE, PAINTED = 0.4, 0.1, 0.3


def painted(number: int) -> Iterable[Sample]:
    """Painted pictures that share a wardrobe."""
    return (picture(number, index) for index in range(24))


KINDS = {
    **{
        f"face-{name}": Kind(FACES * s, partial(views, "face", of, CLASSES), held)
        for name, (s, of, held) in LOOKS.items()
    },
    **{f"close-{name}": Kind(CLOSE * s, partial(views, "close", of, CLASSES)) for name, (s, of, _) in LOOKS.items()},
    "painted": Kind(PAINTED, painted, 24),
}
"""Mapping sees faces: they are most of it."""
