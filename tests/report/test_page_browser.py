"""The report in a real browser (extra `browser`, and a Chromium or Chrome on the path); skipped where there is none."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from made_up_page import EVIL, report
from opened_page import BROWSER, IN_BROWSER

from savmap.report.page import write_page

pytestmark = IN_BROWSER


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(params=[(1280, "light"), (390, "dark")], ids=["desktop", "phone"])
def page(browser: Any, request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Any]:
    """The page, open; nothing may have been asked of the network, said on the console, or asked of the user."""
    width, scheme = request.param
    write_page(report(), tmp_path / "page.html")
    page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
    heard: list[str] = []
    page.on("console", lambda message: heard.append(message.text))
    page.on("pageerror", lambda error: heard.append(str(error)))
    page.on("dialog", lambda dialog: (heard.append("a dialog"), dialog.dismiss()))
    page.on("request", lambda asked: heard.append(asked.url) if not asked.url.startswith(("file:", "data:")) else None)
    page.goto(f"file://{tmp_path / 'page.html'}")
    yield page
    page.close()
    assert heard == []


def test_page_fits_sorts_zooms_and_leads(page: Any) -> None:
    """One opened page: it fits its window; tables sort and are filtered; a face view zooms and says what is under the
    pointer; a row of the plan leads to its section."""
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    light = page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert light == page.evaluate("matchMedia('(prefers-color-scheme: light)').matches")

    rows = page.locator("#references-table tbody tr")
    given = page.locator("#references-table thead button").nth(2)
    given.click()
    assert rows.first.locator("td").nth(1).inner_text() == "3.0000"
    given.click()
    assert rows.first.locator("td").nth(1).inner_text() == "6.0000"
    assert page.locator("#references-table th[aria-sort=descending]").count() == 1
    page.locator(f"a[data-only='{EVIL}']").click()
    if rows.count() > 8:
        assert page.locator("#references-table tbody tr:visible").count() == 2

    face = page.locator("#row-A2-face")
    face.scroll_into_view_if_needed()
    page.locator("#row-A2-face.movable").wait_for()
    face.focus()
    page.keyboard.press("0")
    before = face.get_attribute("viewBox")
    page.keyboard.press("+")
    assert face.get_attribute("viewBox") != before
    page.keyboard.press("0")
    assert face.get_attribute("viewBox") == before
    bar = face.locator(".mapped path", has_text="bay 1 / bar 1").element_handle()
    bar.hover(force=True)
    told = "bay 1 / bar 1: height 0.100 \u00b1 0.003 m"
    for x in range(20, 40):  # a scroll that the first hover made silences what is told, for a moment
        bar.hover(force=True, position={"x": x, "y": 2})
        if page.locator("#tip").inner_text().startswith(told):
            break
        page.wait_for_timeout(50)
    assert page.locator("#tip").inner_text().startswith(told)
    page.locator("#row-A2 details.elements summary").click()
    page.locator("#row-A2 details.elements li").first.wait_for()
    assert page.locator("#row-A2 details.elements li").count() == 7

    page.locator("#site-plan a[href='#row-A10']").first.dispatch_event("click")
    page.wait_for_function("location.hash === '#row-A10'")
    assert page.locator("#row-A10").is_visible()
