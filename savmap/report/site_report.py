"""The report of a map: what the plugins score and draw of it, and the page made from that."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from savmap.errors import OutputError, SavmapError
from savmap.maps.map_file import map_in, read_map
from savmap.maps.orthophoto_file import read_orthophotos
from savmap.maps.run_record import LOG, RunLog, read_log
from savmap.maps.survey import read_survey
from savmap.plugin.apps import dates, viewer
from savmap.plugin.manager import LoadedPlugin, load_installed, open_plugin
from savmap.report.evaluation import evaluate_site
from savmap.report.page import Report, write_page
from savmap.types import Drawing, Evaluation, JointCovariance, Orthophoto, RowMap, SiteMap, Still, Structure, Survey

PluginsByRow = Mapping[str, Mapping[str, LoadedPlugin]]
"""Opened plugins by row and name."""
StructuresByRow = dict[str, dict[str, list[Structure]]]
log = logging.getLogger("savmap")
_NO_ROW_IN_COMMON = "The survey has none of the rows that were mapped: there are no errors to show."


def report_for(
    site_map: SiteMap,
    plugins: PluginsByRow,
    survey: Survey | None = None,
    log: RunLog | None = None,
    title: str = "Site map",
    photos: Mapping[str, Orthophoto] | None = None,
    stills: Mapping[str, Sequence[Still]] | None = None,
) -> Report:
    """The report of a map, with the run that made it, against a survey, and with orthophotos and stills by row where
    they are given. `plugins`: the opened plugins of each row.

    Each plugin scores and draws each row once. Raises OutputError where a row's survey is malformed, PluginError where
    a plugin fails.
    """
    surveyed = survey.rows if survey else {}
    common = any(name in surveyed for name in site_map.rows)
    evaluation = evaluation_of(site_map, survey, plugins) if survey and common else None
    deviations = evaluation.deviations if evaluation else {}
    drawings = {
        name: drawings_of(row, plugins[name], surveyed.get(name), deviations.get(name, {}))
        for name, row in site_map.rows.items()
    }
    remarks = (_NO_ROW_IN_COMMON,) if survey and not common else ()
    places = shown_places(site_map)
    return Report(site_map, drawings, log, evaluation, remarks, title, photos or {}, stills=stills or {}, places=places)


def write_report(
    map_file: Path,
    path: Path,
    run_file: Path | None = None,
    survey_file: Path | None = None,
    against: Path | None = None,
) -> None:
    """Write the report of a map.json as an HTML page, with the orthophotos that lie beside the map, and with what
    changed since an earlier map or that of a folder (`against`). Raises SavmapError."""
    if path.suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"{path}: a report is an HTML page; name it .html")
    site_map = read_map(map_file)
    log = _log_of(site_map, run_file) if run_file else log_beside(site_map, map_file)
    survey = read_survey(survey_file) if survey_file else None
    photos = read_orthophotos(site_map.rows, map_file.parent)
    report = report_for(site_map, plugins_of_map(site_map), survey, log, photos=photos)
    page = viewer_page()
    address = page if page and map_file.parent == path.parent and map_file.with_name(page).is_file() else ""
    changes = dates().changes_since(map_in(against), site_map) if against else None
    write_page(replace(report, viewer=address, changes=changes), path)


def viewer_page() -> str:
    """The name of the page that a viewer writes beside a map; empty where none is installed."""
    shown_by = viewer()
    return shown_by.PAGE if shown_by else ""


def log_beside(site_map: SiteMap, map_file: Path) -> RunLog | None:
    """The record of the run that made a map, where it lies beside it."""
    try:
        return _log_of(site_map, map_file.with_name(LOG))
    except OutputError:
        return None


def _log_of(site_map: SiteMap, run_file: Path) -> RunLog:
    """The record of the run that made a map. Raises OutputError for that of another, which mapped other rows."""
    log = read_log(run_file)
    mapped = {name for name, row in log.rows.items() if row.status != "failed"}
    if differing := sorted(mapped ^ {*site_map.rows}):
        raise OutputError(
            f"{run_file}: is of another run than the map: row {differing[0]} is in one of them alone; "
            "give the run.json that lies beside the map, or leave --run out"
        )
    return log


def evaluate_files(map_file: Path, survey_file: Path) -> Evaluation:
    """A map file against a survey file. Raises SavmapError."""
    site_map = read_map(map_file)
    return evaluation_of(site_map, read_survey(survey_file), plugins_of_map(site_map))


def plugins_of_map(site_map: SiteMap) -> PluginsByRow:
    """The plugins that made a map, opened with their default settings: for a map file, which does not say which
    settings made it. Raises PluginError."""
    names = dict.fromkeys(plugin for row in site_map.rows.values() for plugin in row.structures)
    plugins = {name: open_plugin(name, {}) for name in names}
    return dict.fromkeys(site_map.rows, plugins)


def openings_of(site_map: SiteMap) -> StructuresByRow:
    """The spaces between structures whose clear width and height matter, by row and plugin; none of plugins that are
    not installed."""
    return _asked(site_map, lambda plugin, structures, _: plugin.openings(structures))


def places_of(site_map: SiteMap) -> StructuresByRow:
    """The places between structures that have a name, by row and plugin; none of plugins that are not installed."""
    return _asked(site_map, lambda plugin, structures, joint: plugin.places(structures, joint))


def shown_places(site_map: SiteMap) -> StructuresByRow:
    """The same for a page that is written without them where a plugin cannot give them, of which a warning tells."""
    try:
        return places_of(site_map)
    except SavmapError as error:
        log.warning("report and viewer have no sizes of the places between structures: %s", error)
        return {}


def _asked(
    site_map: SiteMap, ask: Callable[[LoadedPlugin, Sequence[Structure], JointCovariance | None], list[Structure]]
) -> StructuresByRow:
    answers: StructuresByRow = {}
    opened: dict[str, LoadedPlugin | None] = {}
    for row in site_map.rows.values():
        for name, structures in row.structures.items():
            if name not in opened:
                opened[name] = open_plugin(name, {}) if name in load_installed().classes else None
            plugin = opened[name]
            if plugin is not None:
                answers.setdefault(row.name, {})[name] = ask(plugin, structures, row.joint)
    return answers


def evaluation_of(site_map: SiteMap, survey: Survey, plugins: PluginsByRow) -> Evaluation:
    """A map against a survey, scored by the plugins that made it. Raises OutputError."""
    return evaluate_site(
        site_map,
        survey,
        lambda row, name, structures, surveyed: plugins[row][name].evaluate(structures, surveyed),
    )


def drawings_of(
    row: RowMap,
    plugins: Mapping[str, LoadedPlugin],
    surveyed: Mapping[str, Any] | None,
    deviations: Mapping[str, Mapping[str, float]],
) -> list[Drawing]:
    """What the plugins draw of a row, over its survey where there is one, what the verdict warns of as warned;
    `deviations`: by plugin and structure id, m."""
    warned = {name for warning in row.verdict.warnings for name in warning.subjects} if row.verdict else set[str]()
    return [
        replace(drawing, role="warned") if drawing.role == "mapped" and drawing.name in warned else drawing
        for name, structures in row.structures.items()
        for drawing in plugins[name].draw(structures, surveyed, deviations.get(name, {}))
    ]
