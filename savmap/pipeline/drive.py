"""The drive: the only walk over pixels. Every frame is decoded once, whichever rows are seen in it, and points are
followed to it, which tell where the camera went. Frames before which it moved on are measured in: every view of these
is rendered and segmented once. What comes after it works on what is kept here: the path, features, packed views, and
strips of the panoramas.
"""

from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from types import TracebackType
from typing import TypeVar

import numpy as np

from savmap.errors import SavmapError, StructureError, VideoError
from savmap.files.journal import Journal
from savmap.pipeline.cutting import Cut, FaceStrips, FloorCutter, Stills, StripCutter
from savmap.pipeline.key_frames import KeyFrames, front
from savmap.pipeline.lens_walks import LensPoints, LensWalk, LensWay
from savmap.pipeline.records import (
    DriveFrame,
    FrameRecord,
    RowMeasurements,
    RowRequest,
    WalkedRow,
    drive_of,
    each,
    strips_of,
)
from savmap.pipeline.trust.footage import require_course
from savmap.pipeline.view_plans import PassPlan, looked_at, plan_pass, plan_shown
from savmap.plugin.isolation import failed, left_out
from savmap.plugin.manager import LoadedPlugin
from savmap.plugin.segmenters import SegmenterPool, close_unused
from savmap.site.model import MIN_FRAMES, Footage, Pass, pass_names
from savmap.types import (
    Feature,
    FilmedPanorama,
    Floats,
    Flow,
    FrameTable,
    Ints,
    MapWarning,
    Panorama,
    RowFacts,
    RowStrips,
    Still,
    Strip,
    Trajectory,
    View,
    ViewSpec,
)
from savmap.types.progress import Monitor
from savmap.types.written import FIGURE
from savmap.video.clip import is_folder, too_few
from savmap.video.motion import PassWatch, Steps
from savmap.video.prefetch import prefetch
from savmap.video.reader import Clip, DecodeReport, expected_frames, panoramas, probe_clip
from savmap.vision.evidence import PackedView
from savmap.vision.markers import MarkerTracker
from savmap.vision.odometry import Followed, Follower, Odometry, WalkedPath, flows
from savmap.vision.strips import PanoramaStrip, packed_grey, region_of, unpacked_grey
from savmap.vision.view_planning import PassPreview
from savmap.vision.views import Region, Renderer, tones_of

WORKERS, DEPTH = 2, 3
CutKind = TypeVar("CutKind", bound=Cut)

Planned = tuple[RowRequest, PassPlan]
"""A row, and the views of its first pass."""
Rendered = tuple[Sequence[View], Sequence[Cut], PanoramaStrip | None] | FrameRecord
"""Of a frame: views, cuts and a strip, or what was kept of it."""


def recordings(passes: Sequence[Pass]) -> dict[str, Hashable]:
    """By name, in which recording a pass's times are: a video, or a folder of pictures at one rate. Frames of one
    recording with one time are one picture, whichever pass they belong to."""
    sources = [(row_pass.video, row_pass.rate) if is_folder(row_pass.video) else row_pass.video for row_pass in passes]
    return dict(zip(pass_names(passes), sources, strict=True))


def frames_of(passes: Sequence[Pass]) -> int:
    """Roughly how many panoramas passes give, those that are the same frames once; 1 where one cannot be read, which
    the drive will tell."""
    clips = {row_pass.footage: row_pass.clip for row_pass in passes}.values()
    try:
        return sum(expected_frames(clip, probe_clip(clip)) for clip in clips)
    except VideoError:
        return 1


def walk(requests: Sequence[RowRequest], journal: Journal, monitor: Monitor) -> list[WalkedRow | SavmapError]:
    """Walk once along all footage in which rows are seen. A row that cannot be measured comes back as its error: a
    SiteError, VideoError, ModelError, PluginError, or a StructureError where a pass has too few frames."""
    renderer = Renderer()
    previews: dict[Footage, tuple[Pass, PassPreview, LensWalk | None]] = {}
    planned = each(requests, lambda row: _planned(row, previews, renderer, monitor))
    previews.clear()
    networks = [plugin for item in planned if not isinstance(item, SavmapError) for plugin in item[0].plugins]
    segmenters = SegmenterPool(networks)
    close_unused()
    walks = each(planned, lambda item: RowWalk(item, segmenters, renderer, journal))
    for footage in dict.fromkeys(row_pass.footage for request in requests for row_pass in request.passes):
        rows = [row for row in walks if isinstance(row, RowWalk) and footage in row.passes]
        _drive_through(footage, without_failed(rows), renderer, monitor)
    return each(walks, lambda row: row.failure or row.walked())


