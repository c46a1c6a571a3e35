"""A page that follows a live session: what to do, what is mapped and how sure it is, and the latest map; served to this
machine alone, with server-sent events (WHATWG HTML, 9.2)."""

import json
import time
from collections.abc import Iterator
from functools import partial
from http import HTTPStatus
from importlib.resources import files
from pathlib import Path
from string import Template
from urllib.parse import urlsplit

import numpy as np

from savmap.apps.viewer.serve import PageHandler, ViewServer
from savmap.errors import OutputError
from savmap.maps.map_file import read_map
from savmap.report.templating import digest
from savmap.types import Bools, SiteMap, Structure

STATE, MAP, VIEW = "live.json", "map.json", "view.html"
POLL_S, SILENT_S = 0.3, 5.0
"""Between looks at the files, and between lines that keep the connection."""
POLICY = (
    "default-src 'none'; script-src 'sha256-{script}'; style-src 'sha256-{style}'; connect-src 'self'; "
    "frame-src 'self'; img-src data:; base-uri 'none'; form-action 'none'"
)
UP_TO_MM = 1000.0


class LiveServer(ViewServer):
    """Serves the page of a live session's folder on a port of the loopback device. Raises OutputError where the port is
    taken."""

    def __init__(self, folder: Path, port: int = 0) -> None:
        super().__init__(folder / VIEW, port, partial(_LiveHandler, live_page()))


class _LiveHandler(PageHandler):
    """Gives out the page, its events, and the latest map's page."""

    def __init__(self, live_page: str, page: Path, key: str, *args: object) -> None:
        self._live_page = live_page
        super().__init__(page, key, *args)

    def do_GET(self) -> None:  # noqa: N802 -- the library's name
        """Answer as `PageHandler` does, but for the live page and its events."""
        path = urlsplit(self.path).path
        answer = {"/": self._send_page, "/events": self._send_events}.get(path)
        if answer is None:
            self.path = "/" if path == f"/{VIEW}" else self.path  # the page of the latest map
            super().do_GET()
        elif (refused := self.foreign()) is not None:
            self.send_error(refused)
        else:
            answer()

    def _send_page(self) -> None:
        content = self._live_page.encode()
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def _send_events(self) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        self.end_headers()
        try:
            for event in events_of(self._page.parent):
                self.wfile.write(event.encode())
                self.wfile.flush()
        except OSError:  # the browser is closed
            return


def live_page() -> str:
    """The page."""
    style, script, page = (
        (files("savmap.apps.viewer") / f"live.{ending}").read_text(encoding="utf-8") for ending in ("css", "js", "html")
    )
    policy = POLICY.format(script=digest(script), style=digest(style))
    return Template(page).substitute(policy=policy, style=style, script=script)


def events_of(folder: Path) -> Iterator[str]:
    """Events, without end: `state` whenever the session's state changes, `map` whenever there is a new map with its
    page, which is written last."""
    states, maps, spoken_s = 0, 0, 0.0
    while True:
        text = ""
        if (changed := _changed_ns(folder / STATE)) != states and changed:
            states, text = changed, _event("state", _compact(folder / STATE))
        if (changed := _changed_ns(folder / VIEW)) != maps and changed:
            maps, text = changed, text + _event("map", json.dumps(plan_of(folder / MAP)))
        if not text and time.monotonic() - spoken_s > SILENT_S:
            text = ": \n\n"
        if text:
            spoken_s = time.monotonic()
            yield text
        time.sleep(POLL_S)


def plan_of(path: Path) -> dict[str, object]:
    """What a map holds, for a plan of its rows' faces: each element's edges [x, y, x, y] m in its row's frame, the mean
    standard deviation of its vertices along x and y, but of what is assumed, and the probability that it exists."""
    try:
        site_map: SiteMap = read_map(path)
    except OutputError:
        return {"elements": []}
    rows = site_map.rows.values()
    return {
        "elements": [
            _element(part, part.assumed(plugin, row.joint))
            for row in rows
            for plugin, group in row.structures.items()
            for part in group
            if len(part.edges)
        ]
    }


def _element(part: Structure, assumed: Bools) -> dict[str, object]:
    ends = part.vertices[np.asarray(part.edges)][:, :, :2].reshape(len(part.edges), 4)
    variances = np.where(assumed, np.nan, np.diagonal(part.covariances, axis1=1, axis2=2))[:, :2]
    sigma_mm = 1000 * float(np.sqrt(np.nanmean(variances))) if np.isfinite(variances).any() else UP_TO_MM
    probability = part.attributes.get("probability", 1.0)
    return {
        "id": part.id,
        "edges": np.round(ends, 4).tolist(),
        "sigma_mm": round(min(sigma_mm, UP_TO_MM), 2),
        "probability": probability if isinstance(probability, float) else 1.0,
    }


def _event(name: str, data: str) -> str:
    return f"event: {name}\ndata: {data}\n\n"


def _compact(path: Path) -> str:
    return json.dumps(json.loads(path.read_text(encoding="utf-8")))


def _changed_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0
