"""The only walk over pixels: every frame decoded once, in order; every view rendered and segmented once."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from savmap.errors import StructureError
from savmap.files.urls import is_url
from savmap.pipeline.footage import require_course, require_panoramas
from savmap.pipeline.networks import further_models, with_best_network
from savmap.plugin.isolation import failed, left_out
from savmap.plugin.manager import LoadedPlugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.model import MIN_FRAMES, Pass, pass_names
from savmap.types import Doubt, Feature, Floats, Flow, FrameTable, Panorama, RowFacts, View, ViewPlan, ViewSpec
from savmap.types.progress import Monitor
from savmap.video.footage.watch import PassWatch
from savmap.video.prefetch import prefetch
from savmap.video.reader import Clip, DecodeReport, expected_frames, panoramas, preview_frames, probe
from savmap.vision.evidence import Look
from savmap.vision.flow import FlowTracker, NullFlowTracker
from savmap.vision.markers import Label, MarkerTracker, MarkerTracks
from savmap.vision.view_planning import Manual, PassPreview
from savmap.vision.views import Renderer

WORKERS, DEPTH = 2, 3


@dataclass(frozen=True, eq=False)
class RowMeasurements:
    """What was measured in a row's pictures: its facts, features by plugin, the first attitude of every pass that is known, the
    plugins that found the face and so locate the camera, the markers, and points that were followed. `failed`: by plugin, how it
    failed, where the row is mapped without it. `doubts`: what of the footage speaks against what was measured."""

    facts: RowFacts
    features: Mapping[str, Sequence[Feature]]
    attitudes: Mapping[str, Floats]
    locators: frozenset[str]
    notes: tuple[str, ...]
    marks: MarkerTracks
    flows: Sequence[Flow] = ()
    failed: Mapping[str, str] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()


@dataclass(frozen=True, eq=False)
class PassPlan:
    """One pass with the views that each plugin wants of it (`plans`, by plugin); `side`: the hand that the face is on, where it is given;
    `doubts`: what speaks against its pictures."""

    name: str
    clip: Clip
    plans: Mapping[str, ViewPlan]
    side: str | None = None
    doubts: tuple[Doubt, ...] = ()

    def travel(self) -> int:
        """Which way the camera goes along the face, by the first plugin that knows; 0 where none does."""
        return next((plan.travel for plan in self.plans.values() if plan.travel), 0)

    def attitude(self) -> Floats | None:
        """world_from_rig (3, 3) at the start, by the first plugin that knows it."""
        return next((plan.world_from_rig for plan in self.plans.values() if plan.world_from_rig is not None), None)

    def locators(self) -> set[str]:
        """The plugins that found the face."""
        return {plugin for plugin, plan in self.plans.items() if plan.world_from_rig is not None}

    def views(self) -> dict[tuple[str, str], ViewSpec]:
        """Views by (plugin, name as the plugin gave it), renamed so that a name is unique in the row."""
        return {
            (plugin, spec.name): replace(spec, name=f"{self.name} / {self._name_of(plugin, spec)}")
            for plugin, plan in self.plans.items()
            for spec in plan.views
        }

    @cached_property
    def plugins_by_view(self) -> dict[ViewSpec, list[str]]:
        """The plugins, by name, that look at each view."""
        views = self.views()
        return {
            spec: [plugin for (plugin, _), other in views.items() if other == spec]
            for spec in dict.fromkeys(views.values())
        }

    def _name_of(self, plugin: str, spec: ViewSpec) -> str:
        """A view's name, with its plugin's before it where another plugin gives another view the same name."""
        alike = [other for plan in self.plans.values() for other in plan.views if other.name == spec.name]
        return spec.name if all(other == spec for other in alike) else f"{plugin} {spec.name}"


def plan_pass(
    name: str,
    row_pass: Pass,
    plugins: Sequence[LoadedPlugin],
    segmenters: SegmenterPool,
    renderer: Renderer,
    attitude: Floats | None,
) -> tuple[PassPlan, PassPreview]:
    """Ask every plugin for its views of a pass. The attitude that one finds is given to those after it.

    `attitude`: world_from_rig (3, 3) of the first frame, where it is known. Raises VideoError where the pictures are no panoramas.
    """
    clip = row_pass.clip
    frames = expected_frames(clip, probe(clip.path, clip.images_fps))
    keys, pairs = preview_frames(clip)
    doubts = require_panoramas(clip.path, keys)
    pass_preview = PassPreview.of_frames(keys, pairs, renderer=renderer, frames=frames)
    manual = {key: Manual(**view.model_dump()) for key, view in row_pass.views.items()}
    plans: dict[str, ViewPlan] = {}
    for plugin in plugins:
        predict = partial(segmenters.detect, plugin)
        plans[plugin.name] = plugin.render_views(pass_preview, predict, row_pass.side, manual, attitude)
        attitude = plans[plugin.name].world_from_rig if attitude is None else attitude
    return PassPlan(name, clip, plans, row_pass.side, doubts), pass_preview


def recordings(passes: Sequence[Pass]) -> dict[str, Hashable]:
    """By name, in which recording a pass's times are: a video, or a folder of pictures at one rate. Frames of one recording with
    one time are one picture, whichever pass they belong to."""
    sources = [
        (row_pass.video, row_pass.fps) if not is_url(row_pass.video) and row_pass.video.is_dir() else row_pass.video
        for row_pass in passes
    ]
    return dict(zip(pass_names(passes), sources, strict=True))


@dataclass(frozen=True, eq=False)
class MeasuredPasses:
    """What a walk over a row's passes gave: its measurements, how each pass was looked at, and, by plugin, its network's looks at the
    views, for those plugins whose structure lies in planes; and the plugins with the networks that looked."""

    measurements: RowMeasurements
    plans: Sequence[PassPlan]
    looks: Mapping[str, Sequence[Look]]
    plugins: Sequence[LoadedPlugin] = ()


def measure_row(
    row: str,
    passes: Sequence[Pass],
    plugins: Sequence[LoadedPlugin],
    monitor: Monitor,
    attitudes: Mapping[str, Floats] | None = None,
    markers: Sequence[Label] = (),
    appearance: bool = False,
) -> MeasuredPasses:
    """Features of all plugins over all passes of a row.

    attitudes: world_from_rig (3, 3) at the start of a pass where an earlier map gives it; markers: those to look for;
    appearance: whether to follow points of any kind in the views of the face.

    Raises SiteError, VideoError, ModelError, PluginError, or StructureError when a pass has too few frames.
    """
    renderer, known = Renderer(), dict(attitudes or {})
    plugins, choices = _with_best_networks(passes[0], plugins, renderer, known.get(pass_names(passes)[0]))
    segmenters = SegmenterPool(plugins)
    walk = RowWalk(
        plugins, segmenters, renderer, MarkerTracker(markers), FlowTracker() if appearance else NullFlowTracker()
    )
    walk.notes += [*segmenters.notes, *(f"row {row}: {choice}" for choice in choices)]
    plans = []
    for name, row_pass in zip(pass_names(passes), passes, strict=True):
        monitor.note(f"row {row}, {name}: choosing the views")
        plan, _ = plan_pass(name, row_pass, plugins, segmenters, renderer, known.get(name))
        walk.over(row, plan, monitor)
        plans.append(plan)
    facts = RowFacts(row, FrameTable(np.array(walk.stamps), tuple(walk.passes)), walk.views, walk.travel)
    failures = failed(plugins)
    measurements = RowMeasurements(
        facts,
        {plugin: [] if plugin in failures else features for plugin, features in walk.features.items()},
        {**walk.attitudes, **known},
        frozenset(walk.locators),
        (*walk.notes, *map(left_out, failures.values())),
        walk.markers.marks,
        walk.flow.flows,
        failures,
        tuple(walk.doubts),
    )
    return MeasuredPasses(measurements, plans, walk.looks, plugins)


def _with_best_networks(
    row_pass: Pass, plugins: Sequence[LoadedPlugin], renderer: Renderer, attitude: Floats | None
) -> tuple[Sequence[LoadedPlugin], list[str]]:
    """The plugins with the networks that see most in the first pass, and a line for each that is not the plugin's own."""
    chosen: list[LoadedPlugin] = []
    for plugin in plugins:
        best = _with_best_network(row_pass, plugin, renderer, attitude) if further_models(plugin) else plugin
        chosen.append(best)
    changed = [plugin for plugin in chosen if plugin.network is not None]
    return chosen, [f"`{plugin.name}` looks with {plugin.model.name}, which sees more here" for plugin in changed]