def _drive_through(footage: Footage, rows: "Sequence[RowWalk]", renderer: Renderer, monitor: Monitor) -> None:
    """Measure one pass of rows, which is the same footage."""
    for row in rows:
        row.attempt(partial(row.begin, *row.passes[footage], monitor))
    rows = without_failed(rows)
    if rows:
        drive_along(rows[0].plan.clip, rows, renderer, monitor)


def without_failed(rows: "Sequence[RowWalk]") -> "list[RowWalk]":
    """The walks that go on."""
    return [row for row in rows if row.failure is None]


def _planned(
    row: RowRequest,
    previews: dict[Footage, tuple[Pass, PassPreview, LensWalk | None]],
    renderer: Renderer,
    monitor: Monitor,
) -> Planned:
    """Choose the views of the first pass. Rows that are seen in the same footage share its
    preview."""
    if row.plugins and all(plugin.needs_path for plugin in row.plugins):
        require_path(row.name, row.plugins[0], row.path)
    name, row_pass = pass_names(row.passes)[0], row.passes[0]
    monitor.note(f"row {row.name}, {name}: choosing the views")
    if row_pass.footage not in previews:
        previews[row_pass.footage] = looked_at(row_pass, renderer)
    with_camera, preview, walk = previews[row_pass.footage]
    row_pass = row_pass.model_copy(update={"camera": with_camera.camera})
    return row, plan_shown(name, row_pass, row.plugins, preview, row.attitudes.get(name), walk)


def require_path(row: str, plugin: LoadedPlugin, path: Trajectory | None) -> None:
    """Raise StructureError where a plugin that cannot locate the camera would be asked to track without the camera's
    path."""
    if plugin.needs_path and path is None:
        raise StructureError(
            f"row {row}: `{plugin.name}` alone does not locate the camera: add a plugin that maps the face "
            f"(--plugins NAME,{plugin.name}), or give an earlier map with --trajectory"
        )


def drive_along(clip: Clip, rows: "Sequence[RowWalk]", renderer: Renderer, monitor: Monitor) -> None:
    """Drive along a clip. Rows that cannot be measured keep their failure."""
    names = f"row {rows[0].name}" if len(rows) == 1 else f"rows {' and '.join(row.name for row in rows)}"
    report, text = DecodeReport(), f"{names}, {rows[0].plan.name}: measuring"
    with Drive(rows, renderer, report) as drive:
        try:
            total = expected_frames(clip, probe_clip(clip))
            known_s = drive.resume()
            with prefetch(panoramas(clip, 0, report, known_s, drive.wanted), 1) as frames:
                for panorama in monitor.each(frames, text, total - len(known_s)):
                    drive.add(panorama)
                    if not drive.rows:
                        break
            drive.finish()
        except VideoError as error:
            for row in drive.rows:
                row.failure = error
        for row in drive.rows:
            for note in row.notes:
                monitor.note(note)


