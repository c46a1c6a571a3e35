"""Plugins at work: each with its settings, behind typed calls that check what came back and name the plugin that gave
it."""

import difflib
import faulthandler
import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint, PackageNotFoundError, distribution, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import pluggy
from pydantic import BaseModel

from savmap.errors import PluginError, PluginFailedError, SavmapError, format_error
from savmap.files.validation import validated
from savmap.plugin import checks, defaults, hookspecs, trace
from savmap.plugin.protocol import Plugin, class_faults, implements
from savmap.types import (
    CrossRowLandmark,
    Detection,
    Doubt,
    Expected,
    Feature,
    FlatParts,
    Floats,
    JointCovariance,
    Panorama,
    PlaneEvidence,
    PlanePatch,
    RowFacts,
    Structure,
    Thresholds,
    Track,
    Trajectory,
    View,
    ViewPlan,
)

if TYPE_CHECKING:
    import numpy as np

    from savmap.graph import Constraints, Solution
    from savmap.types import Drawing, Score, SurveyEntry
    from savmap.types.scenes import RandomSection, SceneParts, Site
    from savmap.vision.networks.segmenter import Segmenter
    from savmap.vision.view_planning import Manual, PassPreview

GROUP = "savmap.plugins"
Answer = TypeVar("Answer")
Item = TypeVar("Item")
notices = logging.getLogger("savmap-plugins")


class _HookLimit:
    """Ends this process, with a traceback, when the hooks that run are stuck: none began or ended for too long."""

    def __init__(self) -> None:
        self.seconds = float("inf")
        self._running, self._lock = 0, threading.Lock()

    def __enter__(self) -> None:
        self._count(1)

    def __exit__(self, *_: object) -> None:
        self._count(-1)

    def _count(self, more: int) -> None:
        if self.seconds < threading.TIMEOUT_MAX:
            with self._lock:
                self._running += more
                if self._running:
                    faulthandler.dump_traceback_later(self.seconds, exit=True)
                else:
                    faulthandler.cancel_dump_traceback_later()


_hook_limit = _HookLimit()


def limit_hooks(seconds: float) -> None:
    """End this process when a hook takes longer than that."""
    _hook_limit.seconds = seconds


def installed() -> dict[str, EntryPoint]:
    """Entry points of the plugins that can be named, by name. Nothing is imported."""
    return {point.name: point for point in sorted(entry_points(group=GROUP))}


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
    try:
        plugin_class = points[name].load()
    except (Exception, SystemExit) as error:
        raise PluginError(
            f"plugin `{name}` ({points[name].value}) cannot be imported: {format_error(error)}"
        ) from error
    require_complete(name, plugin_class)
    return plugin_class


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


