"""What can be known to be wrong with a job before anything is mapped: each check gives all the problems it finds."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from savmap.errors import (
    ModelError,
    OutputError,
    PluginError,
    SavmapError,
    SiteError,
    SolveError,
    StructureError,
    VideoError,
)
from savmap.files.urls import is_url
from savmap.files.validation import Location
from savmap.maps.map_file import read_map
from savmap.maps.survey import read_survey
from savmap.plugin.manager import load_class
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.job import Job, plugins_for, prepare
from savmap.site.locations import SourceMap, explained, without_value
from savmap.site.model import MIN_FRAMES, Pass, Site, pass_names
from savmap.site.references import misnamed
from savmap.site.sections import CameraSection
from savmap.video.clip import VideoInfo, time_range, too_few
from savmap.video.reader import check_camera, expected_frames, probe_clip
from savmap.vision.markers import MarkerTracker

Finding = TypeVar("Finding")
HIGH_M = 6.0
"""Above it hardly a camera is carried or driven: a height in feet is."""


def settings_problems(site: Site, plugins: Sequence[str], places: SourceMap) -> Iterator[SavmapError]:
    """What is wrong with the plugins that are named, and with their settings for all rows and for each; each once."""
    yield from _once(problem for name in dict.fromkeys(plugins) for problem in _of_plugin(site, name, places))


def _once(findings: Iterable[Finding]) -> Iterator[Finding]:
    """The findings, of those that say the same only one."""
    yield from {str(finding): finding for finding in findings}.values()


def _of_plugin(site: Site, name: str, places: SourceMap) -> Iterator[SavmapError]:
    try:
        config = load_class(name).Config
    except PluginError as error:
        named = ("plugins", name)
        yield PluginError(f"{places.of(named)}: {error}") if named in places.lines else error
        return
    for row in site.rows:
        settings, at = site.plugin_config(row, name), partial(_given, site, row, name)
        roots = (("plugins", name), ("rows", row, "plugins", name))
        wrong = without_value(config, places, roots, empty_sections=False)
        try:
            config.model_validate(settings)
        except ValidationError as error:
            wrong = {**explained(error, config, places, at), **wrong}
        yield from map(SiteError, wrong.values())


def _given(site: Site, row: str, plugin: str, location: Location) -> Location:
    """Where in the site file a plugin's setting was given: with the row or for all of them."""
    of_row = location[:1] and location[0] in site.rows[row].plugins.get(plugin, {})
    return (*(("rows", row) if of_row else ()), "plugins", plugin, *location)


def tells_scale(site: Site, row: str, plugins: Sequence[str]) -> bool:
    """Whether anything is given that might fix a row's scale: a reference, or one of a plugin's `scale_settings` (any
    setting where it does not name them). A row that its camera sees in part needs none: it has a unit of its own."""
    if any(row_pass.clip.camera is not None for row_pass in site.rows[row].passes):
        return True
    for plugin in plugins:
        config = site.plugin_config(row, plugin)
        settings = getattr(load_class(plugin), "scale_settings", config)  # any, where it does not name them
        if any(config.get(key) is not None for key in settings):
            return True
    given = site.row_references(row)
    return bool(given.camera_height_m or given.lengths or given.markers or len(given.points) > 1)


class Question(str):
    """What may be meant, and is more likely wrong."""


class Unchecked(str):
    """What is checked once something is put right."""


@dataclass(frozen=True)
class Footage:
    """A pass of a row whose video can be read: its name, the video, and about how many frames will be used of it."""

    row: str
    name: str
    location: Location
    row_pass: Pass
    info: VideoInfo
    frames: int


def require_ready(job: Job) -> None:
    """Refuse at once what would fail after minutes of work, with its place in the site file.

    Raises PluginError or SiteError for a plugin or its settings, VideoError for a video or time range, StructureError
    for too few frames, SolveError where nothing that was given could fix the scale, OutputError for a survey that
    cannot be read.
    """
    for finding in findings(job, named=True):
        if isinstance(finding, SavmapError):
            raise finding


