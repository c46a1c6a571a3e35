"""Map files compared: the page and the JSON file of it."""

import os
from pathlib import Path
from urllib.parse import quote

from savmap.apps.dates.comparison.compare import compare_maps
from savmap.apps.dates.comparison.records import Comparison
from savmap.apps.dates.comparison.texts import comparison_text
from savmap.apps.dates.page import Dates, write_comparison
from savmap.errors import OutputError
from savmap.files.atomic import write_text
from savmap.maps.map_file import map_in, read_map, require_other
from savmap.maps.orthophoto_file import read_orthophotos
from savmap.report.site_report import log_beside, openings_of
from savmap.types import SiteMap


def compared(old: SiteMap, new: SiteMap, level: float) -> Comparison:
    """Two maps, with the openings that their plugins know. Raises PluginError."""
    return compare_maps(old, new, (openings_of(old), openings_of(new)), level)


def compare_files(
    old: Path,
    new: Path,
    level: float,
    page: Path | None = None,
    json_file: Path | None = None,
    view: Path | None = None,
) -> Comparison:
    """Two map files, or those of two folders, compared, with the page and the JSON file that are wanted; the page links
    to `view`, a page of both dates that is written later. It shows the orthophotos that lie beside both maps. Raises
    SavmapError."""
    if page is not None and page.suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"{page}: a comparison's page is an HTML page; name it .html")
    old_file, new_file = map_in(old), map_in(new)
    require_other(json_file, old_file, new_file)
    _require_distinct(page, json_file, view)
    before, after = read_map(old_file), read_map(new_file)
    comparison = compared(before, after, level)
    if json_file is not None:
        write_text(json_file, comparison_text(comparison))
    if page is not None:
        photos = [read_orthophotos(site.rows, file.parent) for site, file in ((before, old_file), (after, new_file))]
        names = ("old map", dated(before, old_file)), ("new map", dated(after, new_file))
        viewer = address_from(page, view) if view else ""
        dates = Dates(before, after, comparison, photos[0], photos[1], viewer=viewer, names=names)
        write_comparison(dates, page)
    return comparison


def dated(site_map: SiteMap, map_file: Path) -> str:
    """A map's file, and the day on which it was made, where the run record beside it tells."""
    log = log_beside(site_map, map_file)
    return f"{map_file}, mapped on {log.ended[:10]}" if log and log.ended else f"{map_file}, date not recorded"


def _require_distinct(*outputs: Path | None) -> None:
    """Raise OutputError where two things would be written into one file."""
    names = [path.absolute() for path in outputs if path is not None]
    for path in names:
        if names.count(path) > 1:
            raise OutputError(f"{path}: is named for two things that would be written; give each a file of its own")


def address_from(page: Path, target: Path) -> str:
    """The address of a file as a page links to it; absolute where there is no way from one to the other."""
    try:
        way = os.path.relpath(target.absolute(), page.absolute().parent)
    except ValueError:  # another drive
        return target.absolute().as_uri()
    return quote(Path(way).as_posix())