@dataclass(frozen=True)
class LoadedPlugin:
    """One plugin at work: its instance, its config, the manager that asks it (and the defaults) alone, and the
    execution providers that its network is to run on (none: the automatic choice).

    Each hook is a method with the arguments of its specification (savmap.plugin.hookspecs). All of them raise
    PluginFailedError, with the plugin's and the hook's name, where the hook raises or ends the program or its answer
    cannot be used. A SavmapError of the plugin's own, with which it refuses in its own words, is raised as it is.
    """

    name: str
    instance: Plugin
    config: BaseModel
    manager: pluggy.PluginManager = field(repr=False)
    providers: tuple[str, ...] = ()
    network: Path | None = None

    @property
    def classes(self) -> tuple[str, ...]:
        """Segmentation classes that the plugin's network must give."""
        return tuple(self.instance.classes)

    @property
    def model(self) -> Path:
        """The network's file: the config's `model` if set, else the one chosen for the row (`network`) or that comes
        with the plugin."""
        return Path(getattr(self.config, "model", None) or self.network or self.instance.model)

    @property
    def model_file(self) -> Path:
        """The network's file that the plugin's first execution provider takes: `model`, or the one in float32 beside
        it."""
        from savmap.vision.networks.providers import choose, file_for  # keeps `savmap --help` fast

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
    def failure(self) -> PluginFailedError | None:
        """How the plugin failed, if it did and its failures are contained; here they are raised."""
        return None

    def has(self, hook: str) -> bool:
        """Whether the plugin writes a hook itself, so that no default answers."""
        return implements(self.instance, hook)

    def render_views(
        self,
        pass_preview: "PassPreview",
        predict: Callable[[View], list[Detection]],
        side: Literal["left", "right"] | None,
        manual: Mapping[str, "Manual"],
        attitude: Floats | None,
    ) -> ViewPlan:
        """The views of one pass that the plugin wants."""
        return self._ask(
            "render_views",
            ViewPlan,
            checks.check_view_plan,
            pass_preview=pass_preview,
            predict=predict,
            side=side,
            manual=manual,
            attitude=attitude,
        )

    def detect(self, view: View, segmenter: "Segmenter") -> list[Detection]:
        """What the network gives for a view."""
        return self._ask_list(
            "detect",
            Detection,
            lambda detections: checks.check_detections(detections, view),
            view=view,
            segmenter=segmenter,
            threshold=self.threshold,
            thresholds=self.thresholds,
        )

    def extract_features(
        self, view: View, detections: Sequence[Detection], panorama: Panorama | None = None
    ) -> list[Feature]:
        """Points and edges of a view."""
        return self._ask_list(
            "extract_features",
            Feature,
            lambda features: checks.check_features(features, view),
            view=view,
            detections=detections,
            panorama=panorama,
        )

    def track(
        self, features: Sequence[Feature], facts: RowFacts, attitudes: Floats, start: Trajectory | None
    ) -> list[Track]:
        """Which features are one physical point."""
        return self._ask_list(
            "track",
            Track,
            lambda tracks: checks.check_tracks(tracks, facts),
            features=features,
            facts=facts,
            attitudes=attitudes,
            start=start,
        )

    def planes(self, points: Mapping[str, Floats]) -> list[PlanePatch]:
        """The planes that the structure lies in, by the first positions of its landmarks."""
        return self._ask_list("planes", PlanePatch, checks.check_patches, points=points)

    def expect(
        self, points: Mapping[str, Floats], evidence: Sequence[PlaneEvidence], floor: float | None = None
    ) -> list[Expected]:
        """The objects that the evidence shows, where that is not what was tracked."""
        return self._ask_list(
            "expect",
            Expected,
            lambda expected: checks.check_expected(expected, self.classes),
            points=points,
            evidence=evidence,
            floor=floor,
        )

    def flat_parts(self, points: Mapping[str, Floats]) -> list[FlatParts]:
        """The flat parts whose depth what shows on them may tell."""
        return self._ask_list(
            "flat_parts", FlatParts, lambda flats: checks.check_flat_parts(flats, points), points=points
        )

    def before_pixels(self) -> "LoadedPlugin":
        """The plugin with the defaults of the settings that are not used on pixels (`after_pixels`)."""
        later = set(getattr(self.instance, "after_pixels", ()))
        settings = type(self.config)(
            **{name: getattr(self.config, name) for name in type(self.config).model_fields if name not in later}
        )
        return loaded_plugin(self.name, type(self.instance), settings, self.providers)

    def constrain(self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory) -> "Constraints":
        """The plugin's part of the factor graph, in its own key space."""
        from savmap.graph import Constraints, KeySpace  # keeps `savmap --help` fast

        return self._ask(
            "constrain",
            Constraints,
            lambda constraints: checks.check_constraints(constraints, self.name, start),
            tracks=tracks,
            facts=facts,
            start=start,
            keys=KeySpace(self.name),
        )

    def describe(self, tracks: Sequence[Track], facts: RowFacts, solution: "Solution") -> list[Structure]:
        """What goes into the map."""
        return self._ask_list(
            "describe",
            Structure,
            checks.check_structures,
            tracks=tracks,
            facts=facts,
            landmarks=solution.landmarks_of(self.name),
            solution=solution,
        )

    def relate(
        self, structures: Sequence[Structure], others: Mapping[str, Sequence[Structure]]
    ) -> tuple[Structure, ...]:
        """The plugin's structures with attributes that say how they stand to those of others, by plugin."""
        return tuple(
            self._ask_list(
                "relate",
                Structure,
                lambda related: checks.check_related(related, structures),
                structures=structures,
                others=others,
            )
        )

    def doubt(self, structures: Sequence[Structure]) -> list[Doubt]:
        """What of the structures is implausible."""
        return self._ask_list(
            "doubt", Doubt, lambda doubts: checks.check_doubts(doubts, structures), structures=structures
        )

    def openings(self, structures: Sequence[Structure]) -> list[Structure]:
        """The spaces between the structures whose clear width and height matter."""
        return self._ask_list("openings", Structure, checks.check_structures, structures=structures)

    def places(self, structures: Sequence[Structure], joint: JointCovariance | None = None) -> list[Structure]:
        """The places between the structures that have a name."""
        return self._ask_list("places", Structure, checks.check_structures, structures=structures, joint=joint)

    def cross_row_landmarks(self, structures: Sequence[Structure]) -> list[CrossRowLandmark]:
        """Which of the structures other rows may have mapped too."""
        return self._ask_list(
            "cross_row_landmarks",
            CrossRowLandmark,
            lambda landmarks: checks.check_landmarks(landmarks, structures),
            structures=structures,
        )

    def evaluate(self, structures: Sequence[Structure], survey: Mapping[str, Any]) -> "Score":
        """Structures against a surveyor's sheet of the row."""
        from savmap.types import Score  # keeps `savmap --help` fast

        return self._ask("evaluate", Score, checks.check_score, structures=structures, survey=survey)

    def survey_entry(self, structures: Sequence[Structure]) -> "SurveyEntry":
        """What somebody measured of a row, as the plugin's keys of its entry in a survey file."""
        from savmap.types import SurveyEntry  # keeps `savmap --help` fast

        return self._ask(
            "survey_entry",
            SurveyEntry,
            lambda entry: checks.check_survey_entry(entry, structures),
            structures=structures,
        )

    def draw(
        self, structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
    ) -> "tuple[Drawing, ...]":
        """The structures as figures."""
        from savmap.types import Drawing  # keeps `savmap --help` fast

        answer: tuple[Drawing, ...] = self._ask(
            "draw",
            tuple,
            lambda drawings: self._check_items("draw", drawings, Drawing, checks.check_drawings),
            structures=structures,
            survey=survey,
            deviations=deviations,
        )
        return answer

    def scene(self, section: Mapping[str, Any], rng: "np.random.Generator", site: "Site") -> "SceneParts":
        """What a simulator builds for the plugin. Raises PluginError where it has no hook for that."""
        from savmap.types.scenes import SceneParts  # only the simulator needs it

        if not self.has("scene"):
            raise PluginError(f"plugin `{self.name}` cannot be simulated: it has no hook `scene`")
        return self._ask("scene", SceneParts, lambda parts: None, section=section, rng=rng, site=site)

    def random_section(
        self, rng: "np.random.Generator", site: "Site", drawn: "RandomSection | None"
    ) -> "RandomSection | None":
        """What a random scene holds of the plugin's structure; None where the plugin has nothing to add."""
        if not self.has("random_section"):
            return None
        from savmap.types.scenes import RandomSection  # only the simulator needs it

        answer = self._ask("random_section", object, lambda section: None, rng=rng, site=site, drawn=drawn)
        if answer is None or isinstance(answer, RandomSection):
            return answer
        what = f"returned {type(answer).__name__} from `random_section`, not RandomSection"
        raise PluginFailedError(self.name, "random_section", what)

    def exporters(self) -> dict[str, hookspecs.Exporter]:
        """The plugin's map formats by name; none where it has no hook for that."""
        answers = self._ask("exporters", list, checks.check_exporters)
        return dict(answers[0]) if self.has("exporters") else {}

    def _ask(self, hook: str, expected: type[Answer], check: Callable[[Answer], object], **arguments: Any) -> Answer:
        """What the plugin answers to a hook, when it is of the expected type and passes the check. Raises
        PluginFailedError."""
        try:
            with _hook_limit:
                answer = getattr(self.manager.hook, hook)(**arguments)
        except SavmapError:
            raise
        except (Exception, SystemExit) as error:
            what = f"failed in `{hook}`{_where(arguments)}: {format_error(error)}"
            raise PluginFailedError(self.name, hook, what) from error
        if not isinstance(answer, expected):
            given = type(answer).__name__
            raise PluginFailedError(self.name, hook, f"returned {given} from `{hook}`, not {expected.__name__}")
        try:
            check(answer)
        except PluginFailedError:
            raise
        except Exception as error:
            fault = str(error) if type(error) is ValueError else format_error(error)
            what = f"returned what cannot be used from `{hook}`{_where(arguments)}: {fault}"
            raise PluginFailedError(self.name, hook, what) from error
        return answer

    def _ask_list(
        self, hook: str, item: type[Item], check: Callable[[Sequence[Item]], object], **arguments: Any
    ) -> list[Item]:
        """Like `_ask`, for a list whose items must all be of one type."""
        answer: list[Item] = self._ask(
            hook, list, lambda items: self._check_items(hook, items, item, check), **arguments
        )
        return answer

    def _check_items(
        self, hook: str, answer: Sequence[Item], item: type[Item], check: Callable[[Sequence[Item]], object]
    ) -> None:
        wrong = [type(value).__name__ for value in answer if not isinstance(value, item)]
        if wrong:
            what = f"returned a {type(answer).__name__} with a {wrong[0]} from `{hook}`, not {item.__name__}"
            raise PluginFailedError(self.name, hook, what)
        check(answer)


