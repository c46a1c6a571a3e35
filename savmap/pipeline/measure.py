"""The only walk over pixels: every frame decoded once, in order; every view rendered and segmented once."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

import numpy as np

from savmap.errors import StructureError, VideoError
from savmap.pipeline.cutting import Cut, FaceStrips, FloorCutter, Stills, StripCutter
from savmap.pipeline.networks import network_lines, with_best_networks
from savmap.pipeline.records import FrameJournal, FrameRecord, RowMeasurements, RowRequest
from savmap.pipeline.trust.footage import require_course
from savmap.pipeline.view_plans import PassPlan, plan_pass
from savmap.plugin.isolation import failed, left_out
from savmap.plugin.manager import LoadedPlugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.model import MIN_FRAMES, Pass, pass_names
from savmap.types import (
    Doubt,
    Feature,
    Floats,
    FrameTable,
    Panorama,
    RowFacts,
    RowStrips,
    Still,
    Strip,
    View,
    ViewSpec,
)
from savmap.types.progress import Monitor
from savmap.video.clip import is_folder, too_few
from savmap.video.motion import PassWatch
from savmap.video.prefetch import prefetch
from savmap.video.reader import Clip, DecodeReport, expected_frames, panoramas, probe
from savmap.vision.evidence import PackedView
from savmap.vision.flow import FlowTracker, NullFlowTracker
from savmap.vision.markers import MarkerTracker
from savmap.vision.views import Renderer

WORKERS, DEPTH = 2, 3
MEASURING = "measuring"
Item = TypeVar("Item")


@dataclass(frozen=True, eq=False)
class WalkJournal:
    """What a journal has of a walk over the frames of a pass; nothing without a journal. What is measured once one of
    the plugins has failed is not kept: it is tried again next time."""

    journal: FrameJournal | None
    walk: str
    plugins: Sequence[LoadedPlugin]

    def get(self, frame: int) -> FrameRecord | None:
        """What was measured in a frame before the run was cut off."""
        return self.journal.get(self.walk, frame) if self.journal else None

    def add(self, frame: int, record: FrameRecord) -> FrameRecord:
        """Keep what is measured in a frame."""
        if self.journal and not failed(self.plugins):
            self.journal.add(self.walk, frame, record)
        return record


def recordings(passes: Sequence[Pass]) -> dict[str, Hashable]:
    """By name, in which recording a pass's times are: a video, or a folder of pictures at one rate. Frames of one
    recording with one time are one picture, whichever pass they belong to."""
    sources = [(row_pass.video, row_pass.rate) if is_folder(row_pass.video) else row_pass.video for row_pass in passes]
    return dict(zip(pass_names(passes), sources, strict=True))


def frames_of(passes: Sequence[Pass]) -> int:
    """Roughly how many panoramas passes give; 1 where one cannot be read, which measuring it will tell."""
    clips = [row_pass.clip for row_pass in passes]
    try:
        return sum(expected_frames(clip, probe(clip.path, clip.images_fps)) for clip in clips)
    except VideoError:
        return 1


@dataclass(frozen=True, eq=False)
class MeasuredPasses:
    """What was measured in all passes of a row.

    plans: the views of each pass. packed_views: by plugin, for those whose structure lies in planes. plugins: with the
    networks that were used. strips: for an orthophoto. floor: views of the floor, whose specifications are in
    `floor_views`.
    """

    measurements: RowMeasurements
    plans: Sequence[PassPlan]
    packed_views: Mapping[str, Sequence[PackedView]]
    plugins: Sequence[LoadedPlugin] = ()
    strips: RowStrips = field(default_factory=RowStrips)
    floor: tuple[PackedView, ...] = ()
    floor_views: Mapping[str, ViewSpec] = field(default_factory=dict)


def measure_row(row: RowRequest, monitor: Monitor) -> MeasuredPasses:
    """Features of all plugins over all passes of a row.

    Raises SiteError, VideoError, ModelError, PluginError, or StructureError when a pass has too few frames.
    """
    renderer, attitudes = Renderer(), row.attitudes
    first, *others = zip(pass_names(row.passes), row.passes, strict=True)
    monitor.note(f"row {row.name}, {first[0]}: choosing the views")
    plugins, first_plan = with_best_networks(*first, row.plugins, renderer, attitudes.get(first[0]))
    segmenters = SegmenterPool(plugins)
    floor, face = FloorCutter(renderer), FaceStrips(renderer)
    walk = RowWalk(
        plugins,
        segmenters,
        renderer,
        MarkerTracker([(marker.dictionary, marker.number) for marker in row.gauge_references.markers]),
        FlowTracker() if row.appearance else NullFlowTracker(),
        [floor, *([face] if row.strips else []), *([Stills()] if row.stills else [])],
        row.journal,
    )
    walk.notes += [*segmenters.notes, *(f"row {row.name}: {line}" for line in network_lines(plugins))]
    walk.over(row.name, first_plan, monitor)
    plans = [first_plan]
    for name, row_pass in others:
        monitor.note(f"row {row.name}, {name}: choosing the views")
        plan, _ = plan_pass(name, row_pass, plugins, segmenters, renderer, attitudes.get(name))
        walk.over(row.name, plan, monitor)
        plans.append(plan)
    failures = failed(plugins)
    measurements = RowMeasurements(
        facts=RowFacts(row.name, FrameTable(np.array(walk.stamps), tuple(walk.passes)), walk.views, walk.travel),
        features={plugin: [] if plugin in failures else features for plugin, features in walk.features.items()},
        attitudes={**walk.attitudes, **attitudes},
        locators=frozenset(walk.locators),
        notes=(*walk.notes, *map(left_out, failures.values())),
        marks=walk.markers.marks,
        flows=walk.flow.flows,
        failed=failures,
        doubts=tuple(walk.doubts),
        skipped=walk.skipped,
    )
    return MeasuredPasses(
        measurements,
        plans,
        walk.packed_views,
        plugins,
        strips=RowStrips(face.views, walk.cuts_of(Strip), walk.cuts_of(Still)),
        floor=walk.cuts_of(PackedView),
        floor_views=floor.views,
    )


def rendered(
    clip: Clip,
    first: int,
    report: DecodeReport,
    render: Callable[[Panorama], Item],
    monitor: Monitor,
    text: str,
) -> Iterator[tuple[Panorama, Item]]:
    """The frames of a clip, numbered from `first`, with what is rendered of them, which other threads do ahead of their
    turn."""
    total = expected_frames(clip, probe(clip.path, clip.images_fps))
    with ThreadPoolExecutor(WORKERS) as pool:
        ahead = ((panorama, pool.submit(render, panorama)) for panorama in panoramas(clip, first, report))
        with prefetch(ahead, DEPTH) as frames:
            for panorama, shown in monitor.each(frames, text, total):
                yield panorama, shown.result()


class RowWalk:
    """Walks through a row's passes, frame by frame, and gathers what the plugins extract. Frames that the journal has
    are only decoded."""

    def __init__(
        self,
        plugins: Sequence[LoadedPlugin],
        segmenters: SegmenterPool,
        renderer: Renderer,
        markers: MarkerTracker,
        flow: FlowTracker,
        cutters: Sequence[StripCutter] = (),
        journal: FrameJournal | None = None,
    ) -> None:
        self.plugins, self.segmenters, self.renderer = plugins, segmenters, renderer
        self.markers, self.flow, self.cutters, self.journal = markers, flow, cutters, journal
        self.stamps: list[float] = []
        self.passes: list[str] = []
        self.views: dict[str, ViewSpec] = {}
        self.travel: dict[str, int] = {}
        self.attitudes: dict[str, Floats] = {}
        self.features: dict[str, list[Feature]] = {plugin.name: [] for plugin in plugins}
        self.locators: set[str] = set()
        self.notes: list[str] = []
        self.packed_views: dict[str, list[PackedView]] = {plugin.name: [] for plugin in plugins if plugin.has("planes")}
        self.cuts: list[Cut] = []
        self.doubts: list[Doubt] = []
        self.skipped = 0

    def cuts_of(self, kind: type[Item]) -> tuple[Item, ...]:
        """What was cut of one kind, in the order of the frames."""
        return tuple(cut for cut in self.cuts if isinstance(cut, kind))

    def over(self, row: str, plan: PassPlan, monitor: Monitor) -> None:
        """Walk through one pass. Views are rendered and segmented ahead of their turn by other threads."""
        report, watch, first = DecodeReport(), PassWatch(), len(self.passes)
        for cutter in self.cutters:
            cutter.begin(plan, next((name for name in self.packed_views if plan.plans[name].views), None))
        text = f"row {row}, {plan.name}: measuring"
        kept = WalkJournal(self.journal, MEASURING, self.plugins)
        render = partial(self._render, plan=plan, kept=kept)
        for panorama, (views, record) in rendered(plan.clip, first, report, render, monitor, text):
            watch.update(panorama)
            self._follow(panorama, views, plan)
            if not isinstance(record, FrameRecord):
                record = kept.add(panorama.frame, self._measured(panorama, views, record, plan))
            self._take(record)
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

    def _render(
        self, panorama: Panorama, plan: PassPlan, kept: WalkJournal
    ) -> tuple[list[View], FrameRecord | list[Cut]]:
        """A panorama's views, about which the networks have been asked, and what is cut of it. Several threads may do
        this at once. Of a frame that is kept, its record, and the views, if points are followed in them."""
        record = kept.get(panorama.frame)
        if record is not None and isinstance(self.flow, NullFlowTracker):
            return [], record
        views = [self.renderer.render(panorama, spec) for spec in plan.plugins_by_view if spec.shows(panorama.frame)]
        if record is not None:
            return views, record
        for view in views:
            for plugin in self._plugins_at(view, plan):
                self.segmenters.prefetch(plugin, view)
        return views, [cut for cutter in self.cutters for cut in cutter.cut(panorama)]

    def _follow(self, panorama: Panorama, views: Sequence[View], plan: PassPlan) -> None:
        """Go on to a frame with what is followed from each frame to the next."""
        self.stamps.append(panorama.stamp_s)
        self.passes.append(plan.name)
        self.markers.update(panorama)
        for view in views:
            if plan.locators().intersection(plan.plugins_by_view[view.spec]):
                self.flow.update(view)

    def _take(self, record: FrameRecord) -> None:
        """Take what was measured in a frame."""
        for name, features in self.features.items():
            features += record.features.get(name, ())
        for name, packed_views in self.packed_views.items():
            packed_views += record.packed_views.get(name, ())
        self.cuts += record.cuts

    def _measured(self, panorama: Panorama, views: Sequence[View], cuts: Sequence[Cut], plan: PassPlan) -> FrameRecord:
        """All plugins' features in a frame's views, and these packed. Plugins are asked by one thread, in order."""
        features: dict[str, list[Feature]] = {name: [] for name in self.features}
        packed_views: dict[str, list[PackedView]] = {name: [] for name in self.packed_views}
        for view in views:
            for plugin in self._plugins_at(view, plan):
                detections = self.segmenters.detect(plugin, view)
                features[plugin.name] += plugin.extract_features(view, detections, panorama)
                if plugin.name in packed_views:
                    packed_views[plugin.name].append(PackedView.of(view, self.segmenters.predict(plugin, view)))
        return FrameRecord(features, packed_views, cuts)

    def _plugins_at(self, view: View, plan: PassPlan) -> list[LoadedPlugin]:
        return [plugin for plugin in self.plugins if plugin.name in plan.plugins_by_view[view.spec]]
