"""Plugins at work: each with its settings, behind typed calls that check what came back and name the plugin that gave
it."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, PackageNotFoundError, distribution, entry_points
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from savmap.errors import PluginError, PluginFailedError, SavmapError, format_error
from savmap.files.validation import validated
from savmap.maps.exports import FORMATS, OneFrame
from savmap.plugin import checks, hookspecs
from savmap.plugin.apps import apps
from savmap.plugin.calls import Hook, HookCaller, manager
from savmap.plugin.inspection import InspectionLimits
from savmap.plugin.protocol import class_faults, implements
from savmap.types import (
    CrossRowLandmark,
    Detection,
    Drawing,
    Feature,
    FlatParts,
    FoundObject,
    MapWarning,
    PlanePatch,
    RowFacts,
    RowInspection,
    Score,
    Structure,
    SurveyEntry,
    Thresholds,
    Track,
    Trajectory,
    View,
    ViewPlan,
)

if TYPE_CHECKING:
    from savmap.graph import Constraints, Solution
    from savmap.vision.networks.segmenter import Segmenter

GROUP = "savmap.plugins"
MIN_PIXELS = 12


def installed(group: str = GROUP) -> dict[str, EntryPoint]:
    """Entry points of the plugins that can be named, by name. Nothing is imported."""
    return {point.name: point for point in sorted(entry_points(group=group))}


def load_class(name: str) -> Any:
    """The class of an installed plugin.

    Raises PluginError when there is none of that name (with the nearest), when importing it fails, or when it lacks
    what every plugin must have.
    """
    points = installed()
    if name not in points:
        near = difflib.get_close_matches(name.lower(), points, 1)
        hint = f"did you mean `{near[0]}`?" if near else f"installed are: {', '.join(points) or 'none'}"
        raise PluginError(f"unknown plugin `{name}`: {hint}")
    plugin_class = load_point(points[name])
    require_complete(name, plugin_class)
    return plugin_class


def load_point(point: EntryPoint) -> Any:
    """What an entry point of a plugin names. Raises PluginError where importing it fails."""
    try:
        return point.load()
    except (Exception, SystemExit) as error:
        raise PluginError(f"plugin `{point.name}` ({point.value}) cannot be imported: {format_error(error)}") from error


def require_complete(name: str, plugin_class: Any) -> None:
    """Raise PluginError where a plugin's class lacks an attribute or a hook that it must have."""
    fault = next(class_faults(plugin_class), None)
    if fault is not None:
        raise PluginError(f"plugin `{name}` cannot be used: {fault}")


@dataclass(frozen=True)
class InstalledPlugins:
    """The classes of the installed plugins by name, and, of those that cannot be used, the reason by name."""

    classes: Mapping[str, Any]
    broken: Mapping[str, str]


def load_installed() -> InstalledPlugins:
    """Import every installed plugin; one that cannot be used is no harm to the others."""
    classes: dict[str, Any] = {}
    broken: dict[str, str] = {}
    for name in installed():
        try:
            classes[name] = load_class(name)
        except PluginError as error:
            broken[name] = str(error)
    return InstalledPlugins(classes, broken)


def lacking(plugin_class: Any) -> tuple[str, ...]:
    """The packages that a plugin's class names as its `libraries` and that are not installed: without them it does
    less."""
    return tuple(name for name in getattr(plugin_class, "libraries", ()) if not _is_there(name))


def _is_there(package: str) -> bool:
    try:
        distribution(package)
    except PackageNotFoundError:
        return False
    return True


def _nothing(_: Mapping[str, Any]) -> list[Any]:
    return []


def _no_survey(asked: Mapping[str, Any]) -> SurveyEntry:
    return SurveyEntry(
        {}, {structure.id: "its plugin reads no tables, drawings or models" for structure in asked["structures"]}
    )


