"""The site report is one sound page that needs nothing else, shows every row, and says what the map says."""

import base64
import hashlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_page import EVIL, ODD, assumed_top, drawings, evaluation, report, row
from parsed_page import Element, parsed

from savmap.errors import OutputError, visible
from savmap.report.numbers import NOTHING
from savmap.report.page import Report, page_text, write_page
from savmap.types import MapWarning, Placement, ReferenceUse, SiteMap, Verdict


@pytest.fixture(scope="module")
def text() -> str:
    return page_text(report())


@pytest.fixture(scope="module")
def page(text: str) -> Element:
    return parsed(text)


def lines(page: Element, table: str) -> list[list[str]]:
    """The cells of a table's body."""
    return [
        [cell.text for cell in line.inside if isinstance(cell, Element)]
        for line in page.one(id=table).one("tbody").all("tr")
    ]


def test_nothing_is_asked_of_the_network_and_only_the_pages_own_script_may_run(text: str, page: Element) -> None:
    assert not re.search(r"(https?:)?//[a-z]|@import|url\(|<iframe|<img|\ssrc=", text, re.IGNORECASE)
    links = [own.given["href"] for own in page.all() if "href" in own.given]
    ids = [own.given["id"] for own in page.all() if "id" in own.given]
    assert len(set(ids)) == len(ids)
    assert all(link == "data:," or link.removeprefix("#") in ids for link in links)
    (script,) = page.all("script")
    digest = base64.b64encode(hashlib.sha256("".join(map(str, script.inside)).encode()).digest()).decode()
    policy = page.one("meta", **{"http-equiv": "Content-Security-Policy"}).given["content"]
    assert f"script-src 'sha256-{digest}'" in policy
    assert policy.startswith("default-src 'none'")
    assert not [name for own in page.all() for name in own.given if name.startswith("on")]


def test_names_and_errors_are_words_not_markup(text: str, page: Element) -> None:
    assert EVIL not in text
    assert not page.all("b")
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f]", text)
    names = [line[0] for line in lines(page, "rows-table")]
    assert EVIL in names
    assert visible(ODD).strip() in names
    assert page.one(id="failed").one("span", "error").text == "B1: video.mp4 is <b>damaged</b> & short"


def test_every_row_has_its_section_and_those_that_failed_come_first(page: Element) -> None:
    names = [own.one("span", "row-name").text.removeprefix("Row ") for own in page.all("article")]
    assert names == ["B1", "B2", EVIL, "A2", "A10", visible(ODD).strip()]
    assert [line[0] for line in lines(page, "rows-table")] == names
    failed, mapped = page.all("article")[0], page.all("article")[3]
    assert (failed.one("span", "badge").text, mapped.one("span", "badge").text) == ("failed", "mapped")
    assert "is <b>damaged</b>" in failed.one("p", "error").text
    assert not failed.all("figure")
    assert [own.one("span", "figure-title").text for own in mapped.all("figure")] == [
        "Row A2: face view",
        "Row A2: plan",
    ]


def test_warnings_are_told_with_their_row() -> None:
    trusted, warned = row("A1"), row("A2")
    odd = MapWarning("inaccurate-element", ("bay 1 / bar 1",), "2 m <off>", details=("more of it",))
    warnings = (odd, MapWarning("camera-motion"))
    rows = {"A1": replace(trusted, verdict=Verdict()), "A2": replace(warned, verdict=Verdict(warnings))}
    page = parsed(page_text(Report(SiteMap(rows, {}), {name: drawings(own) for name, own in rows.items()})))
    first, second = page.all("article")
    assert [own.text for own in first.all("span", "badge")] == ["mapped", "trusted"]
    assert [own.text for own in second.all("span", "badge")] == ["mapped", "check"]
    assert [own.text for own in second.one("ul", "warnings").all("li")] == [
        f"{odd.headline}: 2 m <off> inaccurate-element{odd.action}Detailsmore of it",
        f"{warnings[1].headline} camera-motion{warnings[1].action}",
    ]
    assert page.one("p", "banner").text == "1 of 2 rows must be checked: A2"
    assert second.one("p", "remark").text == "to be checked: 2 warnings"
    assert "1 / 1" in page.one("dl", "tiles").text


