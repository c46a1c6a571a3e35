"""The public Python API: maps from site files and videos, their scores, and other formats. See docs/python-api.md."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from savmap.assembly import aligned
from savmap.errors import SiteError, visible
from savmap.files.urls import where
from savmap.jobs.cache import locked
from savmap.jobs.depths import kept_depths
from savmap.jobs.map_site import MAP, failures_recorded, map_job, map_job_into, written_files
from savmap.jobs.scheduler import RunOptions
from savmap.maps.comparison import LEVEL, Comparison, compare_maps
from savmap.maps.distance import VertexDistance, vertex_distance
from savmap.maps.exports import export_map, format_of
from savmap.maps.imports.records import options_of
from savmap.maps.imports.survey import ImportedSurvey, RowPlaces, elements_of, in_rows, place_of, survey_of
from savmap.maps.map_file import map_in, read_map, write_map
from savmap.maps.search import SearchHit, find_structures
from savmap.maps.survey import read_survey
from savmap.plugin.manager import exporters, load_installed, open_plugin
from savmap.report.inspection import inspect_map
from savmap.report.site_report import evaluation_of, openings_of, places_of, plugins_of_map, viewed
from savmap.report.viewer.notebook import MapView, in_notebook
from savmap.site.job import Job, job_for, prepare
from savmap.site.limits import limits_of, load_limits
from savmap.site.load import load_alignment
from savmap.site.overrides import overrides_of
from savmap.site.preflight import require_ready
from savmap.types import Evaluation, Inspection, SiteMap, Survey
from savmap.types.progress import Monitor, SilentMonitor

PathLike = str | Path


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
    keys, mapped = overrides_of(_several(overrides) or [], {}), None if against is None else where(against)
    job = job_for(where(site), _several(plugins), folder, overrides=keys, against=mapped, against_row=row)
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
    folder, keys = where(output) if output is not None else Path(), overrides_of(_several(overrides) or [], {})
    mapped = None if against is None else where(against)
    job = job_for(where(video), _several(plugins), folder, camera_height_m, side, None, keys, mapped, row)
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
    scored = _map_of(site_map)
    return evaluation_of(scored, truth, plugins_of_map(scored))


def compare(old: SiteMap | PathLike, new: SiteMap | PathLike, level: float = LEVEL) -> Comparison:
    """What changed from an old map of a place to a new one (records, or paths of map.json or of its folder), and what
    of it both can tell.

    Rows are known by their names; how their frames lie is found from what both maps have. level: the share of false
    ones among the changes that is accepted. Raises OutputError for a file that is no map, PluginError for a plugin that
    fails.
    """
    before, after = map(_map_of, (old, new))
    return compare_maps(before, after, (openings_of(before), openings_of(after)), level)


def inspect(
    site_map: SiteMap | PathLike,
    limits: PathLike | Mapping[str, Any] | None = None,
    *,
    drawing: PathLike | Survey | None = None,
    folder: PathLike | None = None,
) -> Inspection:
    """What in a map keeps the limits of an inspection, and what does not: a measuring aid for a person who may inspect,
    and no inspection by itself.

    limits: a file of limits, or what stands in it; default: the plugins'. drawing: what was ordered or built: a survey
    file, or a table, drawing or building model as `import_survey` reads it. folder: of the run that made the map, whose
    pictures tell what is behind the faces; default: the one that the map is read from. Raises SiteError for limits that
    are wrong, OutputError for a file that cannot be read, PluginError for a plugin that fails.
    """
    inspected, plan = _map_of(site_map), drawing
    if plan is not None and not isinstance(plan, Survey):
        path = where(plan)
        plan = read_survey(path) if path.suffix.lower() == ".json" else import_survey(path, inspected).survey
    if folder is None and not isinstance(site_map, SiteMap):
        folder = map_in(where(site_map)).parent
    depths_of = partial(kept_depths, where(folder)) if folder is not None else lambda _: None
    if limits is None or isinstance(limits, Mapping):
        given, named = limits_of(limits or {}), "limits"
    else:
        given, named = load_limits(where(limits)), str(where(limits))
    return inspect_map(inspected, given, plan, named, depths_of)


def align(site_map: SiteMap | PathLike, places: PathLike, tell: Callable[[str], None] | None = None) -> SiteMap:
    """The map with its place in the user's world (`alignment`), from a file with the section `align` of a site file, or
    that alone.

    tell: is given a line for each thing that the user should know, such as a point that contradicts the others and was
    left out. Raises SiteError with file and line where the places do not tell where the site stands, or contradict one
    another.
    """
    result = aligned(_map_of(site_map), load_alignment(where(places)))
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
    searched = _map_of(site_map)
    return find_structures(searched, name, lambda: places_of(searched))


def view(
    site_map: SiteMap | PathLike,
    *,
    survey: PathLike | None = None,
    against: PathLike | None = None,
    fresh: bool = False,
    show: bool | None = None,
) -> MapView:
    """The viewer of a map: a notebook shows what this returns; elsewhere it is opened in the browser.

    The page lies beside a map.json, and in a temporary folder for a record. survey: its errors are shown; against: an
    earlier map, to be shown with it; fresh: the page is written anew; show: whether the browser is opened. Raises
    SavmapError's kinds.
    """
    source = where(site_map) if not isinstance(site_map, SiteMap) else Path(mkdtemp(prefix="savmap-view-")) / "map"
    if isinstance(site_map, SiteMap):
        write_map(site_map, source / MAP)
    page, written = viewed(
        source, None if survey is None else where(survey), fresh, None if against is None else where(against)
    )
    map_view = MapView(page, written)
    if show or (show is None and not in_notebook()):
        map_view.open()
    return map_view


def measure(site_map: SiteMap | PathLike, first: str, second: str) -> VertexDistance:
    """From one vertex or edge to another ("upright 1 / right", or "A: upright 1 / right" where several rows have one),
    with the covariance of what lies between: errors that both share do not count. Raises SiteError, with the nearest
    names, for what the map has not, or has in several rows."""
    return vertex_distance(_map_of(site_map), first, second)


def import_survey(
    paths: Sequence[PathLike] | PathLike,
    site_map: SiteMap | PathLike | None = None,
    *,
    places: Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    labels: Mapping[str, str] | None = None,
    unit: str | None = None,
    row: str | None = None,
    frame: str | None = None,
) -> ImportedSurvey:
    """A survey out of tables (CSV), drawings (DXF) and building models (IFC), to be written with `write_survey`.

    site_map: says where rows stand, with its alignment; or places: "A=X,Y,HEADING", where a row's origin is in your
    world. columns: the name or number of a table's column for "row", "id", "label", "vertex", "x", "y", "z", "text".
    labels: what a layer, a code, a class or a type is called here. unit: of lengths, where the file does not say it.
    row: of what names none. frame: "row", "site" or "world".

    Raises SiteError for an option that is wrong, OutputError for a file that cannot be read, or does not say enough.
    """
    stand = RowPlaces(site_map if site_map is None else _map_of(site_map), dict(map(place_of, _several(places) or [])))
    options = options_of(columns or {}, labels or {}, unit, row, frame, bool(stand))
    files = [where(path) for path in ([paths] if isinstance(paths, str | Path) else paths)]
    plugins = load_installed().classes
    classes = {name: tuple(plugin.classes) for name, plugin in plugins.items()}
    names = {label.casefold(): label for labels_of_plugin in classes.values() for label in labels_of_plugin}
    for plugin in plugins.values():
        names |= {theirs.casefold(): label for theirs, label in getattr(plugin, "ifc_classes", {}).items()}
    read = [elements_of(path, options, names) for path in files]
    moved, notes = in_rows([element for file in read for element in file.elements], stand, row)
    opened = cache(lambda name: open_plugin(name, {}))  # for all rows: finding installed packages takes a while
    result = survey_of(moved, classes, lambda name, entry: opened(name).survey_entry(entry))
    return replace(result, notes=(*(note for file in read for note in file.notes), *notes, *result.notes))


def export(site_map: SiteMap | PathLike, path: PathLike, format: str | None = None) -> Path:
    """Write a map in another format, such as "csv" or "ply"; docs/exports.md has all of them. Default: what the path's
    ending tells.

    Raises SiteError for an unknown format or ending, PluginError for an exporter that fails, OutputError.
    """
    target, formats = where(path), exporters()
    if note := export_map(_map_of(site_map), format or format_of(target, formats), target, formats):
        logging.getLogger("savmap").warning(visible(note))
    return target


def _map_of(source: SiteMap | PathLike) -> SiteMap:
    return source if isinstance(source, SiteMap) else load_map(source)


def _several(names: Sequence[str] | None) -> list[str] | None:
    """Texts that were given as a list, or as the single text that is meant."""
    if names is None:
        return None
    several = [names] if isinstance(names, str) else list(names)
    for name in several:
        _require_text(name)
    return several


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
