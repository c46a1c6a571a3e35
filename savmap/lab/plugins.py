"""What installed plugins have for the laboratory: their classes of the entry-point group `savmap.lab`, behind typed
calls."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from savmap.errors import PluginError
from savmap.lab import hookspecs
from savmap.lab.scenes import RandomSection, SceneParts
from savmap.plugin.calls import Hook, HookCaller, manager
from savmap.plugin.manager import installed, load_point, set_up
from savmap.plugin.protocol import hook_faults

GROUP = "savmap.lab"
manager.add_hookspecs(hookspecs)


@dataclass(frozen=True)
class LabPlugin(HookCaller):
    """A plugin in the laboratory. Each hook is a method with the arguments of its specification
    (savmap.lab.hookspecs)."""

    scene = Hook(hookspecs.scene, SceneParts)
    random_section = Hook(hookspecs.random_section, RandomSection | None)
    practice_picture = Hook(hookspecs.practice_picture, tuple)

    @property
    def furnishes(self) -> bool:
        """Whether the plugin is asked for every random place."""
        return bool(getattr(self.instance, "furnishes", False))

    @property
    def network_classes(self) -> tuple[str, ...]:
        """The classes that the plugin's network is trained for; none where they are those that the plugin needs."""
        return tuple(getattr(self.instance, "network_classes", ()))

    @property
    def practice_kinds(self) -> Mapping[str, Any]:
        """The kinds of made-up pictures that the plugin's network is trained on (`savmap.lab.train.made.pictures.Kind`)
        by name; none where they are painted ones and views of random places."""
        return dict(getattr(self.instance, "practice_kinds", {}))


def lab_plugin(name: str) -> LabPlugin | None:
    """The laboratory's part of an installed plugin; None where it has none. Raises PluginError where it cannot be
    used."""
    point = installed(GROUP).get(name)
    if point is None:
        return None
    lab_class = load_point(point)
    for fault in hook_faults(lab_class, hookspecs):
        raise PluginError(f"plugin `{name}` cannot be used in the laboratory: {fault}")
    return LabPlugin(name, set_up(name, lab_class))


def furnishing_plugins() -> list[LabPlugin]:
    """The plugins that are asked for every random place. Raises PluginError."""
    return [plugin for name in installed(GROUP) if (plugin := lab_plugin(name)) is not None and plugin.furnishes]