def test_numbers_agree_with_the_map(page: Element) -> None:
    tiles = {own.one("dt").text: own.one("dd").text for own in page.one("dl", "tiles").all("div")}
    assert tiles["rows mapped"] == "4 of 6"
    assert (tiles["failed"], tiles["post"], tiles["bar"]) == ("2", "12", "16")
    assert tiles["length of all rows"] == "24.4 m"
    assert tiles["references, contradicted"] == "8, 1"
    assert tiles["time on the clock"] == "1 h 02 min"
    assert tiles["missing / spurious"] == "1 / 0"
    a2 = next(line for line in lines(page, "rows-table") if line[0] == "A2")
    assert a2[1:8] == ["mapped", "3", "4", "6.10", "2", "0.5", "1.04"]
    assert a2[-1] == "missing: 1 bar"


def test_references_that_the_solution_contradicts_are_marked(page: Element) -> None:
    off = page.one(id="references-table").all("tr", "off")
    assert [[cell.text for cell in line.inside if isinstance(cell, Element)] for line in off] == [
        ["length & all", "A10", "6.0000", "6.0100", "+0.0100", "0.0020", "0.0020", "+5.00", "contradicted", "m"]
    ]
    assert len(lines(page, "references-table")) == 8


def test_softened_and_left_out_references_say_so() -> None:
    softened = ReferenceUse("length", 15.452, 0.003, 14.94, softened=0.51)
    uses = (softened, replace(softened, name="height", solved=15.45), replace(softened, name="mark", left_out=True))
    made = replace(row("C"), references=uses)
    table = parsed(page_text(Report(SiteMap({"C": made}, {}), {"C": drawings(made)})))
    found = [[line[0], *line[5:7], line[8]] for line in lines(table, "references-table")]
    assert found == [
        ["length", "0.0030", "0.5100", "contradicted"],
        ["height", "0.0030", "0.5100", "softened"],
        ["mark", "0.0030", NOTHING, "left out"],
    ]
    assert len(table.one(id="references-table").all("tr", "off")) == 2
    assert "3 references; 2 contradicted" in table.one(id="references").text


def test_errors_are_the_scores(page: Element) -> None:
    by_class = {line[0]: line[1:] for line in lines(page, "errors-by-class")}
    assert by_class["V element"] == ["8", "\u22121.00", "2.00", "3.00", "3.00"]
    assert by_class["all of these"][:3] == ["20", "\u22120.16", "1.04"]
    assert by_class["V edge (place in the row)"][0] == "4"
    assert lines(page, "errors-apart") == [["spots", "8", "2.00", "3.00", "3.00", "4", "0"]]
    assert lines(page, "errors-by-row")[1][2:] == ["1.04", "2.60", "5", "1 bar", "none"]
    assert "H gap: median +0.40, mean +0.40, quartiles +0.20 and +0.60" in page.one(id="box-plot-d").text


def test_ties_have_residuals_in_sigmas(page: Element) -> None:
    assert lines(page, "ties-by-pair") == [["A2 \u2013 A10", "2", "2.92", "0.00", "\u2013", "4.00", "1"]]
    assert lines(page, "ties")[0] == ["post 2", "A2", "post 2", "A10", "\u22124.00", "0.00", "\u2013", "4.00"]
    assert len(page.one(id="site-plan").one("g", "tie").all("path")) == 1
    assert "\u22124.00 cm" in page.one(id="site-plan").all("g", "off")[0].one("title").text


