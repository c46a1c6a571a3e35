"""What tests of the viewer in a real browser have in common."""

import shutil
from collections.abc import Callable
from typing import Any

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
IN_BROWSER = [
    pytest.mark.slow,
    pytest.mark.extra("browser"),
    pytest.mark.skipif(BROWSER is None, reason="no browser is installed"),
]
"""Marks of tests that need one."""
Open = Callable[..., Any]
HERE = """([id, corner]) => {
    const one = savmapViewer.site.elements.find((other) => other.id === id && (!savmapViewer.only || other.row.name === savmapViewer.only));
    const box = document.getElementById("view").getBoundingClientRect(), [x, y] = savmapViewer.stage.pixelOf(one.row, one.first + corner);
    return [box.left + x, box.top + y];
}"""
"""Where on the page a corner of an element is."""


def until(page: Any, true: str) -> None:
    """Wait for an expression to be true; the page's policy forbids what Playwright has for this."""
    for _ in range(100):
        if page.evaluate(f"Boolean({true})"):
            return
        page.wait_for_timeout(50)
    pytest.fail(f"never true: {true}")


def eventually(page: Any, true: Callable[[], bool], what: str) -> None:
    """Wait for something that is read off the page from outside, such as a drawn pixel."""
    for _ in range(100):
        if true():
            return
        page.wait_for_timeout(50)
    pytest.fail(f"never true: {what}")


def selected(page: Any) -> str:
    return str(page.inner_text("#selection strong"))
