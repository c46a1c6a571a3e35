"""`savmap check`: everything that can be known to be wrong with a site file before hours are spent, and what a run will
take, from a few frames of each kind of footage on this machine."""

import resource
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import TypeVar

from savmap.assembly import rows_with_same_face
from savmap.errors import ModelError, SavmapError, SiteError, StructureError, VideoError
from savmap.files.journal import Journal
from savmap.files.serialization import packed
from savmap.jobs.map_site import written_files
from savmap.jobs.preview import planned, write_views
from savmap.jobs.run_clock import MEASURED, PICTURED, SOLVED, FrameCost
from savmap.jobs.tasks import PER_MB, request_for
from savmap.pipeline.drive import RowWalk, drive_along, require_path
from savmap.pipeline.path import warnings_held_back
from savmap.pipeline.records import RowRequest
from savmap.pipeline.view_plans import PassPlan
from savmap.plugin.segmenters import SegmenterPool
from savmap.site import preflight
from savmap.site.job import Job, chosen_plugins, plugins_for
from savmap.site.load import notes_on, problems_in, read_draft, site_of, sound_part
from savmap.site.overrides import Override
from savmap.site.preflight import Footage, Question, Unchecked, with_location
from savmap.types.progress import Monitor
from savmap.video.clip import missing_s
from savmap.video.reader import preview_frames, sampling_fps
from savmap.vision.views import Renderer

Item = TypeVar("Item")
DECODABLE = 0.7
"""The share of a pass up to which key frames must be decodable."""
FRAMES, WARM = 10, 4
UNCHECKED = (
    "not checked, for only a map tells: whether each `side` shows the face that was measured, whether lists have a "
    "value for each part of it, and whether references fit the pictures"
)


class CheckError(SavmapError):
    """What was found; its exit code is that of the first problem."""

    def __init__(self, source: Path, problems: Sequence[SavmapError]) -> None:
        number = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
        super().__init__(f"{source}: {number}, listed above")
        self.exit_code = problems[0].exit_code


def check(
    source: Path,
    plugins: Sequence[str] | None,
    output: Path,
    monitor: Monitor,
    overrides: Sequence[Override] = (),
    pictures: bool = True,
    earlier: Path | None = None,
) -> list[SavmapError]:
    """The problems of a site file. The monitor gets a note of each as soon as it is found, of questions, of pictures
    that were written, and of what a run will take. Raises SiteError where the file cannot be read."""
    problems, questions = list[SavmapError](), 0
    for finding in _findings(source, plugins, output, overrides, pictures, earlier):
        if isinstance(finding, SavmapError):
            problems.append(finding)
        questions += isinstance(finding, Question)
        monitor.note(str(finding))
    if not problems:
        monitor.note(UNCHECKED)
        asked = f"; {questions} question{'s' * (questions > 1)} above" if questions else ""
        monitor.note(f"{source}: no problem found{asked}")
    return problems


def _findings(
    source: Path,
    plugins: Sequence[str] | None,
    output: Path,
    overrides: Sequence[Override],
    pictures: bool,
    earlier: Path | None,
) -> Iterator[SavmapError | str]:
    draft = read_draft(source, overrides)
    wrong = problems_in(draft)
    yield from (SiteError(line) for _, line in wrong)
    site = sound_part(draft) if wrong else site_of(draft)
    if site is None:
        yield f"{source}: the rest is checked once this is put right"
        return
    names, note = chosen_plugins(site, plugins)
    notes = (*notes_on(draft), *([note] if note else []))
    yield from notes
    yield from of_job(Job(site, source, names, output, earlier, draft.places, notes), pictures)


def of_job(job: Job, pictures: bool) -> Iterator[SavmapError | str]:
    """Problems of a job whose site file is as it should be, and remarks."""
    footage, is_seen = list[Footage](), True
    yield from preflight.output(job, written_files(job))
    for finding in preflight.findings(job):
        if isinstance(finding, Footage):
            footage.append(finding)
        else:
            yield finding
        is_seen = is_seen and not isinstance(finding, ModelError | Unchecked)
    for _, row, line in rows_with_same_face(job.site.rows):
        yield with_location(SiteError(line), job.places, ("rows", row, "passes"))
    if is_seen:
        yield from _previewed(job, footage, pictures)


def _previewed(job: Job, footage: Sequence[Footage], pictures: bool) -> Iterator[SavmapError | str]:
    """What a few pictures of each pass show; then what a run will take."""
    sound: list[Footage] = []
    plans: Plans = {}
    for part in footage:
        findings = list(_preview(job, part, pictures, plans))
        yield from findings
        sound += [] if any(isinstance(finding, SavmapError) for finding in findings) else [part]
    if sound:
        try:
            yield from resource_estimate(job, sound, plans).lines()
        except SavmapError as error:
            yield error


Plans = dict[tuple[object, ...], tuple[RowRequest, PassPlan]]
"""How a run looks at a pass of each kind of footage."""


