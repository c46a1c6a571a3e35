"""The only walk over pixels: every frame decoded once, in order; every view rendered and segmented once."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from savmap.errors import StructureError
from savmap.pipeline.cutting import FaceStrips, FloorCutter, NoStrips, SeveralCutters, Stills, StripCutter
from savmap.pipeline.networks import choices_told, with_best_networks
from savmap.pipeline.trust.footage import require_course
from savmap.pipeline.view_plans import PassPlan, plan_pass
from savmap.plugin.isolation import failed, left_out
from savmap.plugin.manager import LoadedPlugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.model import MIN_FRAMES, Pass, pass_names
from savmap.types import (
    Doubt,
    Feature,
    FlatDepth,
    Floats,
    Flow,
    FrameTable,
    Panorama,
    RowFacts,
    RowStrips,
    View,
    ViewSpec,
)
from savmap.types.progress import Monitor
from savmap.video.clip import is_folder, too_few
from savmap.video.footage.watch import PassWatch
from savmap.video.prefetch import prefetch
from savmap.video.reader import Clip, DecodeReport, expected_frames, panoramas, probe
from savmap.vision.evidence import FloorTracks, PackedView
from savmap.vision.flow import FlowTracker, NullFlowTracker
from savmap.vision.markers import Label, MarkerTracker, MarkerTracks
from savmap.vision.views import Renderer

WORKERS, DEPTH = 2, 3


@dataclass(frozen=True, eq=False)
class RowMeasurements:
    """What was measured in a row's pictures: its facts, features by plugin, the first attitude of every pass that is known, the
    plugins that found the face and so locate the camera, the markers, and points that were followed. `failed`: by plugin, how it
    failed, where the row is mapped without it. `doubts`: what of the footage speaks against what was measured. `depths`: how deep flat
    parts of structures lie. `floor`: points of the floor. `skipped`: how many frames the decoder left out, as the notes say."""

    facts: RowFacts
    features: Mapping[str, Sequence[Feature]]
    attitudes: Mapping[str, Floats]
    locators: frozenset[str]
    notes: tuple[str, ...]
    marks: MarkerTracks
    flows: Sequence[Flow] = ()
    failed: Mapping[str, str] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()
    depths: tuple[FlatDepth, ...] = ()
    floor: FloorTracks = field(default_factory=FloorTracks)
    skipped: int = 0


def recordings(passes: Sequence[Pass]) -> dict[str, Hashable]:
    """By name, in which recording a pass's times are: a video, or a folder of pictures at one rate. Frames of one recording with
    one time are one picture, whichever pass they belong to."""
    sources = [(row_pass.video, row_pass.rate) if is_folder(row_pass.video) else row_pass.video for row_pass in passes]
    return dict(zip(pass_names(passes), sources, strict=True))


@dataclass(frozen=True, eq=False)
class MeasuredPasses:
    """What was measured in all passes of a row.

    plans: the views of each pass. packed_views: by plugin, for those whose structure lies in planes. plugins: with the networks that were
    used. strips: for an orthophoto. floor: views of the floor, whose specifications are in `floor_views`.
    """

    measurements: RowMeasurements
    plans: Sequence[PassPlan]
    packed_views: Mapping[str, Sequence[PackedView]]
    plugins: Sequence[LoadedPlugin] = ()
    strips: RowStrips = field(default_factory=RowStrips)
    floor: tuple[PackedView, ...] = ()
    floor_views: Mapping[str, ViewSpec] = field(default_factory=dict)


def measure_row(
    row: str,
    passes: Sequence[Pass],
    plugins: Sequence[LoadedPlugin],
    monitor: Monitor,
    attitudes: Mapping[str, Floats] | None = None,
    markers: Sequence[Label] = (),
    appearance: bool = False,
    strips: bool = False,
    stills: bool = False,
) -> MeasuredPasses:
    """Features of all plugins over all passes of a row.

    attitudes: world_from_rig (3, 3) at the start of a pass where an earlier map gives it; markers: those to look for;
    appearance: whether to follow points of any kind in the views of the face; strips: whether to keep strips for an orthophoto; stills: whether to keep panoramas to be
    looked at.

    Raises SiteError, VideoError, ModelError, PluginError, or StructureError when a pass has too few frames.
    """
    renderer, known = Renderer(), dict(attitudes or {})
    first, *others = zip(pass_names(passes), passes, strict=True)
    monitor.note(f"row {row}, {first[0]}: choosing the views")
    plugins, first_plan = with_best_networks(*first, plugins, renderer, known.get(first[0]))
    segmenters = SegmenterPool(plugins)
    flow = FlowTracker() if appearance else NullFlowTracker()
    floor = FloorCutter(renderer)
    cutter = SeveralCutters([floor, *([FaceStrips(renderer)] if strips else []), *([Stills()] if stills else [])])
    walk = RowWalk(plugins, segmenters, renderer, MarkerTracker(markers), flow, cutter)
    walk.notes += [*segmenters.notes, *(f"row {row}: {choice}" for choice in choices_told(plugins))]
    walk.over(row, first_plan, monitor)
    plans = [first_plan]
    for name, row_pass in others:
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
        skipped=walk.skipped,
    )
    return MeasuredPasses(
        measurements, plans, walk.packed_views, plugins, cutter.strips(), floor.packed_views, floor.views
    )


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
        cutter: StripCutter | None = None,
    ) -> None:
        self.plugins, self.segmenters, self.renderer = plugins, segmenters, renderer
        self.markers, self.flow, self.cutter = markers, flow, cutter or NoStrips()
        self.stamps: list[float] = []
        self.passes: list[str] = []
        self.views: dict[str, ViewSpec] = {}
        self.travel: dict[str, int] = {}
        self.attitudes: dict[str, Floats] = {}
        self.features: dict[str, list[Feature]] = {plugin.name: [] for plugin in plugins}
        self.locators: set[str] = set()
        self.notes: list[str] = []
        self.packed_views: dict[str, list[PackedView]] = {plugin.name: [] for plugin in plugins if plugin.has("planes")}
        self.doubts: list[Doubt] = []
        self.skipped = 0

    def over(self, row: str, plan: PassPlan, monitor: Monitor) -> None:
        """Walk through one pass. Views are rendered and segmented ahead of their turn by other threads."""
        report, watch, first = DecodeReport(), PassWatch(), len(self.passes)
        self.cutter.begin(plan, next((name for name in self.packed_views if plan.plans[name].views), None))
        text = f"row {row}, {plan.name}: measuring"
        for panorama, views in rendered(
            plan.clip, first, report, lambda shown: self._render(shown, plan), monitor, text
        ):
            watch.update(panorama)
            self._extract(panorama, views, plan)
        if len(self.passes) - first < MIN_FRAMES:
            raise StructureError(too_few(plan.clip, len(self.passes) - first, plan.name))
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
        self.skipped += report.skipped
        if not report.complete:
            self.notes.append(f"{plan.clip.path}: {report.text()}")

    def _render(self, panorama: Panorama, plan: PassPlan) -> list[View]:
        """A panorama's views, about which the networks have been asked. Several threads may do this at once."""
        self.cutter.cut(panorama)
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
                if plugin.name in self.packed_views:
                    self.packed_views[plugin.name].append(PackedView.of(view, self.segmenters.predict(plugin, view)))

    def _plugins_at(self, view: View, plan: PassPlan) -> list[LoadedPlugin]:
        return [plugin for plugin in self.plugins if plugin.name in plan.plugins_by_view[view.spec]]
