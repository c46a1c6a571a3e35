"""A server of one viewer's page, and of what lies beside it, to this machine alone."""

import secrets
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path, PurePosixPath
from urllib.parse import parse_qs, quote, unquote, urlsplit

from savmap.apps.viewer.page import FACES, JOINTS, STILLS
from savmap.errors import OutputError
from savmap.files.atomic import reason

LOOPBACK = "127.0.0.1"
FOREIGN = ("cross-site", "same-site")
"""What a browser says of requests that another site's page makes, or that of another port: only links may lead here."""


class ViewServer:
    """Serves a page on a port of the loopback device; 0 for one that is free. A frame of another page, such as a
    notebook, shows it where that knows the key of `frame_address`. Raises OutputError where the port is taken."""

    def __init__(self, page: Path, port: int = 0, handler: Callable[..., "PageHandler"] | None = None) -> None:
        self._key = secrets.token_urlsafe(16)
        try:
            self._server = ThreadingHTTPServer((LOOPBACK, port), partial(handler or PageHandler, page, self._key))
        except OSError as error:
            raise OutputError(f"port {port}: cannot be served on ({reason(error)})") from error

    @property
    def address(self) -> str:
        """The page's address."""
        return f"http://{LOOPBACK}:{self._server.server_port}/"

    @property
    def frame_address(self) -> str:
        """The page's address for a frame of another page."""
        return f"{self.address}?frame={self._key}"

    def run(self) -> None:
        """Serve until the user ends it."""
        try:
            self._server.serve_forever()
        except KeyboardInterrupt:
            return

    def stop(self) -> None:
        """End `run` in another thread."""
        self._server.shutdown()

    def close(self) -> None:
        """Give the port back."""
        self._server.server_close()

    def __enter__(self) -> "ViewServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class PageHandler(SimpleHTTPRequestHandler):
    """Gives out the page and the scripts beside it, and nothing else of the folder."""

    def __init__(self, page: Path, key: str, *args: object) -> None:
        self._page, self._key = page, key
        super().__init__(*args, directory=str(page.parent))  # type: ignore[arg-type]  # socketserver's own three

    def send_head(self) -> object:  # type: ignore[override]
        """Refuse other hosts' names (a web site may have its name point here), other sites' pages, and files that are
        no part of the viewer."""
        refused = self.refused()
        if refused is None:
            try:
                return super().send_head()
            except ValueError:  # no name of a file
                refused = HTTPStatus.BAD_REQUEST
        self.send_error(refused)
        return None

    def refused(self) -> HTTPStatus | None:
        """Why a request has no answer; the page for the address of the server itself."""
        return self.foreign() or self.unlisted()

    def foreign(self) -> HTTPStatus | None:
        """Why who asks has no answer: another host's name, or another site's page."""
        try:
            host = urlsplit(f"//{self.headers.get('Host', '')}").hostname
            key = parse_qs(urlsplit(self.path).query).get("frame", [""])[0]
        except ValueError:
            return HTTPStatus.BAD_REQUEST
        if host not in (LOOPBACK, "localhost"):
            return HTTPStatus.MISDIRECTED_REQUEST
        framed = self.headers.get("Sec-Fetch-Dest") == "iframe" and secrets.compare_digest(
            key.encode(), self._key.encode()
        )
        shown = self.headers.get("Sec-Fetch-Dest") == "document" or framed
        is_foreign = self.headers.get("Sec-Fetch-Site", "none") in FOREIGN and not shown
        return HTTPStatus.FORBIDDEN if is_foreign else None

    def unlisted(self) -> HTTPStatus | None:
        """Why what is asked for has no answer: it is no part of the viewer."""
        try:
            path = PurePosixPath(unquote(urlsplit(self.path).path))
        except ValueError:
            return HTTPStatus.BAD_REQUEST
        if not path.is_absolute():
            return HTTPStatus.BAD_REQUEST
        if str(path) == "/":
            self.path = f"/{quote(self._page.name)}"
            return None
        given = path.suffix == ".js" and path.parts[1] in (FACES, STILLS, JOINTS) and ".." not in path.parts
        return None if given else HTTPStatus.NOT_FOUND

    def end_headers(self) -> None:
        """Nothing is guessed about a file, a newer map is shown at once, and pages of other sites load nothing."""
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cache-Control", "no-cache")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""