def test_stage_times_are_bars_over_the_longest_row(page: Element) -> None:
    table = page.one(id="times")
    bars = {line.one("th").text: [own.given["style"] for own in line.all("i")] for line in table.one("tbody").all("tr")}
    assert bars["A2"] == ["width:75.00%", "width:25.00%"]
    assert bars["B2"] == ["width:6.25%"]
    assert [line[2] for line in lines(page, "stages")] == ["245.0", "80.0"]


def test_rows_stand_in_the_plan_as_they_are_placed(page: Element) -> None:
    strips = {
        own.one("title").text.split(":")[0]: own.one("path").given["d"]
        for own in page.one(id="site-plan").all("g", "strip")
    }
    assert strips["Row A2"] == "M0 0h6100"
    assert strips["Row A10"] == "M500 4000h-6100"
    assert page.one(id="site-plan").one("g", "failed").one("title").text.startswith("Row B1 failed: B1: video")
    assert "drawn beneath the others: B2" in page.one("section", id="plan").one("p").text


def test_places_are_told_with_their_sigmas(page: Element) -> None:
    facts = {own.one("dt").text: own.one("dd").text for own in page.one(id="row-A10").one("dl", "facts").all("div")}
    assert (
        facts["place in the site"] == "x 0.500 \u00b1 1.000 m, z 4.000 \u00b1 1.000 m, heading 180.00 \u00b1 1.00\u00b0"
    )


def test_rows_without_a_place_are_stacked_and_told() -> None:
    page = parsed(page_text(report(("A", "B"), placed=False)))
    assert "the rows stand in the site is not known" in page.one("section", id="plan").one("p").text
    strips = [own.one("path").given["d"] for own in page.one(id="site-plan").all("g", "strip")]
    assert strips == ["M0 0h6100", "M0 3000h6100"]


def test_what_is_mapped_is_told_with_its_sigmas(page: Element) -> None:
    face = page.one(id="row-A2-face")
    said = {own.text.split(":")[0]: own.text for own in face.all("title")}
    assert (
        said["bay 1 / bar 2"]
        == "bay 1 / bar 2: height 0.100 ± 0.003 m; vertices \u03c3 up to x 0.002, y 0.002, z 0.002 m"
    )
    assert said["post 1"].endswith("; off the survey by 1.23 cm")
    assert face.one("g", "mapped").one("path").given["d"] == "M0 0h100v-5000h-100z"
    assert [line[0] for line in lines(page, "sigmas")] == ["post: height", "bar: height"]
    assert lines(page, "sigmas")[0][3] == "0.30"


def test_page_says_when_and_from_what_it_was_mapped(page: Element) -> None:
    assert page.one("time").text == "2026-11-27 18:42 UTC"
    assert lines(page, "footage-table")[1] == [
        "A2",
        "pass 1",
        "aisle.mp4",
        "3840 \u00d7 1920",
        "30",
        "30",
        *["0.0", "29.0", "29.0"],
    ]
    without = parsed(page_text(Report(SiteMap({"A": row("A")}, {}), {})))
    assert not without.all("time")
    assert lines(without, "footage-table")[0][2:5] == ["\u2013", "\u2013", "30"]


def test_openings_are_a_table_of_bays_and_levels(page: Element) -> None:
    table = page.one(id="row-A2-openings")
    heads = [own.text for own in table.one("thead").all("th")]
    assert heads == ["bay", "clear width, m", "level 0: clear height, m", "level 1: clear height, m"]
    assert lines(page, "row-A2-openings") == [
        ["bay 1", "2.700 \u00b1 0.004", "1.900 \u00b1 0.002", "0.800 \u00b1 0.020"]
    ]
    assert [cell.text for cell in table.all("td") if "data-assumed" in cell.given] == ["0.800 \u00b1 0.020"]


