"""Inspection of racks: which loads fit, deviations from a drawing, and deformations that somebody measured."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from perfect_maps import structures_of, surveyed_row

from savmap.errors import OutputError, SiteError
from savmap.plugin.inspection import limit_lines
from savmap.plugin.manager import LoadedPlugin, open_plugin
from savmap.types import Finding, Measured, RowInspection, Structure

SIGMA_M = 0.0005


@pytest.fixture(scope="module")
def shelves() -> LoadedPlugin:
    return open_plugin("shelves", {})


def mapped(sigma_m: float = SIGMA_M) -> list[Structure]:
    covariances = np.tile(sigma_m**2 * np.eye(3), (4, 1, 1))
    return [replace(part, covariances=covariances) for part in structures_of(surveyed_row())]


def inspected(
    shelves: LoadedPlugin,
    parts: list[Structure],
    limits: Mapping[str, Any] | None = None,
    survey: Mapping[str, Any] | None = None,
) -> RowInspection:
    places = {"shelves": shelves.places(parts, None)}
    return shelves.inspect(parts, places, None, shelves.limits(limits or {}, "limits"), survey, {}, None)


def by_subject(inspection: RowInspection) -> dict[tuple[str, ...], Finding]:
    return {finding.subjects: finding for finding in inspection.findings}


def test_a_map_alone_says_what_is_not_checked(shelves: LoadedPlugin) -> None:
    inspection = inspected(shelves, mapped())
    assert (inspection.findings, inspection.tables) == ((), ())
    for words in ("dents, cracks", "anchors and base plates", "protectors", "loaded when they were filmed", "0.4 m"):
        assert any(words in line for line in inspection.unchecked[:6])
    assert len(inspection.unchecked) == 12
    assert "plumb" in inspection.unchecked[6]


def test_limits_whose_red_comes_before_amber_are_refused(shelves: LoadedPlugin) -> None:
    for key in ("lean_permille", "out_of_plumb_permille", "bow_permille", "sag_share", "bay_width_mm"):
        with pytest.raises(SiteError, match=f"`{key}`: large values are bad here, so red must be larger than amber"):
            shelves.limits({key: {"amber": 6, "red": 3}}, "limits")


@pytest.mark.parametrize("amber", [True, "5", "five"])
def test_limits_that_are_no_numbers_are_refused(shelves: LoadedPlugin, amber: object) -> None:
    with pytest.raises(SiteError, match=r"`lean_permille\.amber`: a number is expected"):
        shelves.limits({"lean_permille": {"amber": amber, "red": 10}}, "limits")


def test_slots_take_load_units_with_a_probability(shelves: LoadedPlugin) -> None:
    """Bay 1 is 3.6 m wide, its level 1 0.8 m high; a load of 0.725 m, with 0.075 m above, fits exactly."""
    unit = {"name": "box", "width_m": 0.79, "height_m": 0.7252, "levels": [1]}
    inspection = inspected(shelves, mapped(), {"load_units": [unit]})
    fit, lost = inspection.tables
    lines = {line[:2]: dict(zip(fit.columns, line, strict=True)) for line in fit.lines}
    assert lines[1, 1]["count"] == 4
    assert lines[1, 1]["probability"] == pytest.approx(0.389, abs=1e-3)
    assert lines[1, 1]["free_width_m"] == pytest.approx(3.6 - 4 * 0.79 - 5 * 0.075)
    assert lines[1, 0]["probability"] == 0.0
    assert (lines[1, 6]["probability"], lines[1, 6]["note"]) == (None, "height not limited by the map")
    assert lines[3, 1]["count"] == 4
    findings = by_subject(inspection)
    grades = {subjects[0]: finding.grade for subjects, finding in findings.items()}
    assert grades == {
        "bay 1 / level 1": "amber",
        "bay 2 / level 1": "green",
        "bay 3 / level 1": "green",
        "bay 4 / level 1": "green",
    }
    bay_2 = next(line for line in lost.lines if line[0] == 2)
    assert bay_2[2] == pytest.approx((0.94 + 0.95 + 0.85 + 1.1 + 1.1) - 5 * 0.7252 - 3 * 0.075 - 2 * 0.1, abs=1e-3)


def test_a_slot_that_must_take_a_load_and_does_not_is_red(shelves: LoadedPlugin) -> None:
    unit = {"name": "box", "width_m": 1.3, "height_m": 0.5, "across": 2, "levels": [2]}
    findings = by_subject(inspected(shelves, mapped(), {"load_units": [unit]}))
    assert findings[("bay 4 / level 2",)].grade == "red", "2.7 m take no two of 1.3 m with 0.075 m around"
    assert findings[("bay 1 / level 2",)].grade == "green"
    assert findings[("bay 4 / level 2",)].value == pytest.approx(2.7 - 2.6 - 3 * 0.075)


def test_what_is_too_wide_is_red_whatever_nothing_measured_of_the_height(shelves: LoadedPlugin) -> None:
    places = [
        replace(place, attributes={**place.attributes, "assumed": "clear height assumed"})
        for place in shelves.places(mapped(), None)
    ]
    units = [
        {"name": name, "width_m": width, "height_m": 0.5, "across": 2, "levels": [2, 6]}
        for name, width in (("wide", 1.9), ("narrow", 1.0))
    ]
    limits = shelves.limits({"load_units": units}, "limits")
    findings = shelves.inspect(mapped(), {"shelves": places}, None, limits, None, {}, None).findings
    by_title = {finding.title: finding for finding in findings}
    wide = by_title["2 x wide in bay 1 / level 2: width left"]
    assert (wide.grade, wide.value) == ("red", pytest.approx(3.6 - 3.8 - 3 * 0.075))
    assert wide.action == "do not store it there"
    assert by_title["2 x narrow in bay 1 / level 2: height left; clear height assumed"].grade == "unknown"
    assert by_title["2 x wide in bay 1 / level 6: width left"].grade == "red"
    assert "2 x narrow in bay 1 / level 6: width left; height not limited by the map" in by_title


def test_levels_that_no_bay_has_and_load_units_without_levels_are_named(shelves: LoadedPlugin) -> None:
    units = [{"name": "box", "width_m": 0.5, "height_m": 0.5, "levels": [1, 9]}]
    units.append({"name": "drum", "width_m": 0.5, "height_m": 0.5})
    inspection = inspected(shelves, mapped(), {"load_units": units})
    nowhere = [finding for finding in inspection.findings if finding.code == "no-such-level"]
    assert [(finding.title, finding.grade) for finding in nowhere] == [
        ("box on level 9: no bay of the row has such a level", "unknown")
    ]
    limits = shelves.limits({"load_units": units}, "limits")
    shown = {line.value for line in limit_lines(limits, inspection.applied)}
    assert {"name box, width 0.5 m, height 0.5 m, levels 1, 9", "up to 3.0 m, beside 0.075 m, above 0.075 m"} <= shown
    assert "whether drum fits: the limits give it no `levels`" in inspection.unchecked
    assert not any("whether box" in line for line in inspection.unchecked)


def test_a_rack_as_drawn_is_all_green(shelves: LoadedPlugin) -> None:
    inspection = inspected(shelves, mapped(), survey=surveyed_row())
    assert {finding.grade for finding in inspection.findings} == {"green"}
    assert len(inspection.findings) == 4 + 22
    assert {finding.unit for finding in inspection.findings} == {"mm"}


def test_what_deviates_from_the_drawing_is_named(shelves: LoadedPlugin) -> None:
    drawing = surveyed_row()
    drawing["uprights"][2:] = [[left + 0.008, right + 0.008] for left, right in drawing["uprights"][2:]]
    drawing["sections"][0]["beams"][2] = [2.307, 2.407]
    drawing["sections"][3]["beams"].pop()
    drawing["sections"][2]["beams"].append([7.3, 7.45])
    findings = inspected(shelves, mapped(), survey=drawing).findings
    poor = {finding.subjects: finding for finding in findings if finding.grade != "green"}
    assert poor.keys() == {("upright 2", "upright 3"), ("bay 1 / beam 3",), ("bay 4 / beam 7",), ()}
    assert poor[("upright 2", "upright 3")].grade == "red"
    assert poor[("upright 2", "upright 3")].value == pytest.approx(-8.0)
    assert poor[("bay 1 / beam 3",)].grade == "amber"
    assert poor[("bay 1 / beam 3",)].value == pytest.approx(-7.0)
    assert poor[("bay 4 / beam 7",)].code == "element-in-excess"
    assert poor[()].title == "beam 4 of bay 3 of the drawing is not in the map"


def test_what_is_measured_too_badly_is_unknown_and_never_red(shelves: LoadedPlugin) -> None:
    findings = inspected(shelves, mapped(0.02), survey=surveyed_row()).findings
    assert {finding.grade for finding in findings} <= {"unknown", "amber"}


def test_a_tall_rack_has_the_wider_tolerance(shelves: LoadedPlugin) -> None:
    drawing = surveyed_row()
    drawing["sections"][0]["beams"][5] = [5.509, 5.609]
    findings = by_subject(inspected(shelves, mapped(), survey=drawing))
    assert findings[("bay 1 / beam 6",)].limit == pytest.approx(1000 * (5.609 - 0.4) / 500)
    assert findings[("bay 1 / beam 6",)].limit_key == "beam_height_share"


def test_a_drawing_of_other_plugins_alone_compares_nothing(shelves: LoadedPlugin) -> None:
    assert inspected(shelves, mapped(), survey={"lights": []}).findings == ()
    with pytest.raises(OutputError, match="uprights"):
        inspected(shelves, mapped(), survey={"uprights": [[0, 1]], "sections": []})


def test_only_what_is_red_is_to_be_unloaded(shelves: LoadedPlugin) -> None:
    parts = mapped()
    for k, (lean, sigma) in enumerate(((1.0, 0.1), (5.0, 2.0), (7.0, 0.1), (12.0, 0.1))):
        attributes = {**parts[k].attributes, "lean_permille": Measured(lean, sigma)}
        parts[k] = replace(parts[k], attributes=attributes)
    findings = inspected(shelves, parts).findings
    assert [finding.grade for finding in findings] == ["green", "unknown", "amber", "red"]
    assert ["unload" in finding.action for finding in findings] == [False, False, False, True]
    assert [finding.action.count("plumb line") for finding in findings] == [0, 1, 1, 1]
    assert findings[0].over_m == pytest.approx(float(np.ptp(parts[0].vertices[:, 1])))


def test_a_drawing_takes_no_limit_away(shelves: LoadedPlugin) -> None:
    """Of the limits of a lean that counts by which it is worse, and the finding says which."""
    parts = mapped()
    parts[0] = replace(parts[0], attributes={**parts[0].attributes, "lean_permille": Measured(4.0, 0.1)})
    site = {"lean_permille": {"amber": 1.0, "red": 3.0, "source": "our handbook"}}
    for limits, survey, grade, key, limit in (
        ({}, None, "green", "lean_permille", 5.0),
        ({}, surveyed_row(), "amber", "out_of_plumb_permille", 1000 / 350),
        (site, surveyed_row(), "red", "lean_permille", 3.0),
    ):
        inspection = inspected(shelves, parts, limits, survey)
        finding = by_subject(inspection)[("upright 1",)]
        assert (finding.grade, finding.limit_key, finding.limit) == (grade, key, limit)
        assert ("lean_permille" in inspection.applied, "out_of_plumb_permille" in inspection.applied) == (
            True,
            survey is not None,
        )
    assert finding.limit_source == "our handbook"


def test_deformations_are_graded_where_they_were_measured(shelves: LoadedPlugin) -> None:
    parts = mapped()
    lean, sag = Measured(-12.0, 0.5), Measured(0.027, 0.001)
    parts[0] = replace(parts[0], attributes={**parts[0].attributes, "lean_permille": lean})
    parts[1] = replace(parts[1], attributes={**parts[1].attributes, "bow_permille": Measured(-7.0, 0.5)})
    beam = next(k for k, part in enumerate(parts) if part.id == "bay 1 / beam 1")
    parts[beam] = replace(parts[beam], attributes={**parts[beam].attributes, "sag_m": sag})
    inspection = inspected(shelves, parts)
    findings = by_subject(inspection)
    assert (findings[("upright 1",)].code, findings[("upright 1",)].grade) == ("out-of-plumb", "red")
    assert (findings[("upright 2",)].code, findings[("upright 2",)].grade) == ("upright-bow", "amber")
    assert (findings[("bay 1 / beam 1",)].code, findings[("bay 1 / beam 1",)].grade) == ("beam-sag", "amber")
    assert len(inspection.unchecked) == 9
