"""What the viewer shows at first, on paper and in the dark, in a real browser; skipped where there is none."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_up_map import photo, places, row, site, stills, thing
from opened_page import HERE, IN_BROWSER, Open, selected, until

from savmap.apps.viewer.page import View
from savmap.types import JointCovariance, MapWarning, SiteMap, Verdict

pytestmark = IN_BROWSER
WRONG = MapWarning("reference-conflict", ("length",))
COLOURS = """(mode) => { savmapViewer.setMode(mode);
    return Object.fromEntries(savmapViewer.site.elements.map((one) => [one.key, savmapViewer.model.colourOf(one)])); }"""
CONTRAST = """(theme) => {
    document.documentElement.dataset.theme = theme;
    const style = getComputedStyle(document.documentElement), brush = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
    const light = (name) => {
        brush.fillStyle = style.getPropertyValue(name); brush.fillRect(0, 0, 1, 1);
        const [r, g, b] = [...brush.getImageData(0, 0, 1, 1).data].slice(0, 3).map((one) => one / 255)
            .map((one) => one <= 0.04045 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4);
        return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
    return [["--ink", "--panel"], ["--ink", "--field"], ["--ink", "--ground"], ["--ink", "--warn-ground"], ["--ink", "--written"],
        ["--soft", "--panel"], ["--accent", "--panel"], ["--on-accent", "--accent"], ["--warn", "--panel"], ["--on-warn", "--warn"], ["--on-tip", "--tip"]]
        .map(([a, b]) => { const [p, q] = [light(a), light(b)].sort((x, y) => y - x); return [a, b, (p + 0.05) / (q + 0.05)]; }); }"""


def judged(*wrong: str) -> SiteMap:
    """Rows A, B and C of which some have a warning that is about the whole row."""
    whole = site("A", "B", "C")
    verdicts = {name: Verdict((WRONG,) if name in wrong else ()) for name in whole.rows}
    return replace(whole, rows={name: replace(one, verdict=verdicts[name]) for name, one in whole.rows.items()})


def pictured(**options: Any) -> View:
    return View(SiteMap({"A": row(**options)}, {}), title="Hall 1", photos={"A": photo()}, stills={"A": stills()})


def test_banner_leads_to_the_row_that_must_be_checked(opened: Open) -> None:
    page = opened(View(judged("C")), first=True)
    assert page.inner_text("#banner") == "1 of 3 rows must be checked: C"
    assert page.evaluate("savmapViewer.row.name") == "C"
    page.select_option("#row", "0")
    assert page.inner_text("#h-warnings") == "Warnings of row A"
    assert "Nothing speaks against this row" in page.inner_text("#warnings")
    page.click("#banner")
    assert page.evaluate("savmapViewer.row.name") == "C"
    assert page.evaluate("document.activeElement.closest('#warnings') !== null")
    top = "document.getElementById('{0}').getBoundingClientRect().top"
    assert page.evaluate("document.body.scrollTop") == 0
    assert page.evaluate(f"{top.format('warned')} - {top.format('side')}") > -1
    assert page.inner_text("#warnings strong") == "a reference contradicts the rest"


def test_no_banner_where_nothing_must_be_checked(opened: Open) -> None:
    page = opened(View(judged()), first=True)
    assert page.locator("#banner").is_hidden()
    assert page.evaluate("savmapViewer.row.name") == "A"


def test_warning_of_a_row_paints_and_tells_every_element(opened: Open) -> None:
    page = opened(View(judged("C")), "#C/post 2")
    colours = page.evaluate(COLOURS, "verdict")
    assert len({colour for key, colour in colours.items() if key.startswith("C/")}) == 1
    assert colours["C/post 1"] not in {colours["A/post 1"], colours["B/post 1"]}
    assert "a reference contradicts the rest" in page.inner_text("#selection .warnings")
    assert page.locator("#selection .tag").all_inner_texts() == ["reference-conflict", "row"]
    page.evaluate("savmapViewer.selection.openAddress('A/post 2')")
    assert page.locator("#selection .warnings").count() == 0


def test_warning_of_an_element_stands_out_from_the_rows(opened: Open) -> None:
    own = MapWarning("uncertain-element", ("post 1",))
    page = opened(View(SiteMap({"A": replace(row(), verdict=Verdict((WRONG, own)))}, {})), "#A/post 1")
    colours = page.evaluate(COLOURS, "verdict")
    assert len({colours["A/post 1"], colours["A/post 2"]}) == 2
    assert page.locator("#selection .warnings li").count() == 2
    assert page.locator('#selection .tag:text-is("row")').count() == 1


def test_warning_folds_its_details(opened: Open) -> None:
    page = opened(View(judged("C")))
    page.evaluate("""() => { Object.assign(savmapViewer.row.warnings[0], {figure: "0.50 m", action: "Measure it again", details: ["167 sigma"]});
        savmapViewer.setRow(savmapViewer.row); }""")
    said = page.inner_text("#warnings")
    assert "0.50 m" in said
    assert "Measure it again" in said
    assert "167 sigma" not in said
    page.click("#warnings summary")
    assert "167 sigma" in page.inner_text("#warnings")


def test_prints_one_page(opened: Open) -> None:
    warnings = tuple(MapWarning("uncertain-element", ("post 1",)) for k in range(30))
    many = replace(row(), verdict=Verdict(warnings, ("nothing checks the length",)))
    view = View(SiteMap({"A": many}, {}), title="Hall 1", photos={"A": photo()}, stills={"A": stills()})
    page = opened(view, "#A/bay 1", width=800, first=True)
    for size, landscape in (("A4", False), ("A4", True), ("Letter", False), ("Letter", True)):
        paper = page.pdf(format=size, landscape=landscape, print_background=True)
        assert len(re.findall(rb"/Type\s*/Page\b", paper)) == 1, (size, landscape)
        assert page.evaluate("document.documentElement.dataset.theme") == "light"


def test_paper_has_title_date_banner_labels_legend_and_scale(opened: Open) -> None:
    page = opened(View(judged("C"), title="Hall 1", photos={"C": photo()}), first=True, scheme="dark")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print", color_scheme="dark")
    assert [page.locator(name).is_visible() for name in ("#title", "#sheet", "#banner", "#printed", "#legend")] == [
        True
    ] * 5
    assert [page.locator(name).is_hidden() for name in ("#search", "#view", "#canvas", "#listed", "#noted")] == [
        True
    ] * 5
    assert re.search(r"Face, row C . coloured by verdict . printed \d+ \w+ \d{4}", page.inner_text("#sheet"))
    drawn = "document.getElementById('printed').toDataURL()"
    whole = page.evaluate(drawn)
    for hidden in ("#names", "#scale"):
        page.emulate_media(media="screen")
        page.evaluate("(name) => { document.querySelector(name).hidden = name === '#scale'; }", hidden)
        page.evaluate("(name) => name === '#names' && savmapViewer.side.toggle('labels')", hidden)
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
        assert page.evaluate(drawn) != whole  # they are in the picture
    corner = """(() => { const brush = document.createElement("canvas").getContext("2d");
        brush.drawImage(document.getElementById("printed"), 0, 0);
        return [...brush.getImageData(2, 2, 1, 1).data].slice(0, 3); })()"""
    assert min(page.evaluate(corner)) > 240  # paper is light
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"


def test_first_look_is_the_face_beside_the_panorama(opened: Open) -> None:
    page = opened(pictured(), first=True)
    until(page, "savmapViewer.panorama.shows && savmapViewer.model.rows[0].dates.new.photo?.visible")
    assert page.evaluate("savmapViewer.view.kind") == "face"
    assert page.locator("#pano-area").is_visible()
    bare = opened(View(SiteMap({"A": row()}, {}), stills={}), first=True)
    assert bare.evaluate("savmapViewer.view.kind") == "model"
    assert bare.locator("#pano-area").is_hidden()


def test_scale_bar_is_as_long_as_it_says_and_texts_are_readable(opened: Open) -> None:
    page = opened(pictured())
    assert page.locator("#scale").is_hidden()
    for kind in ("face", "plan"):
        page.evaluate("(kind) => { savmapViewer.setKind(kind); savmapViewer.stage.draw(); }", kind)
        said, unit = page.inner_text("#scale").split("\u00a0")
        across = [page.evaluate(HERE, [name, 0])[0] for name in ("post 1", "post 2")]
        metres = float(said) / {"m": 1, "cm": 100}[unit]
        long = page.locator("#scale i").bounding_box()["width"]
        assert long / metres == pytest.approx((across[1] - across[0]) / 2.8, rel=0.02)
    for theme in ("light", "dark"):
        assert [pair for pair in page.evaluate(CONTRAST, theme) if pair[2] < 4.5] == []


def test_bays_and_levels_are_found(opened: Open) -> None:
    page = opened(replace(pictured(), places=places()), "#A/bay 1 / bar 2")  # a link to a bay of an older map
    assert selected(page) == "bay 1 / bar 2"
    assert page.locator("#notice").is_hidden()
    for asked, name in (
        ("bay 1", "bay 1"),
        ("section 1", "bay 1"),
        ("bay 1 space 0", "bay 1 / space 0"),
        ("space 1", "bay 1 / space 1"),
    ):
        page.fill("#search", asked)
        page.keyboard.press("Enter")
        assert selected(page) == name
        assert "clear width" in page.inner_text("#selection dl")
        assert page.evaluate("decodeURI(location.hash)") == f"#A/{name}"


def test_link_that_leads_nowhere_says_so(opened: Open) -> None:
    page = opened(pictured(), "#A/bay 99")
    for address in ("#%E0%A4%A", ""):
        until(page, "!document.getElementById('notice').hidden")
        assert "The link leads nowhere" in page.inner_text("#notice")
        page.evaluate("savmapViewer.selection.openAddress('A/post 1')")
        assert page.locator("#notice").is_hidden()
        if address:
            page.evaluate("(address) => { location.hash = address; }", address)


def test_dark_as_the_system_is_and_as_the_button_says(opened: Open) -> None:
    page = opened(pictured(), scheme="dark")
    ground = "getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)"
    drawn = """(() => { savmapViewer.stage.draw(); const gl = savmapViewer.stage.renderer.getContext(), pixel = new Uint8Array(4);
        gl.readPixels(2, 2, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); return [...pixel].slice(0, 3); })()"""
    assert max(page.evaluate(ground)) < 60
    assert max(page.evaluate(drawn)) < 60
    page.click("#theme")
    assert min(page.evaluate(ground)) > 240
    assert min(page.evaluate(drawn)) > 240


def test_tree_is_walked_by_keys(opened: Open) -> None:
    page = opened(pictured())
    page.locator("#tree > li").focus()
    for key in ("ArrowDown", "ArrowRight", "ArrowDown", "ArrowDown", "Enter"):
        page.keyboard.press(key)
    assert selected(page) == "A21-03"  # the plate in the first bay
    assert page.locator("#tree [aria-selected=true]").inner_text() == "plate: A21-03"
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    assert page.locator("#tree li li[aria-expanded=true]").count() == 0
    assert "post (2)" in page.inner_text("#tree")
    page.click("#listed summary")
    assert page.locator("#tree").is_hidden()


def test_copies_the_link_and_the_coordinates(opened: Open) -> None:
    page = opened(pictured(), "#A/bay 1 / bar 1")
    page.evaluate("""() => { window.held = []; Object.defineProperty(navigator, "clipboard",
        {value: {writeText: async (said) => { window.held.push(said); }}}); }""")
    page.get_by_role("button", name="Copy link").click()
    page.get_by_role("button", name="Copy coordinates").click()
    until(page, "window.held.length === 2")
    link, place = page.evaluate("window.held")
    assert link.endswith("view.html#A/bay%201%20/%20bar%201")
    assert place.replace("\u00a0", " ") == "A/bay 1 / bar 1: x 1.450, y 2.050, z 0.000 m (the row's frame A)"
    page.wait_for_selector("button:text('Copied')")


def test_panel_tells_plain_quantities_and_axes(opened: Open) -> None:
    page = opened(pictured())
    for name, said in (
        ("bay 1 / bar 1", "profile 100 mm, lower edge 2.000 m above the floor"),
        ("post 2", "profile 100 mm, left edge 2.800 m along the row"),
        ("bay 1 / plate", "0.200 m \u00d7 0.060 m, lower edge 2.020 m above the floor"),
        ("spot 1", "4.500 m above the floor"),
    ):
        page.evaluate("(name) => savmapViewer.selection.openAddress(`A/${name}`)", name)
        assert page.inner_text("#selection .plain").replace("\u00a0", " ") == said
        assert page.inner_text("#axes") == "x along the row, y up, z out of the face"


def test_assumed_ends_are_dashed_and_left_out_of_scales(opened: Open) -> None:
    post = thing("post 9", "post", (4.0, 0), (4.1, 5))
    covariances = post.covariances.copy()
    covariances[2:, 1, 1] = 0.6**2
    joint = JointCovariance({"things": {"post 9": np.array([[0, -1, 1]] * 4)}}, 1e-6 * np.eye(2))
    own = {"things": (thing("post 1", "post", (0, 0), (0.1, 5)), replace(post, covariances=covariances))}
    page = opened(View(SiteMap({"A": replace(row(with_joint=False), structures=own, joint=joint)}, {})), "#A/post 9")
    sigmas = page.evaluate("Object.fromEntries(savmapViewer.site.elements.map((one) => [one.id, one.sigma]))")
    assert max(sigmas.values()) < 0.01
    segments = "savmapViewer.model.rows[0].dates.new.owners.filter((one) => one.id === '{}').length"
    assert page.evaluate(segments.format("post 1")) == 4
    assert page.evaluate(segments.format("post 9")) > 10
    assert "y \u00b1 600" in page.inner_text("#selection dl")
    assert page.inner_text("#selection dl").count("assumed, not measured") == 1
    assert "assumed, not measured" in page.inner_text("#legend")
    page.keyboard.press("u")
    tall = """(() => { const made = savmapViewer.model.rows[0].dates.new.ellipsoids, m = made.instanceMatrix.array;
        return Math.max(...Array.from({length: made.count}, (_, k) => Math.hypot(m[16 * k + 1], m[16 * k + 5], m[16 * k + 9]))); })()"""
    assert page.evaluate(tall) < 0.2
