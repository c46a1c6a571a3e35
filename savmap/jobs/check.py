"""`savmap check`: everything that can be known to be wrong with a site file before hours are spent, and what a run will take."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from savmap.errors import SavmapError, SiteError, VideoError
from savmap.jobs.resource_estimate import needs
from savmap.site import preflight
from savmap.site.job import Job, chosen_plugins, plugins_for
from savmap.site.load import problems_in, read_draft, site_of, sound_part
from savmap.site.overrides import Override
from savmap.site.preflight import Footage, placed, settings_problems

SEEN_TO = 0.7


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
    overrides: Sequence[Override] = (),
    pictures: bool = True,
    earlier: Path | None = None,
) -> Iterator[str]:
    """Lines for the user: every problem, pictures that were written, what a run will take.

    Raises CheckError in the end where there were problems, SiteError at once where the file cannot be read.
    """
    problems: list[SavmapError] = []
    for found in _found(source, plugins, output, overrides, pictures, earlier):
        if isinstance(found, SavmapError):
            problems.append(found)
        yield str(found)
    if problems:
        raise CheckError(source, problems)
    yield f"{source}: no problem found"


def _found(
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
    yield from [note] if note else []
    yield from of_job(Job(site, source, names, output, earlier, draft.places, note), pictures)


def of_job(job: Job, pictures: bool) -> Iterator[SavmapError | str]:
    """Problems of a job whose site file is as it should be, and lines for the user."""
    unset = list(settings_problems(job.site, job.plugins, job.places))
    yield from unset
    yield from preflight.output(job)
    found = list(preflight.footage(job))
    footage = [one for one in found if isinstance(one, Footage)]
    yield from (one for one in found if isinstance(one, SavmapError))
    yield from preflight.twins(footage)
    if unset:
        yield f"{job.source}: networks, references and views are checked once the plugins' settings are put right"
        return
    networks = list(preflight.networks(job))
    yield from networks
    yield from preflight.references(job)
    yield from preflight.survey(job)
    if not any(isinstance(one, SavmapError) for one in networks):
        yield from _looked(job, footage, pictures)


def _looked(job: Job, footage: Sequence[Footage], pictures: bool) -> Iterator[SavmapError | str]:
    """What is found by looking at a few pictures of each pass; then what a run will take."""
    good: list[Footage] = []
    for one in footage:
        found = list(_seen(job, one, pictures))
        yield from found
        good += [] if any(isinstance(each, SavmapError) for each in found) else [one]
    if good:
        try:
            yield from needs(job, good).lines()
        except SavmapError as error:
            yield error


def _seen(job: Job, one: Footage, pictures: bool) -> Iterator[SavmapError | str]:
    """Problems with the pictures of a pass, and a line with where its views are drawn."""
    from savmap.jobs.tasks import row_of
    from savmap.pipeline.initial_poses import initial_attitudes
    from savmap.pipeline.measure import clip_of
    from savmap.pipeline.preview import picture_name, preview
    from savmap.plugin.segmenters import SegmenterPool
    from savmap.video.reader import preview_frames

    what = f"row {one.row}, {one.name}: {one.frames} frames"
    try:
        if pictures:
            plugins, path = plugins_for(job, one.row), job.output / picture_name(one.row, one.name)
            attitude = initial_attitudes(row_of(job, one.row)).get(one.name)
            keys = preview(one.name, one.one, plugins, SegmenterPool(plugins), path, attitude).keys
            what += f", views in {path}"
        else:
            keys, _ = preview_frames(clip_of(one.one))
    except SavmapError as error:
        yield placed(error, job.places, one.location)
        return
    yield what
    end_s = min(one.one.end_s or one.info.duration_s, one.info.duration_s)
    last_s = keys[-1].stamp_s
    if last_s - one.one.start_s < SEEN_TO * (end_s - one.one.start_s):
        text = f"{one.one.video}: nothing can be decoded after {last_s:.1f} s; the file is cut off or damaged"
        yield placed(VideoError(text), job.places, (*one.location, "video"))