def _preview(job: Job, part: Footage, pictures: bool, plans: Plans) -> Iterator[SavmapError | str]:
    """Problems with the pictures of a pass, and a line with where its views are drawn."""
    row_pass = part.row_pass
    remark = f"row {part.row}, {part.name}: {part.frames} frames"
    try:
        plugins = plugins_for(job, part.row)
        if plugins and all(plugin.needs_path for plugin in plugins) and job.earlier is None:
            require_path(part.row, plugins[0], None)
        if pictures:
            request = replace(request_for(job, part.row), passes=(part.row_pass,))
            plan, shown = planned(part.name, part.row_pass, request.plugins, request.attitudes.get(part.name))
            plans.setdefault(_kind(job, part), (request, plan))
            keys, pairs = shown.keys, shown.pairs
            remark += f", views in {write_views(part.row, job.output, plan, shown)}"
        else:
            keys, pairs = preview_frames(row_pass.clip)
    except SavmapError as error:
        yield with_location(error, job.places, part.location)
        return
    yield remark
    end_s = min(row_pass.end_s or part.info.duration_s, part.info.duration_s)
    last_s = max(panorama.stamp_s for panorama in (*keys, *(second for _, second in pairs)))
    is_short = missing_s(last_s, end_s, sampling_fps(row_pass.clip, part.info)) > 0
    if is_short and last_s - row_pass.start_s < DECODABLE * (end_s - row_pass.start_s):
        text = f"{row_pass.video}: nothing can be decoded after {last_s:.1f} s; the file is cut off or damaged"
        yield with_location(VideoError(text), job.places, (*part.location, "video"))


@dataclass
class ProbeMonitor:
    """A Monitor that lets only the first few frames of a pass through, and notes, on the clock and in the processor's
    seconds, when each was asked for in the first walk."""

    ticks: list[tuple[float, float]] = field(default_factory=list)

    def each(self, items: Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
        ticks = self.ticks if not self.ticks else []
        for item in islice(items, FRAMES):
            ticks.append((time.perf_counter(), time.process_time()))
            yield item
        ticks.append((time.perf_counter(), time.process_time()))

    def note(self, line: str) -> None:
        """Lines are for runs."""

    def left(self, seconds: float) -> None:
        """So is this."""


@dataclass(frozen=True)
class ResourceEstimate:
    """What a run will take with one worker: frames, seconds of measuring them, seconds of all that comes after that, MB
    on disk for what is kept of the rows, MB of memory that were in use after a few frames. A second look at the frames,
    which most rows do not need, is not in it."""

    frames: int
    measure_s: float
    after_s: float
    disk_mb: float
    memory_mb: float

    def lines(self) -> Iterator[str]:
        """For people."""
        measuring = f"measuring them will take about {duration(self.measure_s)}"
        yield f"{self.frames} frames; {measuring} with one worker on this machine"
        again = "so does measuring once more where a row needs a second look"
        yield f"solving and writing come on top: about {duration(self.after_s)}; {again}"
        disk = f"about {self.disk_mb:.1f} MB of disk for what is kept of the rows"
        yield f"{disk}; at least {self.memory_mb:.0f} MB of memory a worker"


def resource_estimate(job: Job, footage: Sequence[Footage], plans: Plans) -> ResourceEstimate:
    """What the footage will take. Raises SavmapError's kinds where a few frames of it cannot be measured."""
    costs: dict[tuple[object, ...], tuple[FrameCost, float]] = {}
    for part in footage:
        kind = _kind(job, part)
        if kind not in costs:
            if kind not in plans:
                request = replace(request_for(job, part.row), passes=(part.row_pass,))
                plans[kind] = (
                    request,
                    planned(part.name, part.row_pass, request.plugins, request.attitudes.get(part.name))[0],
                )
            costs[kind] = _cost(job, part, *plans[kind])
    parts = [(part.frames, *costs[_kind(job, part)]) for part in footage]
    return ResourceEstimate(
        sum(frames for frames, _, _ in parts),
        sum(cost.plan_s(1) + n * cost.frame_s + cost.after_s(n, [MEASURED]) for n, cost, _ in parts),
        sum(cost.after_s(n, [SOLVED, PICTURED]) + cost.drawn_s(n) for n, cost, _ in parts),
        sum(n * frame_bytes for n, _, frame_bytes in parts) / 1e6,
        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / PER_MB,
    )


def duration(seconds: float) -> str:
    """Seconds, minutes, or hours and minutes, in words."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02d} min"


def _kind(job: Job, part: Footage) -> tuple[object, ...]:
    """What decides how long a frame takes."""
    models = tuple(plugin.model for plugin in plugins_for(job, part.row))
    extras = (job.site.row_appearance(part.row), bool(job.site.row_references(part.row).markers))
    return part.info.width, part.info.codec, part.info.rate_fps, part.row_pass.rate, models, extras


def _cost(job: Job, part: Footage, request: RowRequest, plan: PassPlan) -> tuple[FrameCost, float]:
    """Measure the first frames of a pass as a run does: what a frame takes, and bytes a frame of what is kept of it.
    Whether they show a row does not matter."""
    probe = ProbeMonitor()
    request = replace(request, strips=job.site.orthophotos, stills=job.site.panoramas)
    with warnings_held_back():  # of a few frames, which show a part of the row
        walk = RowWalk((request, plan), SegmenterPool(request.plugins), Renderer(), Journal())
        walk.begin(plan.name, part.row_pass, probe)
        drive_along(plan.clip, [walk], walk.renderer, probe)
    if walk.failure and not (isinstance(walk.failure, StructureError) and len(walk.stamps) > 1):
        raise walk.failure
    walked, ticks = walk.walked(), probe.ticks
    stored = packed(walked.measurements) + packed(walked.strips)
    return FrameCost.of(ticks[min(WARM, len(ticks) - 2) :]), len(stored) / (len(ticks) - 1)
