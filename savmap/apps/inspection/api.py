"""`savmap.inspect`."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from savmap.apps.exchange.api import import_survey
from savmap.apps.inspection.inspect import inspect_map
from savmap.files.urls import where
from savmap.jobs.api import PathLike, map_of
from savmap.jobs.depths import kept_depths
from savmap.maps.map_file import map_in
from savmap.maps.survey import read_survey
from savmap.site.limits import limits_of, load_limits
from savmap.types import Inspection, SiteMap, Survey


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
    inspected = map_of(site_map)
    if folder is None and not isinstance(site_map, SiteMap):
        folder = map_in(where(site_map)).parent
    depths_of = partial(kept_depths, where(folder)) if folder is not None else lambda _: None
    if limits is None or isinstance(limits, Mapping):
        given, named = limits_of(limits or {}), "limits"
    else:
        given, named = load_limits(where(limits)), str(where(limits))
    return inspect_map(inspected, given, _survey_of(drawing, inspected), named, depths_of)


def _survey_of(source: PathLike | Survey | None, site_map: SiteMap) -> Survey | None:
    """A survey, that of a file, or that of a table, drawing or model whose rows the map places."""
    if source is None or isinstance(source, Survey):
        return source
    path = where(source)
    return read_survey(path) if path.suffix.lower() == ".json" else import_survey(path, site_map).survey
