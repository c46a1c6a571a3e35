"""The inspection of a map: every installed plugin that made it is asked about its structures, row by row."""

from collections.abc import Callable, Mapping, Sequence

from pydantic import BaseModel

from savmap.apps.inspection.aisle import AISLE, aisle_inspections
from savmap.errors import SiteError
from savmap.plugin.inspection import limit_lines
from savmap.plugin.manager import load_installed, open_plugin
from savmap.report.site_report import places_of
from savmap.site.limits import SiteLimits
from savmap.types import FaceDepths, Inspection, RowInspection, RowMap, SiteMap, Survey


def inspect_map(
    site_map: SiteMap,
    limits: SiteLimits | None = None,
    survey: Survey | None = None,
    where: str = "limits",
    depths_of: Callable[[RowMap], FaceDepths | None] = lambda _: None,
) -> Inspection:
    """What the plugins find in a map. `survey`: a drawing or survey to compare with; `where`: what the limits were read
    from, for errors; `depths_of`: what is behind a row's face.

    Raises SiteError for limits of a plugin that is not installed, or that it does not take; OutputError where the
    survey is malformed; PluginError where a plugin fails.
    """
    chosen = limits or SiteLimits()
    usable = load_installed().classes
    if unknown := sorted(chosen.plugins.keys() - usable.keys()):
        raise SiteError(f"{where}: plugins.{unknown[0]}: no such plugin; installed are {', '.join(usable)}")
    mapped_by = dict.fromkeys(plugin for row in site_map.rows.values() for plugin in row.structures)
    plugins = {name: open_plugin(name, {}) for name in mapped_by if name in usable}
    models = {name: plugin.limits(chosen.plugins.get(name, {}), where) for name, plugin in plugins.items()}
    places = places_of(site_map)
    surveyed = survey.rows if survey else {}
    rows: dict[str, dict[str, RowInspection]] = {}
    for row in site_map.rows.values():
        depths = depths_of(row)
        rows[row.name] = {
            name: plugins[name].inspect(
                structures,
                places.get(row.name, {}),
                row.joint,
                models[name],
                surveyed.get(row.name),
                {other.name: other.structures.get(name, ()) for other in site_map.rows.values() if other is not row},
                depths,
            )
            if name in plugins
            else RowInspection(unchecked=(f"what `{name}` mapped: the plugin is not installed",))
            for name, structures in row.structures.items()
        }
    for name, part in aisle_inspections(site_map, chosen.envelope).items():
        rows[name][AISLE] = part
    named: dict[str, BaseModel] = {AISLE: chosen.envelope, **models}
    return Inspection(
        rows,
        tuple(
            line
            for name, model in named.items()
            for line in limit_lines(
                model,
                applied_keys([parts[name] for parts in rows.values() if name in parts], model),
                "envelope: " if name == AISLE else f"{name}: ",
            )
        ),
    )


def applied_keys(parts: Sequence[RowInspection], limits: BaseModel) -> set[str]:
    """Which limits a plugin applied; all, where it has a finding by a limit that it does not name."""
    findings = [finding for part in parts for finding in part.findings]
    if any(finding.limit is not None and not finding.limit_key for finding in findings):
        return set(type(limits).model_fields)
    named = {finding.limit_key for finding in findings if finding.limit is not None}
    return named | {key for part in parts for key in part.applied}


def unchecked_of(inspection: Inspection) -> Mapping[str, tuple[str, ...]]:
    """What was not checked, by line: the rows of which it is said."""
    rows: dict[str, list[str]] = {}
    for row, _, part in inspection.parts():
        for line in part.unchecked:
            rows.setdefault(line, []).append(row)
    return {line: tuple(dict.fromkeys(names)) for line, names in rows.items()}