def _where(arguments: Mapping[str, Any]) -> str:
    view = arguments.get("view")
    return f" at frame {view.frame} of {view.spec.name}" if isinstance(view, View) else ""


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
    except (Exception, SystemExit) as error:
        raise PluginError(f"plugin `{name}` cannot be set up: {format_error(error)}") from error
    return LoadedPlugin(name, plugin, settings, manager, providers)


def exporters() -> dict[str, hookspecs.Exporter]:
    """Map formats by name: savmap's own, and those of every installed plugin that can be used, which win.

    Raises PluginError for a plugin that fails in the hook or gives something else.
    """
    formats = dict(defaults.exporters())
    for name in load_installed().classes:
        formats.update(open_plugin(name, {}).exporters())
    return formats


def register_commands(app: Any) -> None:
    """Let every installed plugin whose class has `register_commands` add to the command line; one that cannot be used
    is named in a warning. Raises PluginFailedError."""
    plugins = load_installed()
    for reason in plugins.broken.values():
        notices.warning("%s", reason)
    for name, plugin_class in plugins.classes.items():
        add = getattr(plugin_class, "register_commands", None)
        if add is None:
            continue
        try:
            add(app)
        except (Exception, SystemExit) as error:
            what = f"failed in `register_commands`: {format_error(error)}"
            raise PluginFailedError(name, "register_commands", what) from error
