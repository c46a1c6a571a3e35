"""A map in a notebook: a table of its rows with a picture of each face, and the viewer in a frame."""

import base64
import sys
import webbrowser
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread

from savmap.apps.viewer.serve import ViewServer
from savmap.errors import SavmapError
from savmap.report.page import Report
from savmap.report.page.summary import Summary, summaries, total_counts
from savmap.report.picture import figure_text
from savmap.report.row_views import drawn_in, row_view
from savmap.report.site_report import drawings_of, plugins_of_map
from savmap.report.templating import rendered
from savmap.types import Drawing, SiteMap

MOST_BYTES = 170_000
"""Of all pictures, as a notebook keeps them."""
LEAST_RATIO = 0.2
FRAME_PX = 640


@dataclass(eq=False)
class MapView:
    """The viewer's page of a map, and whether it was written now. A notebook shows it in a frame, which its kernel
    serves to this machine alone."""

    page: Path
    written: bool = False
    _server: ViewServer | None = field(default=None, repr=False)

    def open(self) -> bool:
        """Open the page in this machine's browser; whether there is one."""
        return webbrowser.open(self.page.resolve().as_uri())

    def close(self) -> None:
        """End serving it."""
        if self._server is not None:
            self._server.stop()
            self._server.close()
            self._server = None

    def _repr_html_(self) -> str:
        if self._server is None:
            self._server = ViewServer(self.page)
            Thread(target=self._server.run, daemon=True).start()
        return rendered("frame.html.jinja", __package__, view=self._server, height=FRAME_PX, page=self.page)


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    python = sys.modules.get("IPython")
    shell = python.get_ipython() if python is not None else None
    return hasattr(shell, "kernel")


def map_html(site_map: SiteMap) -> str:
    """A map as HTML that needs nothing else and runs no script: what must be checked, a line for each row, and the
    rows' faces, as many as fit."""
    drawings, missing = dict[str, list[Drawing]](), ""
    try:
        plugins = plugins_of_map(site_map)
        drawings = {name: drawings_of(row, plugins[name], None, {}) for name, row in site_map.rows.items()}
    except SavmapError as error:
        missing = str(error)
    rows = summaries(Report(site_map, drawings))
    faces = dict(_faces(rows))
    return rendered(
        "notebook.html.jinja",
        __package__,
        banner=site_map.banner,
        labels=list(total_counts(rows)),
        rows=rows,
        faces=faces,
        more=sum(1 for row in rows if row.drawings) - len(faces),
        missing=missing,
    )


def _faces(rows: Sequence[Summary]) -> Iterator[tuple[str, str]]:
    """By row, its face as the address of a picture; those of the first rows, as many as fit."""
    left = MOST_BYTES
    for row in rows:
        if row.row is None or not drawn_in(row.drawings, "face"):
            continue
        text = figure_text(row_view(row.row, row.drawings, "face", least_ratio=LEAST_RATIO))
        picture = f"data:image/svg+xml;base64,{base64.b64encode(text.encode()).decode()}"
        left -= len(picture)
        if left < 0:
            return
        yield row.name, picture