def test_what_is_assumed_is_hatched_and_left_out_of_sigmas(page: Element) -> None:
    own = assumed_top(row("A"))
    assumed = parsed(page_text(Report(SiteMap({"A": own}, {}), {"A": drawings(own)})))
    measured = {line[0]: line for line in lines(page, "sigmas")}
    found = {line[0]: line for line in lines(assumed, "sigmas")}
    assert found["bar: height"][2:] == ["3", "0.30", "0.30", "0.30"]
    assert max(float(line[5]) for line in found.values()) == float(measured["bar: height"][5]) == 0.3
    assert "6 vertices with an assumed coordinate are left out" in assumed.one(id="sigmas").one("caption").text
    (hatched,) = assumed.one(id="row-A-face").all("g", "assumed")
    strokes = re.findall(r"M(\d+) (-?\d+)", hatched.one("path").given["d"])
    assert min(int(y) for _, y in strokes) < -5400
    assert not page.one(id="row-A2-face").all("g", "assumed")
    said = {title.text.split(":")[0]: title.text for title in assumed.one(id="row-A-face").all("title")}
    assert said["post 1"].endswith("\u03c3 up to x 0.002, y 0.002, z 0.002 m; y of 2 of 4 vertices assumed")
    assert "height 0.100 \u00b1 0.025 m, assumed" in said["bay 1 / bar 1"]


def test_tables_have_headings_and_figures_have_words(page: Element) -> None:
    for table in page.all("table"):
        assert table.one("caption").text
        assert all(own.given["scope"] == "col" for own in table.one("thead").all("th"))
        assert all(line.all("th")[0].given["scope"] == "row" for line in table.one("tbody").all("tr"))
        assert {len(line.all("th") + line.all("td")) for line in table.one("tbody").all("tr")} <= {
            len(table.one("thead").all("th"))
        }
    for figure in page.all("figure"):
        svg = figure.one("svg")
        assert svg.one("title").given["id"] == svg.given["aria-labelledby"]
        assert svg.one("desc").text


def test_a_map_alone_makes_a_page() -> None:
    alone = parsed(page_text(Report(SiteMap({"A": row("A")}, {}), {"A": drawings(row("A"))})))
    assert not [own for own in alone.all("section") if own.given["id"] in ("errors", "between", "time", "failed")]
    assert len(alone.all("figure")) == 3


def test_nothing_mapped_makes_a_page() -> None:
    page = parsed(page_text(Report(SiteMap({}, {}, {"A": "no video"}), {})))
    assert page.one(id="row-A").one("p", "error").text == "no video"
    assert "no row was mapped" in page.one("section", id="plan").text


def test_names_that_differ_in_signs_only_have_anchors_of_their_own() -> None:
    rows = {name: row(name) for name in ("A 1", "A-1", "A/1", "???", "row")}
    page = parsed(page_text(Report(SiteMap(rows, {}), {name: drawings(own) for name, own in rows.items()})))
    ids = [own.given["id"] for own in page.all("article")]
    assert len(set(ids)) == 5
    assert "row-A-1" in ids


def test_forty_six_rows_of_fifteen_sections_stay_small() -> None:
    one = row("1", sections=15, levels=8)
    rows = {str(k): replace(one, name=str(k)) for k in range(46)}
    placed = {name: Placement(0.0, 3.0 * k, 0.0, np.eye(3)) for k, name in enumerate(rows)}
    drawn = drawings(one)
    text = page_text(
        Report(SiteMap(rows, {}, placements=placed), dict.fromkeys(rows, drawn), None, evaluation(list(rows)))
    )
    assert len(text.encode()) < 3_000_000
    assert text.count("<article") == 46


def test_the_page_is_written_whole_and_the_same_each_time(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_page(report(), tmp_path / f"{name}.html")
    assert (tmp_path / "one.html").read_bytes() == (tmp_path / "two.html").read_bytes()
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be written"):
        write_page(report(), tmp_path / "file" / "three.html")


def test_half_a_character_does_not_spoil_the_page(tmp_path: Path) -> None:
    name = "A \ud800"
    write_page(Report(SiteMap({name: row(name)}, {}), {}), tmp_path / "page.html")
    assert "Row A \\ud800" in (tmp_path / "page.html").read_text(encoding="utf-8")
