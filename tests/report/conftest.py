"""Makes the modules beside the tests importable by them, and opens the viewer in a browser (extra `browser`)."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from opened_page import BROWSER, Open

from savmap.apps.viewer.page import View, write_view


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    if BROWSER is None:
        pytest.skip("no browser is installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as started:
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = started.chromium.launch(executable_path=BROWSER, args=arguments)
        yield browser
        browser.close()


@pytest.fixture
def opened(chromium: Any, tmp_path: Path) -> Iterator[Open]:
    """Opens views, on the model alone or with all that is seen at first; nothing may have been asked of a network, said on the console, or asked of
    the user."""
    heard: list[str] = []
    pages = []

    def opened(
        view: View, address: str = "", width: int = 1200, ready: bool = True, first: bool = False, scheme: str = "light"
    ) -> Any:
        write_view(view, tmp_path / "view.html")
        look: dict[str, Any] = {"viewport": {"width": width, "height": 760}, "reduced_motion": "reduce"}
        page = chromium.new_page(**look, color_scheme=scheme)
        page.on("console", lambda message: heard.append(message.text))
        page.on("pageerror", lambda error: heard.append(str(error)))
        page.on("dialog", lambda dialog: (heard.append("a dialog"), dialog.dismiss()))
        local = ("file:", "data:", "blob:")
        page.on("request", lambda asked: None if asked.url.startswith(local) else heard.append(asked.url))
        page.goto((tmp_path / "view.html").as_uri() + address)
        page.wait_for_selector("html[data-ready=yes]" if ready else "#failure")
        if ready and not first:
            page.evaluate("savmapViewer.lookout.toggle(false); savmapViewer.setKind('model')")
        pages.append(page)
        return page

    yield opened
    for page in pages:
        page.close()
    assert heard == []
