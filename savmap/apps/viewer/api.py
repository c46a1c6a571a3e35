"""`savmap.view`."""

from pathlib import Path
from tempfile import mkdtemp

from savmap.apps.viewer.beside import viewed
from savmap.apps.viewer.notebook import MapView, in_notebook
from savmap.files.urls import where
from savmap.jobs.api import PathLike
from savmap.jobs.map_site import MAP
from savmap.maps.map_file import write_map
from savmap.types import SiteMap


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
