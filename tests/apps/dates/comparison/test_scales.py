"""A scale that is not that of the other map is told, as far as both maps say that they know theirs."""

import json
from dataclasses import replace

import mapped_place as place
import numpy as np
import pytest

from savmap.apps.dates.comparison.changes import with_significance
from savmap.apps.dates.comparison.compare import compare_maps
from savmap.apps.dates.comparison.records import RowComparison, ScaleDifference
from savmap.apps.dates.comparison.texts import as_json, comparison_lines
from savmap.types import SiteMap

BAYS = place.irregular()
LONG = place.irregular(24)


def compared(old: SiteMap, new: SiteMap) -> RowComparison:
    return compare_maps(old, new).rows[0]


@pytest.mark.slow
def test_maps_of_one_state_do_not_differ_in_scale() -> None:
    rows = [compared(place.mapped(BAYS, seed), place.mapped(BAYS, 100 + seed)) for seed in range(20)]
    assert [len(row.scales) for row in rows] == [2] * 20
    assert not any(row.scale_differs for row in rows)
    for axis in (0, 1):
        assert np.sqrt(np.mean([row.scales[axis].sigmas ** 2 for row in rows])) < 1.3


@pytest.mark.parametrize("factor", [1.063, 0.94, 1.006])
def test_a_camera_height_that_is_wrong_is_told(factor: float) -> None:
    old, new = place.mapped(BAYS, 1), place.scaled(place.mapped(BAYS, 2), factor)
    found = compare_maps(old, new)
    along, _ = found.rows[0].scales
    assert along.significant
    assert along.axis == "x"
    assert along.share == pytest.approx(factor - 1, abs=3 * along.sigma)
    assert 0.0004 < along.sigma < 0.002
    assert found.changed
    assert not found.rows[0].changes, "an element is as it was"
    assert any("differ in scale by more than their references allow" in line for line in comparison_lines(found))
    entry = json.loads(json.dumps(as_json(found)))["rows"][0]["scales"][0]
    assert (entry["axis"], entry["significant"]) == ("x", True)
    assert entry["share"] == pytest.approx(along.share, abs=1e-6)
    assert entry["sigma"] == pytest.approx(along.sigma, abs=1e-6)


@pytest.mark.slow
def test_a_wrong_scale_is_the_inverse_the_other_way() -> None:
    old, new = place.mapped(BAYS, 1), place.scaled(place.mapped(BAYS, 2), 1.063)
    there, back = compared(old, new).scales[0], compared(new, old).scales[0]
    assert 1 + back.share == pytest.approx(1 / (1 + there.share), abs=1e-3)


def test_a_map_that_knows_its_scale_badly_tells_nothing() -> None:
    new = place.scaled(place.with_joint(place.mapped(BAYS, 2), 0.03), 1.063)
    along, up = compared(place.with_joint(place.mapped(BAYS, 1), 0.0), new).scales
    assert not along.significant
    assert not up.significant
    assert along.share == pytest.approx(0.063, abs=0.005)
    assert along.new_sigma == pytest.approx(0.03, rel=0.05)
    assert along.old_sigma < 0.001


def test_errors_in_common_count_where_the_joint_covariance_says_so() -> None:
    """The vertices' own standard deviations are those of a map that knows its scale."""
    row = compared(place.mapped(BAYS, 1), place.with_joint(place.mapped(BAYS, 2), 0.05))
    assert row.scales[1].new_sigma == pytest.approx(0.05, rel=0.05)
    known = compared(place.mapped(BAYS, 1), place.with_joint(place.mapped(BAYS, 2), 0.0))
    assert known.scales[1].new_sigma < 0.002


def test_a_scale_that_neither_map_allows_hides_no_change_and_makes_none() -> None:
    """The vertices' own standard deviations allow 0.03 % here: a fit that stays with them takes the row's ends for moved."""
    old = place.with_joint(place.mapped(BAYS, 1), 0.0)
    new = place.with_joint(place.mapped(place.moved_bar(BAYS, 3, 2, 0.05), 2), 0.0)
    row = compared(old, place.scaled(new, 1.008))
    assert row.scale_differs
    assert [one.name for one in row.changes] == ["bay 4 / bar 3"]
    assert row.motion is not None
    assert row.motion.scale[:2] == pytest.approx([one.share for one in row.scales], abs=1e-6)


def test_a_row_that_is_turned_has_the_scale_that_it_has() -> None:
    new = place.half_turned(place.scaled(place.with_joint(place.mapped(BAYS, 2), 0.01), 1.08))
    row = compared(place.mapped(BAYS, 1), new)
    assert row.motion is not None
    assert row.motion.heading_deg == pytest.approx(180, abs=0.5)
    assert row.scales[0].share == pytest.approx(0.08, abs=0.005)
    assert row.scales[0].new_sigma == pytest.approx(0.01, rel=0.1)
    assert row.scale_differs


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.85, 1.0635, 1.2])
def test_long_rows_of_other_scales_are_found_in_one_another(factor: float) -> None:
    """At the ends of a row of 67 m the maps are metres apart, wherever their middles are laid."""
    row = compared(place.mapped(LONG, 1), place.scaled(place.mapped(LONG, 2), factor))
    assert row.motion is not None
    assert row.motion.pairs > 160
    assert row.scales[0].share == pytest.approx(factor - 1, abs=0.003)
    assert row.scale_differs
    assert len(row.changes) < 5


def test_rows_of_which_nothing_is_apart_tell_no_scale() -> None:
    site = place.mapped(BAYS[:1], 1)
    row = site.rows["A"]
    low = {"racks": tuple(one for one in row.structures["racks"] if one.label == "bar")[:3]}
    few = replace(site, rows={"A": replace(row, structures=low)})
    assert [one.axis for one in compared(few, few).scales] in ([], ["y"])


def one(p: float) -> ScaleDifference:
    return ScaleDifference("x", 0.01, 0.003, 0.001, 0.001, p)


def test_scales_of_many_rows_are_one_family() -> None:
    assert with_significance([[one(0.001)]], 0.1)[0][0].significant
    assert not with_significance([[one(0.01)]], 0.5)[0][0].significant, "less than three standard deviations"
    many = with_significance([[one(0.002)], *([one(0.5)] for _ in range(99))], 0.1)
    assert not many[0][0].significant
    assert with_significance([[], []], 0.1) == [(), ()]


@pytest.mark.parametrize("factor", [0.85, 1.2])
def test_what_another_scale_moves_by_metres_is_still_seen_where_it_was(factor: float) -> None:
    """The camera of the old map ended in the middle of the row; the new map's elements beyond are not new, and those before it are."""
    part = place.mapped(LONG, 1, (0.0, 0.5))
    less = {"racks": tuple(one for one in part.rows["A"].structures["racks"] if one.id != "bay 2 / bar 2")}
    old = replace(part, rows={"A": replace(part.rows["A"], structures=less)})
    row = compared(old, place.scaled(place.mapped(LONG, 2), factor))
    states = {change.name: change.state for change in row.elements if change.plugin == "racks"}
    assert states["bay 2 / bar 2"] == "new"
    assert states["bay 14 / bar 1"] == "not seen"
    assert row.motion is not None
    assert {name for name, state in states.items() if state == "new"} == {"bay 2 / bar 2"}
