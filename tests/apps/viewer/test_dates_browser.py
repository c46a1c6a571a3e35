"""Two dates over one another in a real browser; skipped where there is none."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from made_up_dates import dated_site, grey_photo
from made_up_map import EVIL, stills, thing
from opened_page import HERE, IN_BROWSER, Open, eventually, selected, until

from savmap.apps.dates.comparison.compare import compare_maps
from savmap.apps.viewer.data import Before
from savmap.apps.viewer.page import View, write_view
from savmap.types import SiteMap

pytestmark = IN_BROWSER
OLD = dated_site(1, without=("bay 4 / beam 2",))
NEW = dated_site(2, lifted_m=0.03, without=("bay 2 / beam 3",))
SHOWN = "savmapViewer.row.shown.map((one) => [one.date, one.state, one.id])"


def both(old: SiteMap = OLD, new: SiteMap = NEW, photos: bool = True) -> View:
    before = Before(old, compare_maps(old, new), {"A": grey_photo(40)} if photos else {})
    return View(new, title="Hall 1", photos={"A": grey_photo(210)}, before=before)


def grey_at(page: Any, share: float) -> int:
    """The grey of the row's foot at a share of the view's width."""
    y = page.evaluate(HERE, ["bay 3 / beam 1", 0])[1]
    box = page.locator("#view").bounding_box()
    clip = {"x": box["x"] + share * box["width"], "y": y + 12, "width": 4, "height": 2}
    image = cv2.imdecode(np.frombuffer(page.screenshot(clip=clip), np.uint8), cv2.IMREAD_GRAYSCALE)
    return int(np.median(image))


def test_changes_are_coloured_and_listed_with_amount_and_sigma(opened: Open) -> None:
    page = opened(both())
    assert page.input_value("#mode") == "change"
    assert [line.strip() for line in page.locator("#legend li").all_inner_texts()] == [
        "same (22)",
        "missing (1)",
        "new (1)",
        "moved (1)",
        "the old date, underneath",
    ]
    lines = [line.replace("\u00a0", " ") for line in page.locator("#changes li").all_inner_texts()]
    assert [line.split(",")[0] for line in lines[:3]] == [
        "bay 2 / beam 3: missing",
        "bay 4 / beam 2: new",
        "bay 3 / beam 3: moved",
    ]
    element = next(one for one in compare_maps(OLD, NEW).rows[0].elements if one.state == "moved")
    (found,) = element.significant
    assert f"up +{1000 * found.difference_m:.1f} mm ± {1000 * found.sigma_m:.0f}" in re.sub(r"\.\d mm$", "", lines[2])
    page.locator("#changes button", has_text="moved").first.click()
    assert selected(page) == "bay 3 / beam 3"
    assert page.inner_text("#state") == "Since the old date: moved"
    assert f"{found.sigmas:.0f}\u00a0\u03c3" in page.inner_text("#selection dl >> nth=0")
    assert page.evaluate("savmapViewer.selection.elements.map((one) => one.date)") == ["new", "old"]


def test_switch_distance_and_search_know_both_dates(opened: Open) -> None:
    page = opened(both(), "#A/post 9")
    drawn = "Object.values(savmapViewer.model.rows[0].dates).map((date) => date.group.visible)"
    counts = {}
    for which in ("both", "new", "old"):
        page.locator(f"[data-dates={which}]").click()
        counts[which] = (len(page.evaluate(SHOWN)), page.evaluate(drawn))
    assert counts == {"both": (26, [True, True]), "new": (24, [True, False]), "old": (24, [False, True])}
    page.keyboard.press("d")
    assert page.get_attribute("[data-dates=both]", "aria-pressed") == "true"
    page.keyboard.press("n")  # names go, and nothing breaks
    page.keyboard.press("m")
    page.evaluate("""() => { const [a, b] = ["new", "old"].map((date) => savmapViewer.site.elements.find((one) => one.id === "bay 3 / beam 3" && one.date === date));
        for (const one of [a, b]) savmapViewer.ruler.add({row: one.row, vertex: one.first}); }""")
    until(page, "savmapViewer.ruler.result")
    assert "two dates" in page.inner_text("#measured-how")
    assert 0.02 < page.evaluate("savmapViewer.ruler.result.distance") < 0.04
    page.keyboard.press("m")
    page.locator("[data-dates=new]").click()
    page.fill("#search", "bay 2 / beam 3")
    page.keyboard.press("Enter")
    assert selected(page) == "bay 2 / beam 3"
    assert "old date" in page.inner_text("#selection")
    assert page.evaluate("savmapViewer.site.showing") == "both"  # it is not on the new one
    assert page.evaluate("decodeURI(location.hash)") == "#A/old date/bay 2 / beam 3"


def test_address_names_an_element_of_the_old_date(opened: Open) -> None:
    page = opened(both(), "#A/old date/bay 1 / beam 1")
    assert page.evaluate("savmapViewer.selection.elements.map((one) => [one.date, one.id])") == [
        ["old", "bay 1 / beam 1"]
    ]
    assert page.evaluate("savmapViewer.site.showing") == "old"
    page.fill("#search", "bay 1 / beam 1")
    found = page.locator("#results b").all_inner_texts()
    assert found.count("bay 1 / beam 1") == 1


def test_orthophotos_lie_beside_a_divider_in_the_face_view(opened: Open) -> None:
    page = opened(both())
    assert page.locator("#swipe").is_hidden()
    page.keyboard.press("3")
    page.keyboard.press("n")
    until(page, "Object.values(savmapViewer.model.rows[0].dates).every((date) => date.photo)")
    eventually(
        page, lambda: grey_at(page, 0.3) < 80 and grey_at(page, 0.7) > 160, "a photo on either side of the divider"
    )
    divider = page.locator("#swipe").bounding_box()
    page.mouse.move(divider["x"] + 10, 400)
    page.mouse.down()
    page.mouse.move(divider["x"] + 400, 400, steps=3)
    page.mouse.up()
    eventually(page, lambda: grey_at(page, 0.7) < 80, "the old photo where the divider was dragged away")
    assert page.locator("#selection strong").count() == 0  # a drag is no click
    x, y = page.evaluate(HERE, ["bay 4 / beam 2", 0])
    page.mouse.click(x + 60, y)  # where the old date, which has no such beam, is shown
    assert page.evaluate("savmapViewer.selection.elements.filter((one) => one.id === 'bay 4 / beam 2').length") == 0
    page.locator("#swipe").focus()
    for _ in range(20):
        page.keyboard.press("ArrowLeft")
    assert page.get_attribute("#swipe", "aria-valuenow") == "0"
    page.mouse.click(x + 60, y)
    assert selected(page) == "bay 4 / beam 2"


def test_no_divider_without_the_old_orthophoto(opened: Open) -> None:
    page = opened(both(photos=False))
    page.keyboard.press("3")
    assert page.locator("#swipe").is_hidden()
    page.locator("[data-dates=old]").click()
    assert page.evaluate("savmapViewer.model.rows[0].dates.new.group.visible") is False


def test_other_rows_and_missing_ones_are_named(opened: Open) -> None:
    old = SiteMap({**OLD.rows, "B": replace(OLD.rows["A"], name="B"), "C": replace(OLD.rows["A"], name="C")}, {})
    new = SiteMap({**NEW.rows, "B": replace(NEW.rows["A"], name="B")}, {})
    page = opened(both(old, new))
    said = page.inner_text("#changes")
    assert "Row C is missing" in said
    page.locator("#changes button", has_text="row B").click()
    assert page.evaluate("savmapViewer.row.name") == "B"


def test_hostile_texts_of_the_old_date_are_shown_as_text(opened: Open) -> None:
    gone = thing(EVIL, EVIL, (1.0, 4.3), (2.0, 4.4), text=EVIL)
    old = SiteMap({"A": replace(OLD.rows["A"], structures={**OLD.rows["A"].structures, "others": (gone,)})}, {})
    page = opened(
        both(old, SiteMap({"A": replace(NEW.rows["A"], structures={**NEW.rows["A"].structures, "others": ()})}, {}))
    )
    page.locator("#changes button", has_text="onerror").click()
    assert selected(page) == EVIL
    assert page.locator("img").count() == 0


def test_two_dates_fit_a_phone(opened: Open) -> None:
    page = opened(both(), width=390)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_one_date_shows_nothing_of_two(opened: Open) -> None:
    page = opened(View(NEW))
    assert page.locator("#dates").is_hidden()
    assert page.locator("#changed").is_hidden()
    page.keyboard.press("d")
    assert page.locator("#mode option[value=change]").count() == 0


def test_row_of_the_old_date_alone_is_drawn_found_and_told(opened: Open) -> None:
    old = SiteMap({**OLD.rows, "B": replace(OLD.rows["A"], name="B")}, {})
    new = SiteMap({**NEW.rows, "C": replace(NEW.rows["A"], name="C")}, {})
    page = opened(both(old, new))
    assert page.locator("#row option").all_inner_texts() == ["row A", "row C (new)", "row B (missing)"]
    drawn = "savmapViewer.model.rows[2].dates.old.group.visible"
    page.locator("[data-dates=new]").click()
    assert page.evaluate(drawn) is False
    eventually(page, lambda: "B" not in page.locator(".of-row").all_inner_texts(), "the name of row B is gone")
    page.locator("#changes button", has_text="Row B is missing").click()
    assert page.evaluate("savmapViewer.row.name") == "B"
    assert page.evaluate(drawn) is True
    assert "Only the old map has this row" in page.inner_text("#changes")
    page.keyboard.press("2")
    page.fill("#search", "upright 3 B")
    page.keyboard.press("Enter")
    assert selected(page) == "upright 3"
    assert page.inner_text("#state") == "Since the old date: missing"
    page.fill("#search", "B")
    page.keyboard.press("Enter")
    assert "24 elements" in page.inner_text("#selection")
    page.locator("#changes button", has_text="Row C is new").click()
    assert page.evaluate("savmapViewer.row.elements.every((one) => one.state === 'new')")


def test_panorama_of_the_old_date_under_its_wireframe(opened: Open, tmp_path: Path) -> None:
    write_view(View(OLD, stills={"A": stills()}), tmp_path / "spring" / "view.html")
    before = Before(OLD, compare_maps(OLD, NEW), folder=tmp_path / "spring")
    page = opened(View(NEW, before=before, stills={"A": stills()[1:3]}))
    page.keyboard.press("p")
    until(page, "savmapViewer.panorama.shows")
    assert page.evaluate("savmapViewer.panorama.path").startswith("pano/A-")
    yaw = page.evaluate("savmapViewer.panorama.yaw")
    page.locator("[data-dates=old]").click()
    until(page, "savmapViewer.panorama.shows")
    assert page.evaluate("savmapViewer.panorama.path").startswith("pano/old/A-")
    assert page.evaluate("savmapViewer.panorama.yaw") == yaw
    assert "old date" in page.inner_text("#pano-what")
    assert page.evaluate("Object.values(savmapViewer.model.rows[0].dates).map((date) => date.group.visible)") == [
        False,
        True,
    ]
    page.locator("[data-dates=new]").click()
    assert page.evaluate("savmapViewer.panorama.path").startswith("pano/A-")
    assert "old date" not in page.inner_text("#pano-what")