def findings(job: Job, named: bool = False) -> Iterator[SavmapError | Footage | str]:
    """All that is found, in the order in which it is quickly told. `named`: of networks only those that the site file
    names."""
    wrong = list(settings_problems(job.site, job.plugins, job.places))
    yield from chain(wrong, earlier_map(job), footage(job))
    if wrong:
        text = "networks, references and views are checked once the plugins' settings are put right"
        yield Unchecked(f"{job.source}: {text}")
    else:
        yield from chain(networks(job, named), references(job), questions(job), survey(job))


def with_location(error: SavmapError, places: SourceMap, location: Location) -> SavmapError:
    """An error with the place in the site file that it comes from put before it."""
    place = places.of(location)
    return error if str(error).startswith(places.where) else type(error)(f"{place}: {error}")


def networks(job: Job, named: bool = False) -> Iterator[SavmapError | str]:
    """Networks that cannot be loaded, or do not give their plugin's classes; a line for each of the others, of what
    kind it is and on what it runs. `named`: only those that the site file names."""
    tried = set[tuple[str, Path, str]]()
    for row in job.site.rows:
        for plugin in plugins_for(job, row):
            key = (plugin.name, plugin.model, str(plugin.class_names))
            if key in tried or (named and not getattr(plugin.config, "model", None)):
                continue
            tried.add(key)
            try:
                network = SegmenterPool([plugin]).network(plugin)
                yield f"network of {plugin.name}: {network}"
                yield from [network.note] if network.note else []
            except ModelError as error:
                yield with_location(error, job.places, _given(job.site, row, plugin.name, ("model",)))


def references(job: Job) -> Iterator[SavmapError]:
    """References to what no plugin can find, markers that cannot be printed, and rows whose scale nothing could fix."""
    yield from _once(problem for row in job.site.rows for problem in _unfit_references(job, row))
    for row in job.site.rows:
        if job.earlier is None and job.against is None and not tells_scale(job.site, row, job.plugins):
            text = (
                f"row {row}: the map's scale is not known; give the camera's height (`camera_height_m` under "
                "`references:`; `--camera-height` with a video), a length or a marker (docs/site-file.md)"
            )
            yield with_location(SolveError(text), job.places, ("rows", row))


def earlier_map(job: Job) -> Iterator[SavmapError]:
    """What is wrong with the map that a run updates: it is none, has not the row that is named, or is in the folder
    that the run writes to."""
    if job.against is None:
        return
    try:
        rows = read_map(job.against).rows
    except OutputError as error:
        yield SiteError(f"--against: {error}" + ("" if job.against.is_file() else "; give a map.json or its folder"))
        return
    if job.against.resolve().parent == job.output.resolve():
        yield SiteError(f"--against: {job.against}: lies where this run writes its map; choose another -o")
    if job.against_row is not None and job.against_row not in rows:
        yield SiteError(f"--row {job.against_row}: {job.against} has no such row; it has {', '.join(rows)}")


def questions(job: Job) -> Iterator[Question]:
    """What may be wrong with references and settings, each once."""
    return _once(question for row in job.site.rows for question in _questions_of(job, row))


def _questions_of(job: Job, row: str) -> Iterator[Question]:
    given = job.site.row_references(row)
    if given.camera_height_m and given.camera_height_m.value > HIGH_M:
        feet, place = given.camera_height_m.value, job.places.of(_of_reference(job, row, ("camera_height_m",)))
        yield Question(f"{place}: is the camera {feet:.2f} m high? {feet:.2f} feet are {0.3048 * feet:.2f} m")
    names = [
        *(name for length in given.lengths for name in length.between),
        *(point.vertex for point in given.points),
    ]
    for plugin in plugins_for(job, row):
        place = job.places.of(("rows", row, "plugins", plugin.name))
        asked = getattr(plugin.instance, "questions", lambda names: ())
        yield from (Question(f"{place}: row {row}: {text}") for text in asked(names))


