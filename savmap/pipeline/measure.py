"""The only walk over pixels: every frame decoded once, in order; every view rendered and segmented once."""

from collections.abc import Hashable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from savmap.errors import StructureError
from savmap.files.urls import is_url
from savmap.plugin.isolation import failed, left_out
from savmap.plugin.manager import LoadedPlugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.model import Pass
from savmap.types import Feature, Floats, Flow, FrameTable, Panorama, RowFacts, View, ViewPlan, ViewSpec
from savmap.types.progress import Monitor
from savmap.video.prefetch import prefetch
from savmap.video.reader import Clip, DecodeReport, expected_frames, panoramas, preview_frames, probe
from savmap.vision.flow import FlowWatch, NoFlow
from savmap.vision.markers import Label, MarkerWatch, Marks
from savmap.vision.view_planning import Manual, PassPreview
from savmap.vision.views import Renderer

MIN_FRAMES = 3
WORKERS, DEPTH = 2, 3


@dataclass(frozen=True)
class RowMeasurements:
    """What was seen of a row: its facts, each room's features, the first attitude of every pass that is known, the markers,
    and points that were followed. `failed`: by room, how its plugin failed, where the row is mapped without it."""

    facts: RowFacts
    features: Mapping[str, Sequence[Feature]]
    attitudes: Mapping[str, Floats]
    locators: frozenset[str]
    notes: tuple[str, ...]
    marks: Marks
    flows: Sequence[Flow] = ()
    failed: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class PassPlan:
    """One pass with what each room wants to see of it."""

    name: str
    clip: Clip
    aims: Mapping[str, ViewPlan]

    def first(self, attribute: str) -> object:
        """The first aim's answer that is not empty."""
        answers = (getattr(aim, attribute) for aim in self.aims.values())
        return next((answer for answer in answers if answer is not None and np.any(answer)), None)

    def knows_face(self, plugin: str) -> bool:
        """Whether a room found the face."""
        return self.aims[plugin].world_from_rig is not None

    def views(self) -> dict[tuple[str, str], ViewSpec]:
        """Views by (room, name as the room gave it), renamed so that a name is unique in the row."""
        return {
            (plugin, spec.name): replace(
                spec, name=f"{self.name} / {spec.name}" if self._alone(spec) else f"{self.name} / {plugin} {spec.name}"
            )
            for plugin, aim in self.aims.items()
            for spec in aim.views
        }

    @cached_property
    def watched(self) -> dict[ViewSpec, list[str]]:
        """The rooms, by name, that look at each view."""
        views = self.views()
        return {
            spec: [plugin for (plugin, _), own in views.items() if own == spec]
            for spec in dict.fromkeys(views.values())
        }

    def _alone(self, spec: ViewSpec) -> bool:
        return all(other == spec for aim in self.aims.values() for other in aim.views if other.name == spec.name)


def clip_of(one: Pass) -> Clip:
    """The part of a video that a pass of the site file means."""
    return Clip(one.video, one.start_s or None, one.end_s, one.fps)


def plan_pass(
    name: str,
    one: Pass,
    plugins: Sequence[LoadedPlugin],
    segmenters: SegmenterPool,
    renderer: Renderer,
    attitude: Floats | None,
) -> tuple[PassPlan, PassPreview]:
    """Ask every room for its views of a pass; what one finds out about the attitude, the next is told."""
    clip = clip_of(one)
    frames = expected_frames(clip, probe(clip.path, clip.images_fps))
    pass_preview = PassPreview.look(*preview_frames(clip), renderer=renderer, frames=frames)
    manual = {key: Manual(**view.model_dump()) for key, view in one.views.items()}
    aims: dict[str, ViewPlan] = {}
    for plugin in plugins:
        predict = partial(segmenters.detections, plugin)
        aims[plugin.name] = plugin.render_views(pass_preview, predict, one.side, manual, attitude)
        attitude = aims[plugin.name].world_from_rig if attitude is None else attitude
    return PassPlan(name, clip, aims), pass_preview


def pass_names(passes: Sequence[Pass]) -> list[str]:
    """Names of a row's passes, in order."""
    return [f"pass {number}" for number in range(1, len(passes) + 1)]


def recordings(passes: Sequence[Pass]) -> dict[str, Hashable]:
    """By name, in which recording a pass's times are: a video, or a folder of pictures at one rate. Frames of one recording with
    one time are one picture, whichever pass they belong to."""
    where = [(one.video, one.fps) if not is_url(one.video) and one.video.is_dir() else one.video for one in passes]
    return dict(zip(pass_names(passes), where, strict=True))