def _regions(asked: Mapping[str, Any]) -> list[Detection]:
    """Connected regions of the network's classes above the thresholds, instance by instance where it tells them
    from one another."""
    detections: list[Detection] = asked["segmenter"].detections(asked["view"].image, asked["thresholds"], MIN_PIXELS)
    return detections


@dataclass(frozen=True)
class LoadedPlugin(HookCaller):
    """One plugin at work, with its config, and the execution providers that its network is to run on (none: the
    automatic choice).

    Each hook is a method with the arguments of its specification (savmap.plugin.hookspecs).
    """

    config: BaseModel
    providers: tuple[str, ...] = ()

    render_views = Hook(
        hookspecs.render_views,
        ViewPlan,
        lambda plan: checks.require_distinct((view.name for view in plan.views), "views with the name"),
    )
    extract_features = Hook(
        hookspecs.extract_features,
        list[Feature],
        lambda features, view: checks.check_features(features, view.spec, view.frame),
    )
    track = Hook(hookspecs.track, list[Track], checks.check_tracks)
    planes = Hook(hookspecs.planes, list[PlanePatch], checks.check_patches, _nothing)
    find = Hook(hookspecs.find, list[FoundObject], checks.check_found, _nothing)
    measure = Hook(hookspecs.measure, list[Feature], checks.check_features)
    flat_parts = Hook(hookspecs.flat_parts, list[FlatParts], checks.check_flat_parts, _nothing)
    relate = Hook(hookspecs.relate, list[Structure], checks.check_related, lambda asked: list(asked["structures"]))
    warnings = Hook(hookspecs.warnings, list[MapWarning], checks.check_warnings, _nothing)
    openings = Hook(hookspecs.openings, list[Structure], checks.check_structures, _nothing)
    places = Hook(hookspecs.places, list[Structure], checks.check_structures, _nothing)
    inspect = Hook(hookspecs.inspect, RowInspection, checks.check_inspection, lambda _: RowInspection())
    cross_row_landmarks = Hook(hookspecs.cross_row_landmarks, list[CrossRowLandmark], checks.check_landmarks, _nothing)
    evaluate = Hook(hookspecs.evaluate, Score, checks.check_score, lambda _: Score())
    survey_entry = Hook(hookspecs.survey_entry, SurveyEntry, checks.check_survey_entry, _no_survey)
    draw = Hook(hookspecs.draw, tuple[Drawing, ...], default=lambda _: ())
    exporters = Hook(
        hookspecs.exporters,
        Mapping,
        lambda formats: checks.require(all(map(callable, formats.values())), "no functions by name"),
    )
    _detect = Hook(hookspecs.detect, list[Detection], checks.check_detections, _regions)
    _describe = Hook(hookspecs.describe, list[Structure], checks.check_structures)

    def detect(self, view: View, segmenter: "Segmenter") -> list[Detection]:
        """What the network gives for a view, with the thresholds of the config."""
        return self._detect(view, segmenter, self.threshold, self.thresholds)

    def constrain(self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory) -> "Constraints":
        """The plugin's part of the factor graph, in its own key space."""
        from savmap.graph import Constraints, KeySpace  # gtsam takes long to import

        hook = Hook(hookspecs.constrain, Constraints, checks.check_constraints)
        return hook(self, tracks, facts, start, KeySpace(self.name))

    def describe(self, tracks: Sequence[Track], facts: RowFacts, solution: "Solution") -> list[Structure]:
        """What goes into the map."""
        return self._describe(tracks, facts, solution.landmarks_of(self.name), solution)

    def limits(self, given: Mapping[str, Any], where: str) -> BaseModel:
        """The plugin's limits of an inspection, those that are given instead of the usual ones. Raises SiteError."""
        model: type[BaseModel] = getattr(self.instance, "Limits", InspectionLimits)
        return validated(model, given, f"{where}: plugins.{self.name}")

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
        """The network's file that the plugin's first execution provider takes: `model`, or the one in float32 beside
        it."""
        from savmap.vision.networks.session import choose, file_for  # onnxruntime takes long to import

        return file_for(self.model, choose(self.providers).names[0])

    @property
    def threshold(self) -> float:
        """Confidence above which a pixel belongs to a class."""
        return float(getattr(self.config, "threshold", 0.5))

    @property
    def thresholds(self) -> Thresholds:
        """The same, where the network is faint, and of regions."""
        weak, seed = (getattr(self.config, name, None) for name in ("weak_threshold", "seed_threshold"))
        return Thresholds.of(self.threshold, weak, seed)

    @property
    def class_names(self) -> Mapping[str, str]:
        """What the network's classes are called here, by their own names or numbers, where the config says so."""
        return dict(getattr(self.config, "class_names", {}))

    @property
    def needs_path(self) -> bool:
        """Whether the plugin cannot locate the camera, so that another plugin or an earlier map must."""
        return bool(getattr(self.instance, "needs_path", False))

    @property
    def in_every_frame(self) -> bool:
        """Whether each frame before a row should show something of the plugin's."""
        return bool(getattr(self.instance, "in_every_frame", False))

    @property
    def failure(self) -> PluginFailedError | None:
        """How the plugin failed, if it did and its failures are contained; here they are raised."""
        return None

    def before_pixels(self) -> "LoadedPlugin":
        """The plugin with the defaults of the settings that are not used on pixels (`after_pixels`)."""
        later = set(getattr(self.instance, "after_pixels", ()))
        settings = type(self.config)(
            **{name: getattr(self.config, name) for name in type(self.config).model_fields if name not in later}
        )
        return loaded_plugin(self.name, type(self.instance), settings, self.providers)


