"""The hooks that only the laboratory asks: how a plugin's structure is simulated, and pictures to train its network on.

A plugin implements them in a class of its own, named by an entry point of the group `savmap.lab` under the plugin's
name, so that mapping never imports it. The class is made without arguments; all hooks are optional. It may declare

- `furnishes: bool`: whether it is asked for every random place (`random_section`), not only where it is named.
- `network_classes: tuple[str, ...]`: all classes of the plugin's network, where training teaches more than the plugin
  needs.
- `practice_kinds: Mapping[str, Kind]`: kinds of made-up pictures to train the network on
  (`savmap.lab.train.made.pictures`), by name.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from savmap.lab.scenes import RandomSection, SceneParts, Site
from savmap.plugin.hookspecs import hookspec


@hookspec(firstresult=True)
def scene(section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
    """What a simulator should build for this plugin's section of a scene file.

    `site` is the building, the rows' frames, and what the plugins before this one in the file have built: the rows'
    sizes and their labelled fronts.
    """


@hookspec(firstresult=True)
def random_section(rng: np.random.Generator, site: Site, drawn: RandomSection | None) -> RandomSection | None:
    """What a random scene should hold of this plugin's structure. Default: None, nothing.

    A plugin that sets `furnishes = True` is asked for every random place: first of an aisle without rows (`site.frames`
    is empty), where those that make the rows' faces give them; those that gave None then are asked again, with rows,
    hall and goods known. Any other plugin is asked for by name, of the furnished place. `drawn` is what the plugin gave
    for this place before: row A of it is wanted again, short enough to be driven past (None: it is short enough).
    """


@hookspec(firstresult=True)
def practice_picture(seed: int, index: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The labelled picture of a number: RGB (480, 640, 3), and its mask (480, 640), 0 background, k the k-th of
    `network_classes`, 255 not to be judged. The same seed and index give the same. Networks are trained on such
    pictures, and `savmap adapt` mixes them in against forgetting. Default: the simulator's random scenes are taken."""
