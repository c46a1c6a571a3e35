"""A job from its footage to a site map with its scores, and the files that are written of it."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

from savmap.assembly import aligned, assembled, same_face_warnings, with_confirmed, with_warnings
from savmap.errors import (
    MustCheckError,
    OutputError,
    PluginsLeftOutError,
    RowsFailedError,
    SavmapError,
    VideoError,
    format_error,
)
from savmap.files.atomic import file_name, read_json, sha256, write_text
from savmap.files.kinds import kind_of
from savmap.files.texts import json_visible
from savmap.files.urls import is_url
from savmap.jobs.cache import FOLDER, FolderCache, locked
from savmap.jobs.cache_keys import drawing_key
from savmap.jobs.returning import back_in_map
from savmap.jobs.scheduler import MappedRows, RunOptions, map_rows_of
from savmap.jobs.tasks import warnings_as_notes
from savmap.maps.exports.files import timestamp
from savmap.maps.map_file import write_map
from savmap.maps.orthophoto_file import orthophoto_files, write_orthophoto
from savmap.maps.run_record import LOG, FootageFile, RunLog, write_log
from savmap.maps.survey import read_survey
from savmap.pipeline.drive import recordings
from savmap.plugin.apps import Changes, WrittenMap, viewer
from savmap.plugin.isolation import failures_gathered
from savmap.report.orthophotos import write_overlay
from savmap.report.page import Report, write_page
from savmap.report.picture import write_box_plot, write_row_view
from savmap.report.site_report import PluginsByRow, evaluation_of, plugins_of_map, report_for, viewer_page
from savmap.site.job import Job, plugins_for
from savmap.site.layout import placements
from savmap.site.load import KnownAlignment
from savmap.site.model import Pass, pass_names
from savmap.site.preflight import questions, require_ready
from savmap.types import Evaluation, Picture, SiteMap, Survey
from savmap.types.progress import Monitor
from savmap.video.reader import probe_clip
from savmap.vision.networks.session import network_digest, runtime_version

DRAWN = "drawn"
VIEWS: tuple[Picture, ...] = ("face", "plan")
MAP, MESSAGES = "map.json", "savmap.log"
RESOLVED, REPORT, BOX_PLOT = "site.resolved.json", "report.html", "errors.png"
MAPPED = (RowsFailedError, PluginsLeftOutError, MustCheckError)
"""How runs end whose map was written."""


@dataclass(frozen=True, eq=False)
class SiteRun:
    """What a run gave: the map, its scores where the site names a survey, what was done with each row, the rows that
    failed, the plugins that failed anywhere, the files that were written, and what changed since the earlier map that
    was updated."""

    site_map: SiteMap
    evaluation: Evaluation | None
    log: RunLog
    failed_rows: Mapping[str, SavmapError]
    failed_plugins: frozenset[str]
    files: tuple[Path, ...] = ()
    changes: Changes | None = None

    def raise_if_incomplete(self, job: Job) -> None:
        """Raises RowsFailedError where rows could not be mapped, PluginsLeftOutError where plugins failed,
        MustCheckError where something speaks against a row's map."""
        banner = self.site_map.banner
        if self.failed_rows and job.against is not None:
            names = ", ".join(self.failed_rows)
            raise RowsFailedError(
                f"nothing is updated by row {names}, which could not be mapped; {job.output / LOG} says why"
            )
        if self.failed_rows:
            raise RowsFailedError(f"{banner}; {job.output / MAP} says why")
        if self.failed_plugins:
            names = ", ".join(sorted(self.failed_plugins))
            raise PluginsLeftOutError(
                f"mapped without plugins that failed: {names}; {job.output / MESSAGES} says where and why"
            )
        if banner:
            raise MustCheckError(f"mapped, but {banner}; the reasons are above and in {job.output / REPORT}")


def map_job(job: Job, options: RunOptions, monitor: Monitor) -> SiteRun:
    """Map a job's rows, put them in one frame, and score them; nothing is written.

    Raises the first row's error where no row could be mapped, and SavmapError's kinds for what is wrong with the job.
    """
    require_ready(job)
    with TemporaryDirectory(prefix="savmap-") as folder:
        return _run(job, options, monitor, FolderCache(Path(folder)), write=False)


def map_job_into(job: Job, options: RunOptions, monitor: Monitor) -> SiteRun:
    """Map a job that is known to be ready, and write all its results into its output folder, which is there.

    What is worked out of each row is kept in the folder as soon as it is there; the other files are written whole,
    after everything is solved: map.json, run.json, report.html, view.html with what it loads, site.resolved.json,
    pictures and an orthophoto of each row. Raises as `map_job` does, and OutputError.
    """
    cache = FolderCache(job.output)
    if options.fresh:
        cache.clear(job.site.rows)
    return _run(job, options, monitor, cache, write=True)


