"""Rooms: each plugin with its config, behind typed calls that check what came back and name the plugin that gave it."""

import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint, PackageNotFoundError, distribution, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pluggy
from pydantic import BaseModel

from savmap.errors import PluginError, PluginFailedError, SavmapError, format_error
from savmap.files.validation import validated
from savmap.plugin import activity, defaults, hookspecs, trace
from savmap.types import (
    CrossRowLandmark,
    Detection,
    Drawing,
    Feature,
    Panorama,
    Score,
    Structure,
    Track,
    View,
    ViewPlan,
)

if TYPE_CHECKING:
    from savmap.graph import Constraints

GROUP = "savmap.plugins"


def installed() -> dict[str, EntryPoint]:
    """Entry points of the plugins that can be named, by name. Nothing is imported."""
    return {point.name: point for point in sorted(entry_points(group=GROUP))}


def load_class(name: str) -> Any:
    """The class of an installed plugin.

    Raises PluginError when there is none of that name (with the nearest) or when importing it fails.
    """
    points = installed()
    if name not in points:
        near = difflib.get_close_matches(name, points, 1)
        hint = f"did you mean `{near[0]}`?" if near else f"installed are: {', '.join(points) or 'none'}"
        raise PluginError(f"unknown plugin `{name}`: {hint}")
    try:
        return points[name].load()
    except Exception as error:
        raise PluginError(
            f"plugin `{name}` ({points[name].value}) cannot be imported: {format_error(error)}"
        ) from error


def lacking(plugin_class: Any) -> tuple[str, ...]:
    """The packages that a plugin's class names as its `libraries` and that are not installed: without them it does less."""
    return tuple(name for name in getattr(plugin_class, "libraries", ()) if not _is_there(name))


def _is_there(package: str) -> bool:
    try:
        distribution(package)
    except PackageNotFoundError:
        return False
    return True


@dataclass(frozen=True)
class LoadedPlugin:
    """One plugin at work: its instance, its config, the manager that asks it (and the defaults) alone, and the execution
    providers that its network is to run on (none: the automatic choice)."""

    name: str
    instance: Any
    config: BaseModel
    manager: pluggy.PluginManager = field(repr=False)
    providers: tuple[str, ...] = ()

    @property
    def classes(self) -> tuple[str, ...]:
        """Segmentation classes that the plugin's network must give."""
        return tuple(self.instance.classes)

    @property
    def model(self) -> Path:
        """The network's file: the config's `model` if set, else the one that comes with the plugin."""
        return Path(getattr(self.config, "model", None) or self.instance.model)

    @property
    def model_file(self) -> Path:
        """The network's file that the room's first execution provider takes: `model`, or the one in float32 that lies beside it."""
        from savmap.vision.networks.providers import choose, file_for

        return file_for(self.model, choose(self.providers).names[0])

    @property
    def threshold(self) -> float:
        """Confidence above which a pixel belongs to a class."""
        return float(getattr(self.config, "threshold", 0.5))

    @property
    def class_names(self) -> Mapping[str, str]:
        """What the network's classes are called here, by their own names or numbers, where the config says so."""
        return dict(getattr(self.config, "class_names", {}))

    @property
    def failure(self) -> PluginFailedError | None:
        """How the plugin failed, in a room that keeps this from the others; here it is raised."""
        return None

    def ask(self, hook: str, expected: type, item: type | None = None, **arguments: Any) -> Any:
        """What the plugin answers to a hook; `item`: what all that it gives must be.

        Raises PluginFailedError if it raises or answers otherwise. What it refuses in its own words (a SavmapError) is raised as it is.
        """
        try:
            with activity.working(self.name, hook):
                answer = getattr(self.manager.hook, hook)(**arguments)
        except SavmapError:
            raise
        except Exception as error:
            what = f"failed in `{hook}`{_place(arguments)}: {format_error(error)}"
            raise PluginFailedError(self.name, hook, what) from error
        if not isinstance(answer, expected):
            given = type(answer).__name__
            raise PluginFailedError(self.name, hook, f"returned {given} from `{hook}`, not {expected.__name__}")
        if item is not None:
            self._require_items(hook, answer, item)
        return answer

    def _require_items(self, hook: str, answer: Any, item: type) -> None:
        wrong = next((one for one in answer if not isinstance(one, item)), None)
        if wrong is not None:
            what = (
                f"returned a {type(answer).__name__} with a {type(wrong).__name__} from `{hook}`, not {item.__name__}"
            )
            raise PluginFailedError(self.name, hook, what)

    def ask_list(self, hook: str, item: type, **arguments: Any) -> list[Any]:
        """Like `ask`, for a list whose items must all be of one type."""
        answer: list[Any] = self.ask(hook, list, item, **arguments)
        return answer

    def render_views(self, **arguments: Any) -> ViewPlan:
        answer: ViewPlan = self.ask("render_views", ViewPlan, **arguments)
        return answer

    def detect(self, **arguments: Any) -> list[Detection]:
        return self.ask_list("detect", Detection, threshold=self.threshold, **arguments)

    def extract(self, view: View, detections: Sequence[Detection], panorama: Panorama | None = None) -> list[Feature]:
        return self.ask_list("extract_features", Feature, view=view, detections=detections, panorama=panorama)

    def track(self, **arguments: Any) -> list[Track]:
        return self.ask_list("track", Track, **arguments)

    def constrain(self, **arguments: Any) -> "Constraints":
        from savmap.graph import Constraints, require_valid_constraints

        answer: Constraints = self.ask("constrain", Constraints, **arguments)
        require_valid_constraints(self.name, answer, arguments["start"])
        return answer

    def evaluate(self, **arguments: Any) -> Score:
        answer: Score = self.ask("evaluate", Score, **arguments)
        return answer

    def draw(self, **arguments: Any) -> tuple[Drawing, ...]:
        answer: tuple[Drawing, ...] = self.ask("draw", tuple, Drawing, **arguments)
        return answer

    def describe(self, **arguments: Any) -> list[Structure]:
        return self.ask_list("describe", Structure, **arguments)

    def relate(
        self, structures: Sequence[Structure], others: Mapping[str, Sequence[Structure]]
    ) -> tuple[Structure, ...]:
        return tuple(self.ask_list("relate", Structure, structures=structures, others=others))

    def shared(self, structures: Sequence[Structure]) -> list[CrossRowLandmark]:
        return self.ask_list("shared", CrossRowLandmark, structures=structures)