class Drive:
    """Footage that is walked along once, for all rows that are seen in it. `add` takes the frames in order, and needs
    none of those that follow; `finish` ends it. Views are rendered and segmented ahead of their turn by other threads.

    `report`: of the frames' decoding.
    """

    def __init__(self, rows: "Sequence[RowWalk]", renderer: Renderer, report: DecodeReport) -> None:
        self._all, self.renderer, self.report = rows, renderer, report
        self._journal, self._series = rows[0].journal, drive_of(rows[0].name, rows[0].plan.name)
        self._watch = PassWatch()
        walk, towards = rows[0].plan.walk, [row.towards for row in rows]
        self._follower = Follower() if walk is None else LensPoints(walk)
        self._way = Way(towards) if walk is None else Way(towards, LensWay(walk))
        self._known = list[DriveFrame]()
        self._points = 0
        self._pool = ThreadPoolExecutor(WORKERS, "savmap-render")
        self._ahead: deque[tuple[dict[int, Panorama], Future[dict[int, Rendered | SavmapError]]]] = deque()

    def __enter__(self) -> "Drive":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pool.shutdown(cancel_futures=True)

    @property
    def rows(self) -> "list[RowWalk]":
        """The walks that still go on."""
        return without_failed(self._all)

    @property
    def wanted(self) -> set[int] | None:
        """The numbers of the frames that will be measured in, where a walk tells them beforehand; else None."""
        walk = self._all[0].plan.walk
        if walk is None or any(row.request.path_s is not None for row in self._all):
            return None
        way = Way([row.towards for row in self._all], LensWay(walk))
        return {frame for frame in range(int(walk.frames[-1]) + 1) if way.take(walk.followed(frame))}

    def resume(self) -> list[float]:
        """Take the first frames as far as an earlier run kept them, without their pictures: their times, but for the
        last, whose picture is needed to follow points on from there. None where markers are followed in the pictures,
        or a frame is known to be lost."""
        kept, numbers = list[DriveFrame](), [row.next for row in self.rows]
        while (frame := self._journal.get(DriveFrame, self._series, len(kept))) is not None:
            wanted = [row.wants(frame.stamp_s, frame.is_key) for row in self.rows]
            asked = zip(self.rows, numbers, wanted, strict=True)
            if not all(row.knows(number, frame.stamp_s) for row, number, w in asked if w):
                break
            kept.append(frame)
            numbers = [number + w for number, w in zip(numbers, wanted, strict=True)]
        whole_until_s = max((frame.whole_until_s for frame in kept), default=-np.inf)
        self._known = [frame for frame in kept if frame.stamp_s <= whole_until_s]
        while self._known and not len(self._known[-1].followed.numbers):
            self._known.pop()
        for number, frame in enumerate(self._known):
            self._watch.take(frame.stamp_s, unpacked_grey(frame.grey))
            self._way.take(frame.followed)
            self._points = max(self._points, 1 + int(frame.followed.numbers.max(initial=-1)))
            for row in self.rows:
                if row.wants(frame.stamp_s, frame.is_key):
                    row.take_known(number, frame.stamp_s, self._way)
        before = self._known[:-1]
        self.report.decoded, self.report.decoded_by = before[-1].decoded if before else 0, [f.decoded for f in before]
        return [frame.stamp_s for frame in before]

    def add(self, panorama: Panorama) -> None:
        """Take the next frame; its number is that in the drive."""
        if panorama.frame < len(self._known):
            self._follower.go_on(panorama, self._known[panorama.frame].followed, self._points)
            self._follower.forget(self._way.unfit)
            return
        grey = packed_grey(self._watch.update(panorama))
        followed = self._follower.update(panorama)
        is_key = self._way.take(followed)
        self._follower.forget(self._way.unfit)
        decoded = self.report.decoded_by[panorama.frame] if panorama.frame < len(self.report.decoded_by) else 0
        kept = DriveFrame(panorama.stamp_s, grey, decoded, self.report.whole_until_s, followed, is_key)
        self._journal.add(self._series, panorama.frame, kept)
        wanting = [row for row in self.rows if row.wants(panorama.stamp_s, is_key)]
        if wanting:
            shown = {id(row): numbered(panorama, row.counted(panorama.frame, self._way)) for row in wanting}
            self._ahead.append((shown, self._pool.submit(self._rendered, shown, wanting)))
        if len(self._ahead) >= DEPTH:
            self._take()

    def snapshot(self) -> list[WalkedRow]:
        """What was measured of each row that goes on, up to the last frame."""
        while self._ahead:
            self._take()
        for row in self.rows:
            row.lay(self._way.odometry.path)
        return [row.walked() for row in self.rows]

    def finish(self) -> None:
        """End the drive."""
        while self._ahead:
            self._take()
        for row in self.rows:
            row.lay(self._way.odometry.path)
            row.attempt(partial(row.end, self.report, self._watch.steps, self._way.odometry.path))

    def _take(self) -> None:
        shown, future = self._ahead.popleft()
        rendered = future.result()
        for row in self.rows:
            if (item := rendered.get(id(row))) is None:
                continue
            if isinstance(item, SavmapError):
                row.failure = item
            else:
                row.attempt(partial(row.take, shown[id(row)], item))

    def _rendered(self, shown: Mapping[int, Panorama], rows: "Sequence[RowWalk]") -> dict[int, Rendered | SavmapError]:
        """What each row needs of a panorama; a view that several ask for is rendered once."""
        views: dict[ViewSpec, View] = {}
        rendered = each(rows, lambda row: row.render(shown[id(row)], views))
        return {id(row): item for row, item in zip(rows, rendered, strict=True)}


