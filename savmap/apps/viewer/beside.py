"""The viewer's page beside a map: that of a run, and the one that is asked for."""

from collections.abc import Sequence
from pathlib import Path

from savmap.apps.dates.comparison.compare import LEVEL
from savmap.apps.dates.comparison.records import Comparison
from savmap.apps.dates.files import compared
from savmap.apps.viewer.data import Before
from savmap.apps.viewer.page import PARTS, Origin, View, script_names, write_view
from savmap.files.atomic import sha256
from savmap.maps.map_file import map_in, read_map
from savmap.maps.orthophoto_file import read_orthophotos
from savmap.maps.survey import read_survey
from savmap.plugin.apps import WrittenMap
from savmap.report.site_report import evaluation_of, plugins_of_map, shown_places
from savmap.types import SiteMap

PAGE = "view.html"


def files_of(rows: Sequence[str], folder: Path) -> list[Path]:
    """The page, and a script of each kind of each row."""
    return [folder / PAGE, *(folder / part / f"{name}.js" for name in script_names(rows).values() for part in PARTS)]


def write_beside(written: WrittenMap) -> None:
    """Write the page of a run's map. Raises OutputError."""
    origin = origin_of(written.file, written.survey)
    view = View(
        written.site_map,
        written.evaluation,
        written.title,
        written.photos,
        written.stills,
        origin,
        None,
        written.places,
    )
    write_view(view, written.file.with_name(PAGE))


def viewed(
    source: Path,
    survey_file: Path | None = None,
    fresh: bool = False,
    against: Path | None = None,
    comparison: Comparison | None = None,
) -> tuple[Path, bool]:
    """The viewer's page of a map.json, or of that in a folder, and whether it was written now: where there is none,
    where that which is there is of another map, of another survey or another earlier map (`against`) than the one asked
    for, or by another savmap, or `fresh`. `comparison`: with that map, where it is known. Raises SavmapError."""
    map_file, old_file = map_in(source), map_in(against) if against else None
    page = map_file.with_name(PAGE)
    origin = origin_of(map_file, survey_file, old_file)
    if not fresh and origin.is_of(page):
        return page, False
    site_map = read_map(map_file)
    evaluation = evaluation_of(site_map, read_survey(survey_file), plugins_of_map(site_map)) if survey_file else None
    before = before_of(old_file, site_map, comparison) if old_file else None
    photos = read_orthophotos(site_map.rows, map_file.parent)
    view = View(
        site_map,
        evaluation,
        map_file.absolute().parent.name or "Site map",
        photos,
        None,
        origin,
        before,
        shown_places(site_map),
    )
    write_view(view, page)
    return page, True


def origin_of(map_file: Path, survey_file: Path | None, old_file: Path | None = None) -> Origin:
    """What a viewer's page of these files says that it is made of. Raises OutputError."""
    return Origin(*(sha256(file) if file else "" for file in (map_file, survey_file, old_file)))


def before_of(old_file: Path, new: SiteMap, comparison: Comparison | None) -> Before:
    """An earlier map, compared with a later one unless it was, with the orthophotos that lie beside it."""
    old = read_map(old_file)
    return Before(
        old, comparison or compared(old, new, LEVEL), read_orthophotos(old.rows, old_file.parent), old_file.parent
    )
