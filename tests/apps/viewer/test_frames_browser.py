"""Places in the row's frame, the site's, the user's world and on the Earth, in a real browser; skipped where there is none."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_up_map import row, site
from opened_page import IN_BROWSER, Open, until

from savmap.apps.viewer.page import View
from savmap.maps.exports.frames import elements
from savmap.maps.exports.plans.geojson import Earth
from savmap.types import Alignment, SiteMap

pytestmark = IN_BROWSER
ALIGNMENT = Alignment(120.5, -40.25, 33.0, np.diag([4e-4, 9e-4, 0.01]), 7.5, anchor=(48.1371, 11.5754))
ALIGNED = replace(site("A", "B"), alignment=ALIGNMENT)
VALUES = """(frame) => { const v = savmapViewer; v.frame.tellIn(frame); v.selection.show();
    return [...document.querySelectorAll("#selection dd")].slice(0, 2).map((cell) => cell.textContent); }"""

NAMED = "{}[...document.querySelectorAll('#compass text')].some((one) => one.textContent === 'z')"
"""Whether the compass names z; with a "!", whether it does not, as where z points at the viewer."""


def told(page: Any, frame: str) -> tuple[list[float], float]:
    """The centre of what is selected, and its largest standard deviation in mm."""
    place, sigma = page.evaluate(VALUES, frame)
    numbers = re.findall(r"-?\d+\.\d+", place)
    return [float(one) for one in numbers], float(sigma.split("\u00a0")[0])


def axes(page: Any) -> dict[str, list[float]]:
    """Where the names of the axes stand around the middle of the compass; y goes down."""
    found: dict[str, list[float]] = page.evaluate(
        """Object.fromEntries([...document.querySelectorAll("#compass text")].map((one) => [one.textContent, [Number(one.getAttribute("x")), Number(one.getAttribute("y"))]]))"""
    )
    return found


def test_places_in_every_frame_and_the_world_of_exports(opened: Open) -> None:
    page = opened(View(ALIGNED), "#B/post 2")
    there = next(one.structure for one in elements(ALIGNED) if (one.row, one.structure.id) == ("B", "post 2"))
    place, sigma = told(page, "world")
    assert place == pytest.approx(there.vertices.mean(axis=0).tolist(), abs=6e-4)
    most = 1000 * float(np.sqrt(there.covariances[:, range(3), range(3)].max()))
    assert sigma == pytest.approx(most, abs=0.6)
    assert page.input_value("#frame") == "world"
    vertices = next(one for one in row("B").structures["things"] if one.id == "post 2").vertices
    centre = vertices.mean(axis=0)
    assert told(page, "row")[0] == pytest.approx(centre.tolist(), abs=6e-4)
    on_site = ALIGNED.placements["B"].points(centre[None])[0]
    assert told(page, "site")[0] == pytest.approx(on_site.tolist(), abs=6e-4)
    world = told(page, "world")[0]
    ((longitude, latitude),) = Earth(ALIGNED).positions(np.array([world[:2]]))
    assert told(page, "earth")[0] == pytest.approx([latitude, longitude, world[2]], abs=2e-8)


def test_picked_corners_are_told_in_the_frame(opened: Open) -> None:
    page = opened(View(ALIGNED), "#A/post 1")
    page.select_option("#frame", "world")
    page.keyboard.press("m")
    page.evaluate("savmapViewer.ruler.add({row: savmapViewer.row, vertex: 0})")
    until(page, "document.querySelector('#measured .point span')")
    there = next(one.structure for one in elements(ALIGNED) if one.row == "A").vertices[0]
    told_place = page.inner_text("#measured .point span").replace("\u00a0", " ")
    assert told_place == ", ".join(f"{axis} {one:.3f}" for axis, one in zip("xyz", there, strict=True)) + " m"


def test_plan_shows_north_and_axes(opened: Open) -> None:
    page = opened(View(ALIGNED))
    page.keyboard.press("2")
    until(page, NAMED.format("!"))
    north, x = (np.array(axes(page)[name]) for name in ("y, N", "x"))
    # row A lies along the site's x, which points 33 degrees to the left of the world's x: that is 33 degrees to the right in the plan
    assert np.degrees(np.arctan2(x[1], x[0])) == pytest.approx(33, abs=0.1)
    assert np.degrees(np.arctan2(north[1], north[0])) == pytest.approx(33 - 90, abs=0.1)
    assert "z" not in axes(page)  # it points at the viewer
    page.select_option("#frame", "row")
    until(page, NAMED.format(""))
    assert axes(page)["x"][1] == pytest.approx(0, abs=1e-6)
    assert axes(page)["N"][0] > 0
    assert axes(page)["z"][1] > 0  # out of the face


def test_frames_are_those_that_are_known(opened: Open) -> None:
    options = "[...document.querySelectorAll('#frame option')].map((one) => one.value)"
    assert opened(View(SiteMap({"A": row()}, {}))).evaluate(options) == ["row"]
    alone = SiteMap({"A": row()}, {}, alignment=replace(ALIGNMENT, anchor=None))
    assert opened(View(alone)).evaluate(options) == ["row", "world"]
    half = replace(ALIGNED, placements={"A": ALIGNED.placements["A"]})
    page = opened(View(half), "#B/post 2")
    assert page.evaluate(options) == ["row", "site", "world", "earth"]
    assert "the row's frame" in page.inner_text("#selection")
