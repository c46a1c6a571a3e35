"""`savmap.import_survey`."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from savmap.apps.exchange.imports.records import options_of
from savmap.apps.exchange.imports.survey import ImportedSurvey, RowPlaces, elements_of, in_rows, place_of, survey_of
from savmap.files.urls import where
from savmap.jobs.api import PathLike, map_of, several
from savmap.plugin.manager import load_installed, open_plugin
from savmap.types import SiteMap


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
    stand = RowPlaces(site_map if site_map is None else map_of(site_map), dict(map(place_of, several(places) or [])))
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
