"""`savmap check`: everything that can be known to be wrong with a site file before hours are spent, and what a run will
take."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from savmap.assembly import rows_with_same_face
from savmap.errors import SavmapError, SiteError, VideoError
from savmap.jobs.map_site import written_files
from savmap.jobs.resource_estimate import resource_estimate
from savmap.jobs.tasks import request_for
from savmap.pipeline.preview import picture_name, preview
from savmap.plugin.segmenters import SegmenterPool
from savmap.site import preflight
from savmap.site.job import Job, chosen_plugins
from savmap.site.load import notes_on, problems_in, read_draft, site_of, sound_part
from savmap.site.overrides import Override
from savmap.site.preflight import Footage, settings_problems, with_location
from savmap.types.progress import Monitor
from savmap.video.clip import missing_s
from savmap.video.reader import preview_frames, sampling_fps

DECODABLE = 0.7
"""The share of a pass up to which key frames must be decodable."""


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
    """The problems of a site file. The monitor gets a note of each as soon as it is found, of pictures that were
    written, and of what a run will take. Raises SiteError where the file cannot be read."""
    problems: list[SavmapError] = []
    for finding in _findings(source, plugins, output, overrides, pictures, earlier):
        if isinstance(finding, SavmapError):
            problems.append(finding)
        monitor.note(str(finding))
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
    wrong_settings = list(settings_problems(job.site, job.plugins, job.places))
    yield from wrong_settings
    yield from preflight.output(job, written_files(job))
    findings = list(preflight.footage(job))
    footage = [finding for finding in findings if isinstance(finding, Footage)]
    yield from (finding for finding in findings if isinstance(finding, SavmapError))
    yield from (line for _, _, line in rows_with_same_face(job.site.rows))
    if wrong_settings:
        yield f"{job.source}: networks, references and views are checked once the plugins' settings are put right"
        return
    networks = list(preflight.networks(job))
    yield from networks
    yield from preflight.references(job)
    yield from preflight.survey(job)
    if not any(isinstance(finding, SavmapError) for finding in networks):
        yield from _previewed(job, footage, pictures)


def _previewed(job: Job, footage: Sequence[Footage], pictures: bool) -> Iterator[SavmapError | str]:
    """What a few pictures of each pass show; then what a run will take."""
    sound: list[Footage] = []
    for part in footage:
        findings = list(_preview(job, part, pictures))
        yield from findings
        sound += [] if any(isinstance(finding, SavmapError) for finding in findings) else [part]
    if sound:
        try:
            yield from resource_estimate(job, sound).lines()
        except SavmapError as error:
            yield error


def _preview(job: Job, part: Footage, pictures: bool) -> Iterator[SavmapError | str]:
    """Problems with the pictures of a pass, and a line with where its views are drawn."""
    row_pass = part.row_pass
    remark = f"row {part.row}, {part.name}: {part.frames} frames"
    try:
        if pictures:
            request, path = request_for(job, part.row), job.output / picture_name(part.row, part.name)
            segmenters, attitude = SegmenterPool(request.plugins), request.attitudes.get(part.name)
            looked = preview(part.name, row_pass, request.plugins, segmenters, path, attitude)
            keys, pairs = looked.keys, looked.pairs
            remark += f", views in {path}"
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