def _with_best_network(
    row_pass: Pass, plugin: LoadedPlugin, renderer: Renderer, attitude: Floats | None
) -> LoadedPlugin:
    for model in (None, *further_models(plugin)):
        candidate = replace(plugin, network=model)
        try:
            plan, preview = plan_pass("pass 1", row_pass, [candidate], SegmenterPool([candidate]), renderer, attitude)
        except StructureError:
            continue
        if plugin.failure is not None:
            return plugin
        return with_best_network(candidate, plan.plans[plugin.name].views, preview) if model is None else candidate
    return plugin


def rendered(
    clip: Clip,
    first: int,
    report: DecodeReport,
    render: Callable[[Panorama], list[View]],
    monitor: Monitor,
    text: str,
) -> Iterator[tuple[Panorama, list[View]]]:
    """The frames of a clip, numbered from `first`, with their views, which other threads render ahead of their turn."""
    total = expected_frames(clip, probe(clip.path))
    with ThreadPoolExecutor(WORKERS) as pool:
        ahead = ((panorama, pool.submit(render, panorama)) for panorama in panoramas(clip, first, report))
        with prefetch(ahead, DEPTH) as frames:
            for panorama, views in monitor.each(frames, text, total):
                yield panorama, views.result()


class RowWalk:
    """Walks through a row's passes, frame by frame, and gathers what the plugins extract."""

    def __init__(
        self,
        plugins: Sequence[LoadedPlugin],
        segmenters: SegmenterPool,
        renderer: Renderer,
        markers: MarkerTracker,
        flow: FlowTracker,
    ) -> None:
        self.plugins, self.segmenters, self.renderer, self.markers, self.flow = (
            plugins,
            segmenters,
            renderer,
            markers,
            flow,
        )
        self.stamps: list[float] = []
        self.passes: list[str] = []
        self.views: dict[str, ViewSpec] = {}
        self.travel: dict[str, int] = {}
        self.attitudes: dict[str, Floats] = {}
        self.features: dict[str, list[Feature]] = {plugin.name: [] for plugin in plugins}
        self.locators: set[str] = set()
        self.notes: list[str] = []
        self.looks: dict[str, list[Look]] = {plugin.name: [] for plugin in plugins if plugin.has("planes")}
        self.doubts: list[Doubt] = []

    def over(self, row: str, plan: PassPlan, monitor: Monitor) -> None:
        """Walk through one pass. Views are rendered and segmented ahead of their turn by other threads. Raises StructureError where the
        camera's way contradicts what was asked."""
        report, watch, first = DecodeReport(), PassWatch(), len(self.passes)
        text = f"row {row}, {plan.name}: measuring"
        for panorama, views in rendered(
            plan.clip, first, report, lambda shown: self._render(shown, plan), monitor, text
        ):
            watch.update(panorama)
            self._extract(panorama, views, plan)
        if len(self.passes) - first < MIN_FRAMES:
            raise StructureError(
                f"{plan.clip.path}: {len(self.passes) - first} frames in the range of {plan.name} are too few to map from"
            )
        self.doubts += [
            *plan.doubts,
            *require_course(plan.name, plan.clip.path, watch.steps, plan.attitude(), plan.side),
        ]
        self._end_pass(plan, report)
        for note in self.notes:
            monitor.note(note)

    def _end_pass(self, plan: PassPlan, report: DecodeReport) -> None:
        """Keep what is known of a pass as a whole."""
        self.views |= {spec.name: spec for spec in plan.views().values()}
        self.travel[plan.name] = plan.travel()
        attitude = plan.attitude()
        if attitude is not None:
            self.attitudes[plan.name] = attitude
        self.locators |= plan.locators()
        self.notes += [note for views in plan.plans.values() for note in views.notes]
        if not report.complete:
            self.notes.append(f"{plan.clip.path}: {report.text()}")

    def _render(self, panorama: Panorama, plan: PassPlan) -> list[View]:
        """A panorama's views, about which the networks have been asked. Several threads may do this at once."""
        views = [self.renderer.render(panorama, spec) for spec in plan.plugins_by_view if spec.shows(panorama.frame)]
        for view in views:
            for plugin in self._plugins_at(view, plan):
                self.segmenters.prefetch(plugin, view)
        return views

    def _extract(self, panorama: Panorama, views: Sequence[View], plan: PassPlan) -> None:
        """All plugins' features in a frame's views. Plugins are asked by one thread, in order."""
        self.stamps.append(panorama.stamp_s)
        self.passes.append(plan.name)
        self.markers.update(panorama)
        for view in views:
            if plan.locators().intersection(plan.plugins_by_view[view.spec]):
                self.flow.update(view)
            for plugin in self._plugins_at(view, plan):
                self.features[plugin.name] += plugin.extract_features(
                    view, self.segmenters.detect(plugin, view), panorama
                )
                if plugin.name in self.looks:
                    self.looks[plugin.name].append(Look.of(view, self.segmenters.predict(plugin, view)))

    def _plugins_at(self, view: View, plan: PassPlan) -> list[LoadedPlugin]:
        return [plugin for plugin in self.plugins if plugin.name in plan.plugins_by_view[view.spec]]
