"""The viewer in a real browser, opened from a disk (extra `browser`, and a Chromium or Chrome on the path); skipped where there is none."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_map import EVIL, photo, places, row, site, stills, thing
from opened_page import HERE, IN_BROWSER, Open, selected, until

from savmap.apps.viewer import page as page_module
from savmap.apps.viewer.page import View
from savmap.maps.distance import vertex_distance
from savmap.types import MapWarning, SiteMap, Trajectory, Verdict

pytestmark = IN_BROWSER


def one_row(**options: Any) -> View:
    return View(SiteMap({"A": row(**options)}, {}), title="Hall 1", photos={"A": photo()}, stills={"A": stills()})


def measure(page: Any, first: tuple[str, int], second: tuple[str, int], rows: tuple[str, str] = ("", "")) -> str:
    """Pick two corners, and read the distance."""
    page.keyboard.press("m")
    for corner, name in zip((first, second), rows, strict=True):
        page.evaluate("(name) => { savmapViewer.only = name; }", name)
        page.mouse.click(*page.evaluate(HERE, list(corner)))
    page.wait_for_selector("#distance")
    text: str = page.inner_text("#distance")
    return text.replace("\u00a0", " ")


def said_by_python(site_map: SiteMap, first: str, second: str) -> str:
    """The distance as the viewer should show it."""
    found = vertex_distance(site_map, first, second)
    return f"{found.length_m:.3f} m \u00b1 {1000 * found.sigma_m:.0f} mm"


def test_a_section_tells_its_clear_sizes(opened: Open) -> None:
    page = opened(replace(one_row(), places=places()), "#A/bay 1")
    told = page.inner_text("#selection dl").replace("\u00a0", " ").split("\n")
    assert told == [
        "clear width",
        "2.700 m \u00b1 4 mm",
        "space 0, clear height",
        "2.000 m \u00b1 1 mm",
        "space 1, clear height",
        "1.900 m \u00b1 2 mm",
    ]
    page.click("#selection li button >> nth=0")
    assert selected(page) == "bay 1 / bar 1"
    page.click("#selection dd button")
    assert selected(page) == "bay 1"
    assert page.evaluate("decodeURI(location.hash)") == "#A/bay 1"
    bare = opened(one_row(), "#A/bay 1")
    assert (selected(bare), bare.locator("#selection dl").count()) == ("bay 1", 0)


def test_a_section_of_one_element_tells_its_sizes_too(opened: Open) -> None:
    whole = row()
    alone = replace(whole, structures={"things": whole.structures["things"][:3]})
    page = opened(View(SiteMap({"A": alone}, {}), places=places()), "#A/bay 1")
    assert selected(page) == "bay 1"
    assert "clear width" in page.inner_text("#selection dl")


def test_elements_are_drawn_selected_and_found(opened: Open) -> None:
    page = opened(one_row())
    assert page.title() == "Hall 1"
    assert page.evaluate("savmapViewer.site.elements.length") == 6
    drawn = page.evaluate(
        "savmapViewer.stage.renderer.domElement.toDataURL() !== document.createElement('canvas').toDataURL()"
    )
    assert drawn
    inside = page.evaluate(
        """savmapViewer.site.elements.slice(0, 5).every((one) => [0, 1, 2, 3].every((k) => {
        const [x, y] = savmapViewer.stage.pixelOf(one.row, one.first + k); return x > 0 && y > 0 && x < innerWidth - 310 && y < innerHeight; }))"""
    )
    assert inside
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")

    page.keyboard.press("n")
    colours = page.evaluate(
        """() => { savmapViewer.setMode("label"); savmapViewer.stage.draw(); const v = savmapViewer, gl = v.stage.renderer.getContext(), r = v.stage.renderer.getPixelRatio();
        const one = v.site.elements.find((other) => other.id === "post 1"), found = new Uint8Array(4 * 49);
        const [a, b] = [one.first, one.first + 3].map((k) => v.stage.pixelOf(one.row, k));
        gl.readPixels(r * (a[0] + b[0]) / 2 - 3, gl.drawingBufferHeight - r * (a[1] + b[1]) / 2 - 3, 7, 7, gl.RGBA, gl.UNSIGNED_BYTE, found);
        return Array.from(found); }"""
    )
    darkest = min(zip(*[iter(colours)] * 4, strict=True), key=sum)
    assert darkest[0] < 120  # the ground has 251

    x, y = page.evaluate(HERE, ["bay 1 / bar 1", 2])
    page.mouse.click(x - 40, y)
    assert selected(page) == "bay 1 / bar 1"
    assert page.evaluate("decodeURI(location.hash)") == "#A/bay 1 / bar 1"
    page.keyboard.press("Escape")
    assert page.locator("#selection strong").count() == 0

    before = page.evaluate("savmapViewer.view.camera.position.toArray()")
    page.keyboard.press("/")
    page.keyboard.type("a21")
    assert page.locator("#results button").count() == 1
    page.keyboard.press("Enter")
    assert selected(page) == "A21-03"
    assert page.evaluate("savmapViewer.view.camera.position.toArray()") != before


def test_first_look_shows_what_hangs_beyond_the_row(opened: Open) -> None:
    beyond = tuple(thing(f"hanging {x}", "other", (x, 6), (x + 1, 7)) for x in (-4, 6))
    page = opened(View(SiteMap({"A": replace(row(), structures={**row().structures, "others": beyond})}, {})))
    for kind in ("model", "plan", "face"):
        page.evaluate("(kind) => savmapViewer.setKind(kind)", kind)
        inside = page.evaluate(
            """savmapViewer.site.elements.map((one) => { const [x, y] = savmapViewer.stage.pixelOf(one.row, one.first);
            return x > 0 && y > 0 && x < innerWidth - 310 && y < innerHeight; })"""
        )
        assert inside == [True] * 8, kind


def test_hostile_texts_are_shown_as_text(opened: Open) -> None:
    page = opened(View(site("A", EVIL), title=EVIL))
    assert page.inner_text("#title") == EVIL
    page.select_option("#mode", "label")
    assert EVIL in page.inner_text("#legend")
    page.fill("#search", "onerror")
    page.locator("#results button").first.wait_for()
    assert page.locator("img").count() == 0


def test_deep_links(opened: Open) -> None:
    page = opened(one_row(), "#A21-03")
    assert selected(page) == "A21-03"
    for address, name in (("#a/post%202", "post 2"), ("#A/bay 1", "bay 1"), ("#post 1", "post 1")):
        page.evaluate("(address) => { location.hash = address; }", address)
        until(page, f"document.querySelector('#selection strong')?.textContent === '{name}'")


def test_links_tell_rows_apart_by_case(opened: Open) -> None:
    page = opened(View(SiteMap({"A": row(), "a": row("a")}, {})), "#A/post 2")
    keys = "savmapViewer.selection.elements.map((one) => one.key)"
    assert page.evaluate(keys) == ["A/post 2"]
    page.evaluate("location.hash = '#a/post 2'")
    until(page, f"{keys}[0] === 'a/post 2'")


def test_links_tell_plugins_apart(opened: Open) -> None:
    both = replace(row(), structures={**row().structures, "others": (thing("post 1", "other", (1, 0), (1.1, 5)),)})
    page = opened(View(SiteMap({"A": both}, {})), "#A/others/post 1")
    assert page.evaluate("savmapViewer.selection.elements.map((one) => one.plugin)") == ["others"]
    keys = page.evaluate("savmapViewer.site.elements.map((one) => one.key)")
    assert len(set(keys)) == len(keys)
    assert {"A/things/post 1", "A/post 2"} < set(keys)


@pytest.mark.parametrize("with_joint", [True, False])
def test_distance_is_that_of_python(opened: Open, with_joint: bool) -> None:
    view = one_row(with_joint=with_joint)
    page = opened(view)
    text = measure(page, ("post 1", 1), ("post 2", 3))
    assert text == said_by_python(view.site_map, "post 1 / b", "post 2 / d")
    assert ("from the joint covariance" in page.inner_text("#measured-how")) is with_joint


def test_joint_covariance_is_loaded_from_beside(opened: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_module, "MOST_JOINT", 100)
    view = one_row()
    text = measure(opened(view), ("post 1", 0), ("bay 1 / bar 2", 2))
    assert text == said_by_python(view.site_map, "post 1 / a", "bay 1 / bar 2 / c")


def test_distance_between_rows(opened: Open) -> None:
    view = View(site("A", "B"))
    text = measure(opened(view), ("post 1", 0), ("post 2", 2), ("A", "B"))
    assert text == said_by_python(view.site_map, "A: post 1 / a", "B: post 2 / c")


def test_no_distance_between_rows_without_places(opened: Open) -> None:
    page = opened(View(site("A", "B", placed=False)))
    assert "not known" in page.inner_text("#remark")
    page.keyboard.press("m")
    page.evaluate("""() => { const [a, b] = savmapViewer.site.rows;
        savmapViewer.ruler.add({row: a, vertex: 0}); savmapViewer.ruler.add({row: b, vertex: 1}); }""")
    page.wait_for_selector("text=not known either")
    assert page.locator("#distance").count() == 0


def test_sigma_of_no_distance_is_that_of_python(opened: Open) -> None:
    turned = np.tile([[1e-5, 2e-5, 0], [2e-5, 9e-5, 1e-5], [0, 1e-5, 3e-5]], (4, 1, 1))
    there = replace(thing("post 3", "post", (0, 0), (0.1, 5)), covariances=turned)
    bare = row(with_joint=False)
    view = View(SiteMap({"A": replace(bare, structures={**bare.structures, "others": (there,)})}, {}))
    page = opened(view)
    page.keyboard.press("m")
    for name, said in (
        ("post 3", said_by_python(view.site_map, "post 1 / a", "post 3 / a")),
        ("post 1", "0.000 m ± 0 mm"),
    ):
        page.evaluate(
            """(names) => names.forEach((id) => savmapViewer.ruler.add({row: savmapViewer.row,
            vertex: savmapViewer.site.elements.find((one) => one.id === id).first}))""",
            ["post 1", name],
        )
        until(page, "savmapViewer.ruler.result")
        assert page.inner_text("#distance").replace("\u00a0", " ") == said


def test_tip_goes_when_a_corner_is_picked_and_an_own_vertex_has_no_distance(opened: Open) -> None:
    page = opened(one_row())
    page.keyboard.press("m")
    for corner in (0, 3):
        page.mouse.move(*page.evaluate(HERE, ["post 1", corner]))
        until(page, "!document.getElementById('tip').hidden")
        page.mouse.down()
        page.mouse.up()
        until(page, "document.getElementById('tip').hidden")
    page.mouse.move(*page.evaluate(HERE, ["post 2", 0]))
    page.keyboard.press("Escape")
    until(page, "document.getElementById('tip').hidden")
    page.keyboard.press("m")
    lone = page.evaluate("savmapViewer.site.elements.find((one) => one.id === 'spot 1').first")
    for _ in range(2):
        page.evaluate("(vertex) => savmapViewer.ruler.add({row: savmapViewer.row, vertex})", lone)
    until(page, "savmapViewer.ruler.result")
    assert page.evaluate("[savmapViewer.ruler.result.sigma, ...savmapViewer.ruler.result.sigmas]") == [0, 0, 0, 0]


def test_views_and_orthophoto(opened: Open) -> None:
    page = opened(one_row())
    assert not page.is_checked("#show-photos")
    page.keyboard.press("3")
    until(
        page,
        "savmapViewer.model.rows[0].dates.new.photo?.visible && savmapViewer.model.rows[0].dates.new.photoSize === 1",
    )
    assert page.is_checked("#show-photos")
    across = [page.evaluate(HERE, ["post 1", k]) for k in (0, 3)]
    assert abs(across[0][0] - across[1][0]) < 0.5  # upright in the elevation
    page.keyboard.press("2")
    flat = [page.evaluate(HERE, ["post 1", k]) for k in (0, 3)]
    assert abs(flat[0][1] - flat[1][1]) < 0.5  # a point in the plan
    assert not page.evaluate("savmapViewer.model.rows[0].dates.new.photo.visible")
    for key, shown in (("o", True), ("3", True), ("o", False), ("1", True)):
        page.keyboard.press(key)
        assert page.evaluate("savmapViewer.model.rows[0].dates.new.photo.visible") is shown


def test_panorama_turns_to_what_is_selected(opened: Open) -> None:
    page = opened(one_row(), "#A/post 2")
    page.keyboard.press("4")
    until(page, "savmapViewer.panorama.shows")
    x, y = page.evaluate(
        """() => { const p = savmapViewer.panorama, one = savmapViewer.selection.elements[0], camera = p.camera;
        const at = camera.position.clone().set(...one.centre).project(camera); return [at.x, at.y]; }"""
    )
    assert abs(x) < 1e-6
    assert abs(y) < 1e-6
    assert page.evaluate("savmapViewer.panorama.places[savmapViewer.panorama.place].index") == 18
    area = page.locator("#pano-area").bounding_box()
    page.keyboard.press("Escape")
    edge = page.evaluate(
        """() => { const p = savmapViewer.panorama, one = savmapViewer.site.elements.find((other) => other.id === "post 2");
        const at = p.camera.position.clone().set(2.8, 2.2, 0).project(p.camera); return [at.x, at.y]; }"""
    )
    page.mouse.click(area["x"] + area["width"] * (edge[0] + 1) / 2, area["y"] + area["height"] * (1 - edge[1]) / 2)
    assert selected(page) == "post 2"


def test_panorama_of_another_row_goes(opened: Open) -> None:
    nowhere = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    site_map = SiteMap({"A": row(), "B": replace(row("B"), trajectory=nowhere)}, {})
    page = opened(View(site_map, stills={"A": stills()}), "#A/post 2")
    page.keyboard.press("4")
    until(page, "savmapViewer.panorama.shows")
    page.keyboard.press("]")
    assert page.evaluate("[savmapViewer.panorama.shows, savmapViewer.panorama.sphere.visible]") == [False, False]
    assert page.inner_text("#pano-what") == ""
    page.keyboard.press("ArrowRight")  # turns to an element: from nowhere
    page.keyboard.press("[")
    until(page, "savmapViewer.panorama.shows")


def test_click_on_the_path_shows_the_panorama_from_there(opened: Open) -> None:
    page = opened(one_row())
    page.keyboard.press("2")
    x, y = page.evaluate(
        """() => { const v = savmapViewer, at = v.view.camera.position.clone(), box = document.getElementById("view").getBoundingClientRect();
        v.view.camera.updateMatrixWorld();
        at.set(...v.row.path.positions.slice(3 * 7, 3 * 8)).project(v.view.camera);
        return [box.left + box.width * (at.x + 1) / 2, box.top + box.height * (1 - at.y) / 2]; }"""
    )
    page.mouse.click(x, y)
    until(page, "savmapViewer.panorama.shows")
    assert page.evaluate("savmapViewer.panorama.places[savmapViewer.panorama.place].index") == 6
    page.keyboard.press(".")
    assert page.evaluate("savmapViewer.panorama.places[savmapViewer.panorama.place].index") == 12
    # it lies under the wireframe: its middle column looks out of the face, behind the camera, and up is up
    ahead = page.evaluate(
        """() => { const { sphere } = savmapViewer.panorama, v = savmapViewer.panorama.camera.position.clone();
        sphere.updateMatrixWorld(); return [[0, 0, 1], [0, -1, 0]].map((ray) => v.set(...ray).transformDirection(sphere.matrixWorld).toArray()); }"""
    )
    assert [round(value, 6) for value in ahead[0]] == [0, 0, 1]
    assert [round(value, 6) for value in ahead[1]] == [0, 1, 0]


def test_warnings_lead_to_what_they_name(opened: Open) -> None:
    page = opened(one_row())
    assert page.input_value("#mode") == "verdict"
    assert "nothing checks the length" not in page.inner_text("#warnings")
    page.click("#warnings summary")
    assert "nothing checks the length" in page.inner_text("#warnings")
    page.locator("#warnings button").click()
    assert selected(page) == "bay 1 / bar 2"


def test_keys_and_help(opened: Open) -> None:
    page = opened(one_row())
    for key in "ssuuknnccf":
        page.keyboard.press(key)
    page.keyboard.press("?")
    assert page.locator("#help").is_visible()
    page.keyboard.press("Escape")
    page.keyboard.press("ArrowRight")
    assert selected(page) == "post 1"


def test_warnings_are_those_of_row_and_plugin(opened: Open) -> None:
    """Ids repeat between rows, and between plugins: a warning is about what lies at its place."""
    warning = MapWarning("uncertain-element", ("post 1",), "", (1.05, 2.5, 0.0))
    namesake = thing("post 1", "other", (1, 0), (1.1, 5))
    warned = replace(row(), structures={**row().structures, "others": (namesake,)}, verdict=Verdict((warning,)))
    clear = replace(warned, name="B", verdict=Verdict())
    page = opened(View(SiteMap({"A": warned, "B": clear}, {})))
    named = "savmapViewer.site.rows.map((row) => row.elements.filter((one) => row.warnedElements.has(one)).map((one) => one.key))"
    assert page.evaluate(named) == [["A/others/post 1"], []]
    page.locator("#warnings button").click()
    assert page.evaluate("savmapViewer.selection.elements.map((one) => one.key)") == ["A/others/post 1"]


def test_notes_are_saved_and_loaded(opened: Open, tmp_path: Path) -> None:
    page = opened(one_row(), "#A21-03")
    page.fill("#note", f"bent {EVIL}")
    page.click("#add-note")
    with page.expect_download() as download:
        page.click("#save-notes")
    download.value.save_as(tmp_path / "notes.json")
    (note,) = json.loads((tmp_path / "notes.json").read_text())["notes"]
    assert (note["place"], note["note"]) == ("A21-03", f"bent {EVIL}")
    other = opened(one_row())
    other.set_input_files("#load-notes", tmp_path / "notes.json")
    other.locator("#notes button").first.click()
    assert selected(other) == "A21-03"
    (tmp_path / "notes.json").write_text("[]")
    other.set_input_files("#load-notes", tmp_path / "notes.json")
    other.wait_for_selector("text=no file of notes")


def test_names_do_not_overlap(opened: Open) -> None:
    page = opened(View(site("A", "B", "C")), width=700)
    boxes = page.evaluate(
        "[...document.querySelectorAll('.name')].map((one) => one.getBoundingClientRect()).map((b) => [b.left, b.top, b.right, b.bottom])"
    )
    assert len(boxes) >= 3
    for k, (left, top, right, bottom) in enumerate(boxes):
        for x, y, x1, y1 in boxes[k + 1 :]:
            assert not (left < x1 - 1 and x < right - 1 and top < y1 - 1 and y < bottom - 1)


def test_rows_without_structures_or_path_open(opened: Open) -> None:
    nowhere = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    bare = replace(row(), structures={}, trajectory=nowhere, joint=None, verdict=None)
    page = opened(View(SiteMap({"A": bare, "B": row("B")}, {})))
    for key in "1234]sokm[":
        page.keyboard.press(key)
    assert "nothing to show" in opened(View(SiteMap({}, {})), ready=False).inner_text("#failure")


def test_fits_a_phone(opened: Open) -> None:
    page = opened(one_row(), width=390)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.keyboard.press("4")
    assert page.locator("#pano-area").is_visible()