@contextmanager
def failures_recorded(folder: Path) -> Iterator[None]:
    """Let run.json in an output folder tell of a run that fails while this lasts, with the map of an earlier run where
    it is still there. Nothing is written into a folder that no run has written to, into which another run writes, or
    that is a URL, nor of a run that was cut off."""
    before = _identity(folder / MAP)
    try:
        yield
    except Exception as error:
        is_written = not is_url(folder) and any(os.path.exists(folder / name) for name in (MAP, LOG, MESSAGES, FOLDER))
        if is_written and not isinstance(error, MAPPED):
            is_kept = before is not None and _identity(folder / MAP) == before
            says = str(error) if isinstance(error, SavmapError) else format_error(error)
            with suppress(OutputError, OSError), locked(folder):
                earlier = sha256(folder / MAP) if is_kept else ""
                write_log(RunLog(rows={}, status="failed", error=says, earlier_map=earlier), folder / LOG)
        raise


def _identity(path: Path) -> tuple[int, int] | None:
    """What is another after a file is written anew; None where there is none."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status.st_ino, status.st_mtime_ns


def in_one_frame(job: Job, site_map: SiteMap, plugins: PluginsByRow) -> tuple[SiteMap, tuple[str, ...]]:
    """The map with its rows placed in the site's frame where something tells, and a line for each thing the user should
    know."""
    footage = {name: recordings(job.site.rows[name].passes) for name in site_map.rows}
    try:
        result = assembled(
            site_map,
            placements(job.site),
            footage,
            lambda row, plugin, structures: plugins[row][plugin].cross_row_landmarks(structures),
        )
    except SavmapError as error:
        return site_map, (f"rows are not placed in one frame: {error}",)
    return result.site_map, tuple(result.notes)


def in_users_world(job: Job, site_map: SiteMap) -> tuple[SiteMap, tuple[str, ...]]:
    """The map with its place in the user's world where the site file tells, and a line for each thing the user should
    know. What does not fit the map costs the alignment, not the map."""
    if job.site.align is None:
        return site_map, ()
    try:
        result = aligned(site_map, KnownAlignment(job.site.align, job.places))
    except SavmapError as error:
        return site_map, (f"the site is not aligned: {error}; after mending it run `savmap align`",)
    return result.site_map, result.notes


def with_footage(job: Job, log: RunLog) -> RunLog:
    """The record of a run that ends now, with what its rows' footage is."""
    rows = {
        name: run.model_copy(
            update={"footage": _footage_of(job.site.rows[name].passes)} if name in job.site.rows else {}
        )
        for name, run in log.rows.items()
    }
    return log.model_copy(update={"rows": rows, "ended": timestamp()})


def _footage_of(passes: Sequence[Pass]) -> dict[str, FootageFile]:
    """By pass; without a size where the footage was removed since."""
    footage = {}
    for name, row_pass in zip(pass_names(passes), passes, strict=True):
        file = row_pass.video.name
        footage[name] = FootageFile(name=file)
        with suppress(VideoError):
            info = probe_clip(row_pass.clip)
            footage[name] = FootageFile(name=file, width=info.width, height=info.height)
    return footage


def made_by(job: Job) -> dict[str, str]:
    """Versions of what made a map: savmap, GTSAM, onnxruntime and the networks' digests."""
    first = next(iter(job.site.rows))
    models = {f"model {plugin.name}": network_digest(plugin.model_file) for plugin in plugins_for(job, first)}
    return {**{name: version(name) for name in ("savmap", "gtsam")}, "onnxruntime": runtime_version(), **models}


def write_photo(row: str, report: Report, folder: Path) -> list[Path]:
    """Write a row's orthophoto, what is said of it, and the wireframe over it; the picture, if there is one. Without
    one, that of an earlier map is taken away: it would not fit this one. Raises OutputError."""
    picture, *said = orthophoto_files(row, folder)
    overlay = picture.with_suffix(".svg")
    photo = report.photos.get(row)
    if photo is None:
        for path in (picture, *said, overlay):
            path.unlink(missing_ok=True)
        return []
    write_orthophoto(row, photo, folder)
    write_overlay(row, photo, report.drawings[row], picture, overlay)
    return [picture]


def _run(job: Job, options: RunOptions, monitor: Monitor, cache: FolderCache, write: bool) -> SiteRun:
    """Map, assemble and score a job. While rows are mapped, their tasks note what plugins warn of; after that it is
    done here."""
    for note in (*job.notes, *questions(job)):
        monitor.note(note)
    mapped = map_rows_of(
        job, options, monitor, cache, with_pictures=write and (job.site.orthophotos or job.site.panoramas)
    )
    mapped = replace(mapped, log=with_footage(job, mapped.log))
    failed = {name: str(error) for name, error in mapped.failed.items()}
    survey = read_survey(job.site.survey) if job.site.survey else None
    changes: Changes | None = None
    with failures_gathered() as failures, warnings_as_notes(monitor):
        if job.against is None:
            plugins: PluginsByRow = {name: {p.name: p for p in plugins_for(job, name)} for name in mapped.rows}
            site_map = _assembled(job, SiteMap(mapped.rows, made_by(job), failed), plugins, monitor)
        else:
            mapped, site_map, changes = back_in_map(job, mapped, made_by(job))
            plugins = plugins_of_map(site_map)
        if write:
            evaluation, files = _write_results(job, site_map, mapped, plugins, survey, cache, changes)
        else:
            evaluation, files = evaluation_of(site_map, survey, plugins) if survey else None, ()
    failed_plugins = {name for row in mapped.log.rows.values() for name in row.plugins_failed}
    failed_plugins |= {failure.plugin for failure in failures}
    return SiteRun(site_map, evaluation, mapped.log, mapped.failed, frozenset(failed_plugins), files, changes)