def _place(arguments: Mapping[str, Any]) -> str:
    view = arguments.get("view")
    return f" at frame {view.frame} of {view.spec.name}" if isinstance(view, View) else ""


def open_plugin(
    name: str, config: Mapping[str, Any], where: str = "options", providers: tuple[str, ...] = ()
) -> LoadedPlugin:
    """A room for an installed plugin.

    Raises PluginError for an unknown or broken plugin, SiteError for a config it does not take.
    """
    plugin_class = load_class(name)
    settings = validated(plugin_class.Config, config, f"{where}: plugins.{name}")
    return loaded_plugin(name, plugin_class, settings, providers)


def loaded_plugin(
    name: str, plugin_class: Callable[[Any], Any], settings: BaseModel, providers: tuple[str, ...] = ()
) -> LoadedPlugin:
    """A room for a plugin's class and its validated config. Raises PluginError for a hook that does not exist."""
    try:
        plugin = plugin_class(settings)
        manager = pluggy.PluginManager("savmap")
        manager.add_hookspecs(hookspecs)
        manager.register(defaults)
        manager.register(plugin, name=name)
        manager.check_pending()
        trace.watch(manager, name)
    except SavmapError:
        raise
    except Exception as error:
        raise PluginError(f"plugin `{name}` cannot be set up: {format_error(error)}") from error
    return LoadedPlugin(name, plugin, settings, manager, providers)


def open_plugins(
    names: Iterable[str], configs: Callable[[str], Mapping[str, Any]], where: str, providers: tuple[str, ...] = ()
) -> Sequence[LoadedPlugin]:
    """Rooms for the named plugins, in that order, each once."""
    return [open_plugin(name, configs(name), where, providers) for name in dict.fromkeys(names)]


def exporters() -> dict[str, hookspecs.Exporter]:
    """Map formats by name: savmap's own, and those of every installed plugin, whose word counts more.

    Raises PluginError for a plugin that fails or gives something else.
    """
    found = dict(defaults.exporters())
    for name in installed():
        *own, _ = open_plugin(name, {}).ask("exporters", list)
        for answer in own:
            if not isinstance(answer, Mapping) or not all(callable(write) for write in answer.values()):
                raise PluginError(f"plugin `{name}` returned no functions by name from `exporters`")
            found.update(answer)
    return found


def register_commands(app: Any) -> None:
    """Let every installed plugin whose class answers `register_commands` add to the command line. Raises PluginError."""
    for name in installed():
        add = getattr(load_class(name), "register_commands", None)
        if add is None:
            continue
        try:
            add(app)
        except Exception as error:
            what = f"failed in `register_commands`: {format_error(error)}"
            raise PluginFailedError(name, "register_commands", what) from error