def open_plugin(
    name: str, config: Mapping[str, Any], where: str = "options", providers: tuple[str, ...] = ()
) -> LoadedPlugin:
    """An installed plugin with its settings, at work.

    Raises PluginError for an unknown, broken or incomplete plugin, SiteError for settings that it does not take.
    """
    plugin_class = load_class(name)
    settings = validated(plugin_class.Config, config, f"{where}: plugins.{name}")
    return loaded_plugin(name, plugin_class, settings, providers)


def loaded_plugin(
    name: str, plugin_class: Callable[[Any], Any], settings: BaseModel, providers: tuple[str, ...] = ()
) -> LoadedPlugin:
    """A plugin of a class and validated settings, at work. Raises PluginError for a class that is incomplete."""
    require_complete(name, plugin_class)
    return LoadedPlugin(name, set_up(name, lambda: plugin_class(settings)), settings, providers)


def set_up(name: str, make: Callable[[], Any]) -> Any:
    """What `make` gives: an object whose hooks take no argument that they are not given. Raises PluginError."""
    try:
        instance = make()
    except SavmapError:
        raise
    except (Exception, SystemExit) as error:
        raise PluginError(f"plugin `{name}` cannot be set up: {format_error(error)}") from error
    for hook in (each for each in dir(type(instance)) if implements(type(instance), each)):
        given = getattr(manager.hook, hook).spec.argnames
        for argument in signature(getattr(instance, hook)).parameters.values():
            if argument.kind == argument.POSITIONAL_OR_KEYWORD and argument.name not in given:
                what = f"`{hook}` takes `{argument.name}`, but is given {', '.join(given) or 'nothing'}"
                raise PluginError(f"plugin `{name}` cannot be set up: {what}")
    return instance


def exporters() -> dict[str, hookspecs.Exporter]:
    """Map formats by name: the core's, those of installed apps, and those of every installed plugin that can be used,
    which win.

    Raises PluginError for a plugin that fails in the hook or gives something else.
    """
    targets = {**{name: target for app in apps().values() for name, target in app.formats.items()}, **FORMATS}
    formats: dict[str, hookspecs.Exporter] = {name: OneFrame(target) for name, target in targets.items()}
    for name, plugin_class in load_installed().classes.items():
        if implements(plugin_class, "exporters"):
            formats.update(open_plugin(name, {}).exporters())
    return formats