def observe(
    row: str,
    passes: Sequence[Pass],
    plugins: Sequence[LoadedPlugin],
    monitor: Monitor,
    attitudes: Mapping[str, Floats] | None = None,
    markers: Sequence[Label] = (),
    appearance: bool = False,
) -> RowMeasurements:
    """Features of all rooms over all passes of a row.

    attitudes: world_from_rig (3, 3) at the start of a pass where an earlier map gives it; markers: those to look for;
    appearance: whether to follow points of any kind in the views of the face. Raises SiteError, VideoError, ModelError, PluginError, or StructureError when a pass has too few frames.
    """
    segmenters, renderer = SegmenterPool(plugins), Renderer()
    known = dict(attitudes or {})
    walk = Walk(plugins, segmenters, renderer, MarkerWatch(markers), FlowWatch() if appearance else NoFlow())
    walk.notes += segmenters.notes
    for name, one in zip(pass_names(passes), passes, strict=True):
        monitor.note(f"row {row}, {name}: aiming the views")
        aimed, _ = plan_pass(name, one, plugins, segmenters, renderer, known.get(name))
        walk.over(row, aimed, monitor)
    facts = RowFacts(row, FrameTable(np.array(walk.stamps), tuple(walk.passes)), walk.views, walk.travel)
    out = failed(plugins)
    return RowMeasurements(
        facts,
        {name: [] if name in out else own for name, own in walk.features.items()},
        {**walk.attitudes, **known},
        frozenset(walk.locators),
        (*walk.notes, *map(left_out, out.values())),
        walk.watch.marks,
        walk.flow.flows,
        out,
    )


class Walk:
    """Gathers what the rooms see as passes are walked through."""

    def __init__(
        self,
        plugins: Sequence[LoadedPlugin],
        segmenters: SegmenterPool,
        renderer: Renderer,
        watch: MarkerWatch,
        flow: FlowWatch,
    ) -> None:
        self.plugins, self.segmenters, self.renderer, self.watch, self.flow = plugins, segmenters, renderer, watch, flow
        self.stamps: list[float] = []
        self.passes: list[str] = []
        self.views: dict[str, ViewSpec] = {}
        self.travel: dict[str, int] = {}
        self.attitudes: dict[str, Floats] = {}
        self.features: dict[str, list[Feature]] = {plugin.name: [] for plugin in plugins}
        self.locators: set[str] = set()
        self.notes: list[str] = []

    def over(self, row: str, aimed: PassPlan, monitor: Monitor) -> None:
        """Walk through one pass."""
        report = DecodeReport()
        first = len(self.passes)
        total = expected_frames(aimed.clip, probe(aimed.clip.path))
        with ThreadPoolExecutor(WORKERS) as pool:
            looks = (
                (panorama, pool.submit(self._look, panorama, aimed))
                for panorama in panoramas(aimed.clip, first, report)
            )
            with prefetch(looks, DEPTH) as frames:
                for panorama, views in monitor.each(frames, f"row {row}, {aimed.name}: looking", total):
                    self._frame(panorama, views.result(), aimed)
        if len(self.passes) - first < MIN_FRAMES:
            raise StructureError(
                f"{aimed.clip.path}: {len(self.passes) - first} frames in the range of {aimed.name} are too few to map from"
            )
        self._keep(aimed, report)
        for note in self.notes:
            monitor.note(note)

    def _keep(self, aimed: PassPlan, report: DecodeReport) -> None:
        self.views |= {spec.name: spec for spec in aimed.views().values()}
        travel, attitude = aimed.first("travel"), aimed.first("world_from_rig")
        self.travel[aimed.name] = travel if isinstance(travel, int) else 0
        if isinstance(attitude, np.ndarray):
            self.attitudes[aimed.name] = attitude
        self.locators |= {plugin for plugin in aimed.aims if aimed.knows_face(plugin)}
        self.notes += [note for aim in aimed.aims.values() for note in aim.notes]
        if not report.complete:
            self.notes.append(f"{aimed.clip.path}: {report.text()}")

    def _look(self, panorama: Panorama, aimed: PassPlan) -> list[View]:
        """A panorama's views, about which the networks have been asked. Several threads may do this at once."""
        views = [self.renderer.render(panorama, spec) for spec in aimed.watched if spec.shows(panorama.frame)]
        for view in views:
            for plugin in self._rooms_at(view, aimed):
                self.segmenters.prefetch(plugin, view)
        return views

    def _frame(self, panorama: Panorama, views: Sequence[View], aimed: PassPlan) -> None:
        """What all rooms see in a frame's views; plugins are asked by one thread, in order."""
        self.stamps.append(panorama.stamp_s)
        self.passes.append(aimed.name)
        self.watch.look(panorama)
        for view in views:
            if any(aimed.knows_face(plugin) for plugin in aimed.watched[view.spec]):
                self.flow.look(view)
            for plugin in self._rooms_at(view, aimed):
                detections = self.segmenters.detections(plugin, view)
                self.features[plugin.name] += plugin.extract_features(view, detections, panorama)

    def _rooms_at(self, view: View, aimed: PassPlan) -> list[LoadedPlugin]:
        return [plugin for plugin in self.plugins if plugin.name in aimed.watched[view.spec]]
