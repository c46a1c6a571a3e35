"""The public Python API: maps from site files and videos, their scores, and other formats. See docs/python-api.md."""

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

from savmap.assembly import aligned
from savmap.errors import SiteError, visible
from savmap.files.urls import where
from savmap.jobs.cache import locked
from savmap.jobs.map_site import failures_recorded, map_job, map_job_into, written_files
from savmap.jobs.scheduler import RunOptions
from savmap.maps.distance import VertexDistance, vertex_distance
from savmap.maps.exports import export_map, format_of
from savmap.maps.map_file import map_in, read_map
from savmap.maps.search import SearchHit, find_structures
from savmap.maps.survey import read_survey
from savmap.plugin.apps import html_of
from savmap.plugin.manager import exporters
from savmap.report.site_report import evaluation_of, places_of, plugins_of_map
from savmap.site.job import Job, job_for, prepare
from savmap.site.load import load_alignment
from savmap.site.overrides import overrides_of
from savmap.site.preflight import require_ready
from savmap.types import Evaluation, SiteMap, Survey
from savmap.types.progress import Monitor, SilentMonitor

PathLike = str | Path
SiteMap.html = staticmethod(html_of)


def map_site(
    site: PathLike,
    plugins: Sequence[str] | None = None,
    *,
    output: PathLike | None = None,
    progress: Monitor | None = None,
    jobs: int = 0,
    overrides: Sequence[str] = (),
    against: PathLike | None = None,
    row: str | None = None,
) -> SiteMap:
    """Map all rows of a site.

    site: a site file. plugins: names of those that look at the rows (or the one's); default: the site's, else all
    installed ones. output: a folder for all that `savmap map` writes, which also keeps what need not be done again;
    default: nothing is written. progress: is told what is done. jobs: rows mapped at a time, each in a process of its
    own (0: all in this one, in which a hook that never returns is never ended). overrides: single keys of the site
    file, such as "rows.A.fps=5". against: a map of the same rows, or its folder: the passes are recognised in it, need
    no references, and update it; row: which of its rows they show (default: found out).

    Rows that could not be mapped are in `failed` of the result. Raises SavmapError's kinds; the first row's error where
    no row could be mapped.
    """
    folder = where(output) if output is not None else Path()
    keys, mapped = overrides_of(several(overrides) or [], {}), None if against is None else where(against)
    job = job_for(where(site), several(plugins), folder, overrides=keys, against=mapped, against_row=row)
    return _mapped(job, output is not None, progress, jobs)


def map_video(
    video: PathLike,
    plugins: Sequence[str] | None = None,
    *,
    camera_height_m: float | None = None,
    side: str | None = None,
    output: PathLike | None = None,
    progress: Monitor | None = None,
    jobs: int = 0,
    overrides: Sequence[str] = (),
    against: PathLike | None = None,
    row: str | None = None,
) -> SiteMap:
    """Map one row from one panoramic video (or a folder of pictures): a first map. The row's name is "1".

    camera_height_m: above the floor; it gives the map its scale. side: "left" or "right", the hand the face is on as
    one drives along; default: found in the pictures. The other arguments, and the errors raised, are those of
    `map_site`.
    """
    folder, keys = where(output) if output is not None else Path(), overrides_of(several(overrides) or [], {})
    mapped = None if against is None else where(against)
    job = job_for(where(video), several(plugins), folder, camera_height_m, side, None, keys, mapped, row)
    return _mapped(job, output is not None, progress, jobs)


def load_map(path: PathLike) -> SiteMap:
    """A map from map.json, or from the one in a folder that `savmap map` wrote. Raises OutputError where it is none."""
    return read_map(map_in(where(path)))


def evaluate(site_map: SiteMap | PathLike, survey: PathLike | Survey) -> Evaluation:
    """A map against a survey (records, or paths of their files), scored by the plugins that made it.

    Raises OutputError where they have no row in common, or the survey is malformed; PluginError for a plugin that is
    not installed.
    """
    truth = survey if isinstance(survey, Survey) else read_survey(where(survey))
    scored = map_of(site_map)
    return evaluation_of(scored, truth, plugins_of_map(scored))


def align(site_map: SiteMap | PathLike, places: PathLike, tell: Callable[[str], None] | None = None) -> SiteMap:
    """The map with its place in the user's world (`alignment`), from a file with the section `align` of a site file, or
    that alone.

    tell: is given a line for each thing that the user should know, such as a point that contradicts the others and was
    left out. Raises SiteError with file and line where the places do not tell where the site stands, or contradict one
    another.
    """
    result = aligned(map_of(site_map), load_alignment(where(places)))
    if tell is not None:
        for note in result.notes:
            tell(note)
    return result.site_map


def find(site_map: SiteMap | PathLike, name: str) -> list[SearchHit]:
    """Where what is called `name` is: structures by id or by what is written on them, with the slot that this names,
    and places between structures, such as "bay 2 level 3".

    Raises SiteError, with the nearest names, where nothing is called so.
    """
    _require_text(name)
    searched = map_of(site_map)
    return find_structures(searched, name, lambda: places_of(searched))


def measure(site_map: SiteMap | PathLike, first: str, second: str) -> VertexDistance:
    """From one vertex or edge to another ("upright 1 / right", or "A: upright 1 / right" where several rows have one),
    with the covariance of what lies between: errors that both share do not count. Raises SiteError, with the nearest
    names, for what the map has not, or has in several rows."""
    return vertex_distance(map_of(site_map), first, second)


def export(site_map: SiteMap | PathLike, path: PathLike, format: str | None = None) -> Path:
    """Write a map in another format, such as "csv" or "ply"; docs/exports.md has all of them. Default: what the path's
    ending tells.

    Raises SiteError for an unknown format or ending, PluginError for an exporter that fails, OutputError.
    """
    target, formats = where(path), exporters()
    if note := export_map(map_of(site_map), format or format_of(target, formats), target, formats):
        logging.getLogger("savmap").warning(visible(note))
    return target


def map_of(source: SiteMap | PathLike) -> SiteMap:
    """A map, or that of its file or folder. Raises OutputError."""
    return source if isinstance(source, SiteMap) else load_map(source)


def several(names: Sequence[str] | None) -> list[str] | None:
    """Texts that were given as a list, or as the single text that is meant."""
    if names is None:
        return None
    texts = [names] if isinstance(names, str) else list(names)
    for name in texts:
        _require_text(name)
    return texts


def _require_text(name: object) -> None:
    if not isinstance(name, str):
        raise TypeError(f"a text is expected, not {type(name).__name__}")


def _mapped(job: Job, write: bool, progress: Monitor | None, jobs: int) -> SiteMap:
    if jobs < 0:
        raise SiteError(f"jobs {jobs}: give the number of rows that are mapped at a time, or 0 for all in this process")
    monitor, options = progress or SilentMonitor(), RunOptions(jobs)
    if not write:
        return map_job(job, options, monitor).site_map
    with failures_recorded(job.output):
        require_ready(job)
        prepare(job.output, written_files(job))
        with locked(job.output):
            return map_job_into(job, options, monitor).site_map