def _assembled(job: Job, site_map: SiteMap, plugins: PluginsByRow, monitor: Monitor) -> SiteMap:
    """The map with its rows in one frame and in the user's world, as far as that is known, and what was confirmed."""
    placed, notes = in_one_frame(job, site_map, plugins)
    placed = with_warnings(placed, same_face_warnings({name: job.site.rows[name] for name in placed.rows}))
    confirmed = with_confirmed(placed, {name: row.confirmed for name, row in job.site.rows.items()})
    in_world, further = in_users_world(job, confirmed.site_map)
    for note in (*notes, *confirmed.unused, *further):
        monitor.note(note)
    return in_world


def _write_results(
    job: Job,
    site_map: SiteMap,
    mapped: MappedRows,
    plugins: PluginsByRow,
    survey: Survey | None,
    cache: FolderCache,
    changes: Changes | None,
) -> tuple[Evaluation | None, tuple[Path, ...]]:
    """Write the map, what was done for it, the resolved site, the report, the viewer, each row's two pictures, its
    orthophoto if there is one, and the box plot where there is a survey; the scores, and the files worth a look."""
    dropped = _rows_of(job.output / MAP) - set(site_map.rows)
    write_map(site_map, job.output / MAP)
    write_log(mapped.log, job.output / LOG)
    write_text(job.output / RESOLVED, json_visible(job.site.model_dump_json(indent=2, exclude_none=True)) + "\n")
    photos, stills = mapped.orthophotos, mapped.stills
    report = report_for(site_map, plugins, survey, mapped.log, _title(job.source), photos, stills)
    report = replace(report, viewer=viewer_page(), changes=changes)
    files = [job.output / MAP]
    for name, row in site_map.rows.items():
        surveyed = survey.rows.get(name) if survey else None
        views, key = _row_views(name, job.output), drawing_key(row, surveyed)
        if cache.load(name, DRAWN, key) is None or not all(view.is_file() for view in views):
            for kind, path in zip(VIEWS, views, strict=True):
                write_row_view(row, report.drawings[name], kind, path)
            if not any(plugin.failure for plugin in plugins[name].values()):
                cache.save(name, DRAWN, key, b"")
        files += [*views, *write_photo(name, report, job.output)]
    write_page(report, job.output / REPORT)
    files.append(job.output / REPORT)
    if shown_by := viewer():
        about = report.evaluation, job.site.survey, report.title, photos, stills, report.places
        shown_by.write_beside(WrittenMap(job.output / MAP, site_map, *about))
        files.append(job.output / shown_by.PAGE)
    kept = {path.name.casefold() for row in site_map.rows for path in _files_of(row, job.output)}
    for path in (path for row in dropped for path in _files_of(row, job.output)):
        if path.name.casefold() not in kept:  # a picture that an earlier run wrote of a row that is no more
            with suppress(OSError):
                path.unlink(missing_ok=True)
    if survey is None:
        return None, tuple(files)
    evaluation = report.evaluation or evaluation_of(site_map, survey, plugins)
    write_box_plot(evaluation, job.output / BOX_PLOT)
    return evaluation, (*files, job.output / BOX_PLOT)


def written_files(job: Job) -> list[Path]:
    """The files that a run of a job writes, one of each kind in each folder."""
    names = (MAP, LOG, MESSAGES, RESOLVED, REPORT, *([BOX_PLOT] if job.site.survey else []))
    shown_by = viewer()
    stages = [job.output / FOLDER / file_name(row) / DRAWN for row in job.site.rows]
    return [
        *(job.output / name for name in names),
        *(file for row in job.site.rows for file in _files_of(row, job.output)),
        *(shown_by.files_of([*job.site.rows], job.output) if shown_by else ()),
        *stages,
    ]


def _rows_of(map_file: Path) -> set[str]:
    """Names of the rows that an earlier map has or lacks; none where there is no such map."""
    try:
        content = read_json(map_file)
    except OutputError:
        return set()
    if not isinstance(content, dict) or kind_of(content) != "a map":
        return set()
    sections = [content.get(key) for key in ("rows", "failed")]
    return {name for section in sections if isinstance(section, dict) for name in section}


def _files_of(row: str, folder: Path) -> list[Path]:
    """The pictures of a row, and what is said of them."""
    photo = orthophoto_files(row, folder)
    return [*_row_views(row, folder), *photo, photo[0].with_suffix(".svg")]


def _row_views(row: str, folder: Path) -> list[Path]:
    return [folder / f"{kind}-{file_name(row)}.png" for kind in VIEWS]


def _title(source: Path) -> str:
    """What a report is called: the file's name, or its folder's where that says no more than what it is."""
    return source.absolute().parent.name if source.stem == "site" else source.stem