class Way:
    """The way of a drive as its frames tell it, in order: the odometry, and which frames are key frames. `towards`:
    unit directions of the faces (3,) in the rig frame, None where one is not known."""

    def __init__(self, towards: Sequence[Floats | None] = (), odometry: Odometry | LensWay | None = None) -> None:
        self.odometry, self.keys = odometry or Odometry(), KeyFrames()
        self.keys.towards = [direction for direction in towards if direction is not None]
        self.followed: Followed | None = None
        """To the latest frame."""
        self.unfit: Ints = np.zeros(0, np.int64)
        """Of the latest frame: points that are to be followed no more."""

    def take(self, followed: Followed) -> bool:
        """Take the points that were followed to the next frame; whether it is a key frame."""
        self.followed, self.unfit = followed, self.odometry.take(followed)
        return self.keys.is_key(followed, self.odometry)

    def front(self, towards: Floats | None) -> float:
        """How far a face lies before the latest frame, in the path's scale; nan where its pose is not known."""
        pose, places = self.odometry.pose, self.odometry.places
        if pose is None or not len(places):
            return float("nan")
        return front((places - pose[:3, 3]) @ pose[:3, :3], () if towards is None else (towards,))


def numbered(panorama: Panorama, frame: int) -> Panorama:
    """A panorama of a drive with its number in a row."""
    if isinstance(panorama, FilmedPanorama):
        return FilmedPanorama(frame, panorama.stamp_s, panorama.planes, panorama.seen)
    return replace(panorama, frame=frame)


def before_face(path: WalkedPath, frames: Ints, fronts: Sequence[float]) -> Trajectory | None:
    """The poses of some frames (n,) of a drive, numbered anew from 0, in the unit of the face's distance, where the
    longest part of the path knows them. `fronts`: how far the face lay before each, in the path's scale."""
    distances = np.array(fronts)
    here = path.part[frames] == path.longest
    faced = here & np.isfinite(distances)
    if not faced.any():
        return None
    poses = path.world_from_rig[frames[here]]
    poses[:, :3, 3] /= float(np.median(distances[faced]))
    return Trajectory(np.flatnonzero(here), poses)


def breaks(name: str, stamps_s: Floats, path: WalkedPath) -> Iterator[MapWarning]:
    """Where the path of a pass breaks off, so that a part of its frames is left out."""
    placed = np.flatnonzero(path.part >= 0)
    for last in placed[:-1][np.diff(path.part[placed]) != 0].tolist():
        line = (
            f"too few points lead from there to the next frame: {(path.part != path.longest).sum()} frames are left out"
        )
        yield MapWarning("missing-frames", figure=f"{name}, at {stamps_s[last]:.1f} s", details=(line,))


