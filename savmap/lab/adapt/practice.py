"""Pictures against forgetting: what a network is shown beside a site's own views, so that it keeps what it knew.

A plugin may paint them itself: its hook `practice_picture` (see `savmap.lab.hookspecs`).
Otherwise they are of the simulator's random scenes, if the plugin makes up structures for these.
"""

import shutil
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from savmap.lab.plugins import lab_plugin
from savmap.lab.sim.dataset import write, write_practice
from savmap.lab.sim.random_scene import random_scene
from savmap.types.progress import Monitor

SEED, OTHER_SEED = 4200, 4300
OTHERS = 40
"""How many pictures of other places tell whether a network forgets."""


def practice_set(
    plugin: str, classes: Sequence[str], count: int, folder: Path, monitor: Monitor, seed: int = SEED
) -> Path | None:
    """A data set of `count` pictures of other places for a plugin's network, made unless it is there; None where the
    plugin cannot make any. Another seed makes others. Raises PluginFailedError, SceneError, OutputError."""
    lab = lab_plugin(plugin)
    if count == 0 or lab is None or not (lab.has("practice_picture") or lab.has("random_section")):
        return None
    if folder.is_dir():
        return folder
    monitor.note(f"making {count} pictures of other places, against forgetting ({folder.name})")
    partial_folder = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(partial_folder, ignore_errors=True)
    if lab.has("practice_picture"):
        write_practice(partial_folder, lab, classes, seed, count)
    else:
        write(partial_folder, seed, count, "mixed", classes, partial(random_scene, plugins=[plugin]))
    partial_folder.rename(folder)
    return folder
