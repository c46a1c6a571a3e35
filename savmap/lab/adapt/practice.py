"""Pictures against forgetting: what a network is shown beside a site's own views, so that it keeps what it knew.

A plugin may paint them itself: the function `practice_pictures` of its class (see `savmap.plugin.protocol.Plugin`).
Otherwise they are of the simulator's random scenes, if the plugin makes up structures for these.
"""

import shutil
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from savmap.errors import PluginFailedError, SavmapError, format_error
from savmap.lab.sim.dataset import write
from savmap.lab.sim.random_scene import random_scene
from savmap.plugin.manager import load_class
from savmap.plugin.protocol import implements
from savmap.types.progress import Monitor

HOOK = "practice_pictures"
SEED, OTHER_SEED = 4200, 4300
OTHERS = 40
"""How many pictures of other places tell whether a network forgets."""


def practice_set(
    plugin: str, classes: Sequence[str], count: int, folder: Path, monitor: Monitor, seed: int = SEED
) -> Path | None:
    """A data set of `count` pictures of other places for a plugin's network, made unless it is there; None where the
    plugin cannot make any. Another seed makes others. Raises PluginFailedError, SceneError, OutputError."""
    plugin_class = load_class(plugin)
    paint = getattr(plugin_class, HOOK, None)
    if count == 0 or not (callable(paint) or implements(plugin_class, "random_section")):
        return None
    if folder.is_dir():
        return folder
    monitor.note(f"making {count} pictures of other places, against forgetting ({folder.name})")
    partial_folder = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(partial_folder, ignore_errors=True)
    if callable(paint):
        _painted(plugin, paint, count, partial_folder, seed)
    else:
        write(partial_folder, seed, count, "mixed", classes, partial(random_scene, plugins=[plugin]))
    partial_folder.rename(folder)
    return folder


def _painted(plugin: str, paint: object, count: int, folder: Path, seed: int) -> None:
    assert callable(paint)
    try:
        paint(folder=folder, count=count, seed=seed)
    except SavmapError:
        raise
    except (Exception, SystemExit) as error:
        raise PluginFailedError(plugin, HOOK, f"failed in `{HOOK}`: {format_error(error)}") from error