class RowWalk:
    """What is measured of one row, pass by pass. Of frames that the journal has from an earlier run only points and
    markers are followed."""

    def __init__(self, planned: Planned, segmenters: SegmenterPool, renderer: Renderer, journal: Journal) -> None:
        self.request, first_plan = planned
        self.plugins = self.request.plugins
        self.name, self.journal = self.request.name, journal
        self.segmenters, self.renderer = segmenters, renderer
        names = zip(pass_names(self.request.passes), self.request.passes, strict=True)
        self.passes: Mapping[Footage, tuple[str, Pass]] = {
            row_pass.footage: (name, row_pass) for name, row_pass in names
        }
        self.plan, self._first_plan = first_plan, first_plan
        self.failure: SavmapError | None = None
        """Why the row cannot be measured."""
        self.next = 0
        """The number of the next frame of the row."""
        self.keys: list[int] = []
        """Of the frames of this pass: their numbers in the drive."""
        self.fronts: list[float] = []
        """How far the face lay before these, in the scale of the drive's path; nan where its pose is not known."""
        self.laid: dict[str, Trajectory] = {}
        self.followed: dict[str, dict[int, Followed]] = {}
        markers = self.request.gauge_references.markers
        self.markers = MarkerTracker([(marker.dictionary, marker.number) for marker in markers])
        self.floor, self.face = FloorCutter(renderer), FaceStrips(renderer)
        self.cutters: list[StripCutter] = [self.floor]
        self.cutters += [self.face] if self.request.strips else []
        self.cutters += [Stills()] if self.request.stills else []
        self.stamps: list[float] = []
        self.pass_of: list[str] = []
        self.views: dict[str, ViewSpec] = {}
        self.travel: dict[str, int] = {}
        self.attitudes: dict[str, Floats] = {}
        self.levelled = set[str]()
        self.features: dict[str, list[Feature]] = {plugin.name: [] for plugin in self.plugins}
        self.packed_views: dict[str, list[PackedView]] = {
            plugin.name: [] for plugin in self.plugins if plugin.has("find")
        }
        self.locators: set[str] = set()
        self.located: set[str] = set()
        """The views that these look at."""
        self.notes = [*segmenters.notes]
        self.cuts: list[Cut] = []
        self.tones: list[Mapping[str, tuple[float, float]]] = []
        self.warnings: list[MapWarning] = []
        self.skipped = 0
        self._region: Region | None = None

    def attempt(self, step: Callable[[], None]) -> None:
        """Take a step of the walk, which may fail."""
        try:
            step()
        except SavmapError as error:
            self.failure = error

    def begin(self, name: str, row_pass: Pass, monitor: Monitor) -> None:
        """Begin a pass: choose its views."""
        if name == self._first_plan.name:
            self.plan = self._first_plan
        else:
            monitor.note(f"row {self.name}, {name}: choosing the views")
            attitude = self.request.attitudes.get(name)
            self.plan = plan_pass(name, row_pass, self.plugins, self.segmenters, self.renderer, attitude)
        self.keys, self.fronts, self._region = [], [], None
        self.views |= {spec.name: spec for spec in self.plan.views().values()}
        self.travel[name] = self.plan.travel()
        if self.plan.walk is not None:
            self.levelled.add(name)
            self.notes.append(f"row {self.name}, {name}: {self.plan.walk.lens_line}")
            self.warnings += self.plan.walk.warnings
        attitude = self.plan.attitude()
        if attitude is not None:
            self.attitudes[name] = attitude
        self.locators |= self.plan.locators()
        self.located |= {spec.name for (name, _), spec in self.plan.views().items() if name in self.plan.locators()}
        for cutter in self.cutters:
            cutter.begin(self.plan, next((name for name in self._faces() if self.plan.plans[name].views), None))

    def _faces(self) -> Iterable[str]:
        """Those whose views may show the face: plugins whose structure lies in planes; without plugins what is planned
        for none."""
        return self.packed_views if self.plugins else self.plan.plans

    def render(self, panorama: Panorama, views: dict[ViewSpec, View]) -> Rendered:
        """A panorama's views, about which the networks have been asked, what is cut of it, and its strip; its record,
        if an earlier run kept it. `views` has those that were rendered for other rows, by their direction and size."""
        record = self._known(panorama.frame, panorama.stamp_s)
        if record is not None:
            return record
        shown = [self._view(panorama, spec, views) for spec in self.plan.plugins_by_view if spec.shows(panorama.frame)]
        for view in shown:
            for plugin in self._plugins_at(view):
                self.segmenters.prefetch(plugin, view)
        cuts = [cut for cutter in self.cutters for cut in cutter.cut(panorama)]
        return shown, cuts, self._strip(panorama)

    @property
    def towards(self) -> Floats | None:
        """The unit direction (3,) of the face in the rig frame, where it is known."""
        attitude = self.plan.attitude()
        return None if attitude is None else attitude.T @ np.array([0.0, 0.0, -1.0])

    def wants(self, stamp_s: float, is_key: bool) -> bool:
        """Whether the row is measured in a frame of the drive: a key frame, or one that an earlier map has."""
        path_s = self.request.path_s
        return is_key if path_s is None else (self.plan.name, round(stamp_s, FIGURE)) in path_s

    def counted(self, number: int, way: Way) -> int:
        """The number in the row of the latest frame of a way, which has this one in the drive."""
        self.keys.append(number)
        self.fronts.append(way.front(self.towards))
        if self.request.appearance and way.followed is not None:
            self.followed.setdefault(self.plan.name, {})[self.next] = way.followed
        self.next += 1
        return self.next - 1

    def lay(self, path: WalkedPath) -> None:
        """Lay the frames of this pass along the path of the drive, in the unit of the face's distance."""
        laid = before_face(path, np.array(self.keys, np.int64), self.fronts)
        if laid is not None:
            self.laid[self.plan.name] = replace(laid, frames=laid.frames + self.next - len(self.keys))

    def knows(self, number: int, stamp_s: float) -> bool:
        """Whether a frame need not be seen again."""
        return not self.request.gauge_references.markers and self._known(number, stamp_s) is not None

    def _known(self, number: int, stamp_s: float) -> FrameRecord | None:
        """What an earlier run measured in the frame of this number, where it was the same one: beside other rows, a row
        may have had more frames."""
        record = self.journal.get(FrameRecord, self.name, number)
        return record if record is not None and record.stamp_s == stamp_s else None

    def take_known(self, number: int, stamp_s: float, way: Way) -> None:
        """Take what an earlier run kept of the latest frame of a way, which has this number in the drive."""
        record = self._known(self.counted(number, way), stamp_s)
        if record is not None:
            self._keep(stamp_s, record)

    def take(self, panorama: Panorama, rendered: Rendered) -> None:
        """Measure in a frame, the next one. Plugins are asked by one thread, in order."""
        self.markers.update(panorama)
        record = rendered if isinstance(rendered, FrameRecord) else self._journaled(panorama, *rendered)
        self._keep(panorama.stamp_s, record)

    def measure_ahead(self, panorama: Panorama, rendered: Rendered) -> None:
        """Measure in a frame before its turn; what is measured is kept in the journal alone."""
        if not isinstance(rendered, FrameRecord):
            self._journaled(panorama, *rendered)

    def take_measured(self, stamp_s: float, record: FrameRecord | None) -> None:
        """Take the next frame, in which this was measured; None: nothing was."""
        self._keep(stamp_s, record or FrameRecord({}))

    def _journaled(
        self, panorama: Panorama, views: Sequence[View], cuts: Sequence[Cut], strip: PanoramaStrip | None
    ) -> FrameRecord:
        """What is measured in a frame's views, kept in the journal."""
        record = self._measured(panorama, views, cuts)
        if strip is not None:
            self.journal.add(strips_of(self.name), panorama.frame, strip)
        if not failed(self.plugins):  # what is measured once a plugin has failed is tried again next time
            self.journal.add(self.name, panorama.frame, record)
        return record

    def _keep(self, stamp_s: float, record: FrameRecord) -> None:
        """Keep what was measured in the next frame."""
        self.stamps.append(stamp_s)
        self.pass_of.append(self.plan.name)
        for name, features in self.features.items():
            features += record.features.get(name, ())
        for name, packed_views in self.packed_views.items():
            packed_views += record.packed_views.get(name, ())
        self.cuts += record.cuts
        self.tones.append(record.tones)

    def end(self, report: DecodeReport, steps: Steps, path: WalkedPath) -> None:
        """End a pass, of whose frames the report tells, how the camera moved from each to the next, and its path."""
        plan, count = self.plan, len(steps.stamps_s)
        if count < MIN_FRAMES:
            raise StructureError(too_few(plan.clip, count, plan.name))
        course = require_course(plan.name, plan.clip, steps, plan.attitude(), plan.side)
        amid = (
            warning if warning.frame is None else replace(warning, frame=self._frame_at(warning.frame))
            for warning in course
        )
        self.warnings += [*plan.warnings, *amid, *breaks(plan.name, steps.stamps_s, path)]
        self.notes += [note for views in plan.plans.values() for note in views.notes]
        self.skipped += report.skipped
        if not report.complete:
            self.notes.append(f"{plan.clip.path}: {report.text()}")

    def _frame_at(self, number: int) -> int:
        """The frame of the row at, or last before, this one of the drive."""
        return self.next - len(self.keys) + max(int(np.searchsorted(self.keys, number, "right")) - 1, 0)

    def walked(self) -> WalkedRow:
        """What was measured so far."""
        failures = failed(self.plugins)
        return WalkedRow(
            self.request,
            RowMeasurements(
                facts=RowFacts(
                    self.name,
                    FrameTable(np.array(self.stamps), tuple(self.pass_of)),
                    self.views,
                    self.travel,
                    self.request.sees_in_part,
                ),
                features={name: [] if name in failures else list(features) for name, features in self.features.items()},
                attitudes={**self.attitudes, **self.request.attitudes},
                locators=frozenset(self.locators),
                notes=(*self.notes, *map(left_out, failures.values())),
                marks=self.markers.marks,
                flows=tuple(self._flows()),
                failed=failures,
                warnings=tuple(self.warnings),
                skipped=self.skipped,
                tones=tuple(self.tones),
                walked=Trajectory.joined([*self.laid.values()]) if self.laid else None,
                levelled=frozenset(self.levelled),
            ),
            strips=RowStrips(self.face.views, self._cuts_of(Strip), self._cuts_of(Still)),
            plugins=self.plugins,
            packed_views=self.packed_views,
            journal=self.journal,
            floor=self._cuts_of(PackedView),
            floor_views=self.floor.views,
        )

    def _flows(self) -> Iterator[Flow]:
        """The points that were followed, where the views of plugins that locate the camera show them."""
        for row_pass, followed in self.followed.items():
            for name, spec in self.views.items():
                if name.startswith(f"{row_pass} / ") and name in self.located:
                    yield from flows(followed, spec)

    def _cuts_of(self, kind: type[CutKind]) -> tuple[CutKind, ...]:
        """What was cut of one kind, in the order of the frames."""
        return tuple(cut for cut in self.cuts if isinstance(cut, kind))

    def _view(self, panorama: Panorama, spec: ViewSpec, views: dict[ViewSpec, View]) -> View:
        """A view of a panorama, rendered unless another row asked for one with this direction and size."""
        key = replace(spec, name="", every=1)
        if key not in views:
            views[key] = self.renderer.render(panorama, spec)
        return View(spec, panorama.frame, panorama.stamp_s, views[key].image)

    def _strip(self, panorama: Panorama) -> PanoramaStrip | None:
        """The part of a panorama that is shown to plugins whose structure lies in planes: its edges may be measured
        once more."""
        specs = [spec for (plugin, _), spec in self.plan.views().items() if plugin in self.packed_views]
        if not any(spec.shows(panorama.frame) for spec in specs):
            return None
        region = self._region or region_of(specs, panorama.height)
        self._region = region
        return PanoramaStrip.of(panorama, region)

    def _measured(self, panorama: Panorama, views: Sequence[View], cuts: Sequence[Cut]) -> FrameRecord:
        """What single views of a frame show of each plugin, and of plugins that find in all frames what they saw,
        packed."""
        features: dict[str, list[Feature]] = {name: [] for name in self.features}
        packed_views: dict[str, list[PackedView]] = {name: [] for name in self.packed_views}
        looked: dict[str, list[View]] = {}
        for view in views:
            for plugin in self._plugins_at(view):
                looked.setdefault(plugin.name, []).append(view)
                if plugin.name in packed_views:
                    seen = self.segmenters.predict(plugin, view)
                    packed_views[plugin.name].append(PackedView.of(view, seen))
                else:
                    detections = self.segmenters.detect(plugin, view)
                    features[plugin.name] += plugin.extract_features(view, detections, panorama)
        tones = {name: tones_of(shown) for name, shown in looked.items()}
        return FrameRecord(features, packed_views, cuts, tones, panorama.stamp_s)

    def _plugins_at(self, view: View) -> list[LoadedPlugin]:
        return [plugin for plugin in self.plugins if plugin.name in self.plan.plugins_by_view[view.spec]]