def _unfit_references(job: Job, row: str) -> Iterator[SavmapError]:
    """References to what no plugin can find, but where a plugin does not say what it calls things or an earlier map has
    names too, and markers that cannot be printed."""
    given = job.site.row_references(row)
    declared = [getattr(load_class(name), "reference_names", None) for name in dict.fromkeys(job.plugins)]
    if job.earlier is None and None not in declared:
        for location, text in misnamed(given, [name for names in declared for name in names or ()]):
            yield with_location(SiteError(text), job.places, _of_reference(job, row, location))
    for number, marker in enumerate(given.markers):
        try:
            MarkerTracker([(marker.dictionary, marker.id)])
        except SiteError as error:
            yield with_location(error, job.places, _of_reference(job, row, ("markers", number)))


def _of_reference(job: Job, row: str, location: Location) -> Location:
    """Where in the site file a reference was given: with the row, or for all of them."""
    of_row = location[0] in job.site.rows[row].references.model_fields_set
    return (*(("rows", row) if of_row else ()), "references", *location)


def survey(job: Job) -> Iterator[SavmapError | str]:
    """What is wrong with the survey, and which rows are in it or in the site alone."""
    if job.site.survey is None:
        return
    try:
        surveyed = read_survey(job.site.survey).rows
    except OutputError as error:
        yield with_location(error, job.places, ("survey",))
        return
    common = [row for row in job.site.rows if row in surveyed]
    if not common:
        text = f"{job.site.survey}: has none of the site's rows; it has {', '.join(surveyed)}"
        yield with_location(SiteError(text), job.places, ("survey",))
    for row in common:
        for plugin in plugins_for(job, row):
            try:
                plugin.evaluate((), surveyed[row])
            except OutputError as error:
                yield with_location(OutputError(f"{job.site.survey}: row {row}: {error}"), job.places, ("survey",))
            except SavmapError:
                continue
    for who, rows in (
        ("tells nothing of", job.site.rows.keys() - surveyed),
        ("also tells of", surveyed.keys() - job.site.rows),
    ):
        if rows and common:
            yield f"{job.site.survey}: {who} row {', '.join(sorted(rows))}"


def footage(job: Job) -> Iterator[SavmapError | Footage]:
    """Passes whose videos can be read, and what is wrong with the others."""
    probed: dict[tuple[Path, CameraSection | None], VideoInfo | SavmapError] = {}
    for row, section in job.site.rows.items():
        for number, (name, row_pass) in enumerate(zip(pass_names(section.passes), section.passes, strict=True)):
            key, at = (row_pass.video, row_pass.camera), ("rows", row, "passes", number)
            if key not in probed:
                try:
                    probed[key] = info = probe_clip(row_pass.clip)
                    check_camera(row_pass.clip, info)
                except (VideoError, SiteError) as error:
                    probed[key] = error
            video = probed[key]
            if isinstance(video, SavmapError):
                yield with_location(video, job.places, (*at, "video"))
            else:
                yield _footage(job, Footage(row, name, at, row_pass, video, 0))


def _footage(job: Job, part: Footage) -> SavmapError | Footage:
    row_pass, duration = part.row_pass, part.info.duration_s
    late = row_pass.end_s is not None and row_pass.start_s < duration
    try:
        time_range(row_pass.clip, duration)
    except VideoError as error:
        return with_location(error, job.places, (*part.location, "end_s" if late else "start_s"))
    frames = expected_frames(row_pass.clip, part.info)
    if frames < MIN_FRAMES:
        return with_location(StructureError(too_few(row_pass.clip, frames, part.name)), job.places, part.location)
    return replace(part, frames=frames)


def output(job: Job, files: Iterable[Path]) -> Iterator[SavmapError]:
    """Whether the output folder, and the files in it, can be written; a folder that is not there is not left behind."""
    folders = () if is_url(job.output) else (job.output, *job.output.parents)
    new = [folder for folder in folders if not folder.exists()]
    try:
        prepare(job.output, files)
    except OutputError as error:
        yield error
    for folder in new:
        if folder.is_dir():
            folder.rmdir()
