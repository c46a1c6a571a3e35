"""The site report of a map: what the plugins draw and score of it, on one page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from savmap.errors import OutputError
from savmap.plugin.isolation import isolated
from savmap.plugin.manager import LoadedPlugin, open_plugin
from savmap.types import RowMap, SiteMap

if TYPE_CHECKING:
    from savmap.evaluation import Evaluation, Survey
    from savmap.maps.run_record import RunLog
    from savmap.report.drawing import Drawing


def report_for(
    site_map: SiteMap,
    path: Path,
    log: "RunLog | None" = None,
    survey: "Survey | None" = None,
    title: str = "Site map",
    skip: bool = False,
) -> None:
    """Write the report of a map, with the run that made it and against a survey where they are given; `skip`: without the part of a
    plugin that fails.

    Raises OutputError where it cannot be written or a row's survey is malformed, PluginError for a plugin that made the map
    and is not installed or fails.
    """
    from savmap.report.page import write_page
    from savmap.report.record import Report

    plugins = plugins_of_map(site_map, skip)
    sheets = survey.rows if survey else {}
    common = any(name in sheets for name in site_map.rows)
    remarks = (
        ("The survey has none of the rows that were mapped: there are no errors to show.",)
        if survey and not common
        else ()
    )
    drawings = {
        name: drawings_of([plugins[plugin] for plugin in row.structures], row, sheets.get(name))
        for name, row in site_map.rows.items()
    }
    evaluation = evaluation_of(site_map, survey, plugins) if survey and common else None
    write_page(Report(site_map, drawings, log, evaluation, remarks, title), path)


def report_files(map_file: Path, path: Path, run_file: Path | None = None, survey_file: Path | None = None) -> str:
    """Write the report of a map.json; the line for the user. Raises SavmapError."""
    from savmap.maps.map_file import read_map
    from savmap.maps.run_record import read_log
    from savmap.maps.survey import read_survey

    if path.suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"{path}: a report is an HTML page; name it .html")
    log = read_log(run_file) if run_file else None
    report_for(read_map(map_file), path, log, read_survey(survey_file) if survey_file else None)
    return f"wrote {path}"


def plugins_of_map(site_map: SiteMap, skip: bool = False) -> dict[str, LoadedPlugin]:
    """Rooms by name for the plugins that made a map, with their usual settings; `skip`: their failures are contained. Raises PluginError."""
    names = dict.fromkeys(plugin for row in site_map.rows.values() for plugin in row.structures)
    plugins = [open_plugin(name, {}) for name in names]
    return {plugin.name: plugin for plugin in (isolated(plugins) if skip else plugins)}


def evaluation_of(site_map: SiteMap, survey: "Survey", plugins: Mapping[str, LoadedPlugin]) -> "Evaluation":
    """A map against a survey, scored by the plugins that made it. Raises OutputError."""
    from savmap.evaluation import evaluate_site

    return evaluate_site(site_map, survey, lambda name, own, sheet: plugins[name].evaluate(own, sheet))


def drawings_of(plugins: Sequence[LoadedPlugin], row: RowMap, survey: Mapping[str, Any] | None) -> "list[Drawing]":
    """What all rooms draw of a row, over its survey where there is one."""
    drawings: list[Drawing] = []
    for plugin in plugins:
        own = row.structures[plugin.name]
        deviations = plugin.evaluate(own, survey).deviations if survey is not None else {}
        drawings += plugin.draw(own, survey, deviations)
    return drawings
