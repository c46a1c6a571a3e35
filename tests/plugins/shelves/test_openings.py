"""The clear space between beams, as structures for the comparison of two dates."""

import re
from dataclasses import replace

import numpy as np
import pytest
from perfect_maps import structures_of, surveyed_row

from savmap.apps.dates.comparison.compare import compare_maps
from savmap.errors import OutputError
from savmap.maps.search import find_structures
from savmap.plugin.manager import open_plugin
from savmap.report.site_report import places_of
from savmap.types import FrameTable, JointCovariance, Measured, RowMap, SiteMap, Structure, Trajectory
from savmap_shelves.report.slots import openings, places, slots_of


def site_of(structures: list[Structure]) -> SiteMap:
    path = Trajectory(np.zeros(0, int), np.zeros((0, 4, 4)))
    return SiteMap({"A": RowMap("A", FrameTable(np.zeros(0), ()), {}, path, {"shelves": tuple(structures)}, ())}, {})


def test_each_opening_is_the_space_between_two_beams() -> None:
    found = {one.id: one for one in openings(structures_of(surveyed_row()))}
    low, high = found["bay 1 / opening 1"].vertices.min(axis=0), found["bay 1 / opening 1"].vertices.max(axis=0)
    np.testing.assert_allclose((low, high), ([0.1, 0.4, 0], [3.7, 1.2, 0]))
    assert found["bay 1 / opening 1"].attributes == {"bay": 1, "level": 1}
    bridge = found["bay 3 / opening 0"]
    assert bridge.vertices[:, 1].min() == 0
    assert bridge.vertices[:, 1].max() == 4.2


def test_openings_are_the_slots_with_a_beam_above() -> None:
    row = surveyed_row()
    row["sections"][0]["beams"][1] = [0.6, 0.7]
    made = structures_of(row)
    slots = [slot for slot in slots_of(site_of(made), "shelves") if slot.clear_height is not None]
    found = openings(made)
    assert [tuple(one.attributes.values()) for one in found] == [(slot.bay, slot.level) for slot in slots]
    sizes = [np.ptp(one.vertices, axis=0)[:2] for one in found]
    expected = [(slot.clear_width, slot.clear_height) for slot in slots]
    np.testing.assert_allclose(sizes, [[one.value for one in both if one] for both in expected], atol=1e-12)
    variances = [np.diagonal(one.covariances[[0, 3]], axis1=1, axis2=2).sum(axis=0)[:2] for one in found]
    np.testing.assert_allclose(np.sqrt(variances), [[one.sigma for one in both if one] for both in expected])


def test_without_an_upright_no_width_is_compared() -> None:
    whole = structures_of(surveyed_row())
    part = [one for one in whole if one.id != "upright 2"]
    lone = next(one for one in openings(part) if one.id == "bay 1 / opening 1")
    np.testing.assert_allclose(np.ptp(lone.vertices, axis=0), [0, 0.8, 0])
    found = compare_maps(
        site_of(whole), site_of(part), ({"A": {"shelves": openings(whole)}}, {"A": {"shelves": openings(part)}})
    ).rows[0]
    tested = {one.name: {figure.what for figure in one.differences} for one in found.openings}
    assert tested["bay 1 / opening 1"] == {"size y"}
    assert tested["bay 3 / opening 0"] == {"size x", "size y"}
    assert {one.state for one in found.openings} == {"same"}


def test_beams_without_a_section_are_refused() -> None:
    bad = replace(structures_of(surveyed_row())[-1], attributes={})
    with pytest.raises(OutputError, match="'bay' should be a whole number"):
        open_plugin("shelves", {}).openings([bad])


def test_a_raised_beam_changes_the_openings_beside_it() -> None:
    row = surveyed_row()
    old = structures_of(row)
    row["sections"][1]["beams"][2] = [2.33, 2.43]
    new = structures_of(row)
    rng = np.random.default_rng(1)
    new = [
        Structure(
            one.id,
            one.label,
            one.vertices + rng.normal(0, 0.001, 3),
            one.covariances,
            one.vertex_labels,
            one.edges,
            one.attributes,
        )
        for one in new
    ]
    found = compare_maps(
        site_of(old), site_of(new), ({"A": {"shelves": openings(old)}}, {"A": {"shelves": openings(new)}})
    )
    changed = {one.name: one.significant[0] for one in found.rows[0].openings if one.state != "same"}
    assert {name: round(one.difference_m or 0, 2) for name, one in changed.items()} == {
        "bay 2 / opening 2": 0.08,
        "bay 2 / opening 3": -0.08,
    }
    assert {one.what for one in changed.values()} == {"size y"}


def test_a_row_that_is_higher_by_less_than_it_knows_changes_no_opening() -> None:
    """The floor is there by definition: all openings above it are higher then, and the others are as they were."""
    rng = np.random.default_rng(1)
    old = structures_of(surveyed_row())
    new = [
        replace(one, vertices=one.vertices + rng.normal([0, 0.015, 0], 0.0007), covariances=4 * one.covariances)
        for one in old
    ]
    both = tuple({"A": {"shelves": openings(structures)}} for structures in (old, new))
    row = compare_maps(site_of(old), site_of(new), both).rows[0]
    assert {one.state for one in (*row.elements, *row.openings)} == {"same"}
    floors = [one for one in row.openings if one.name.endswith("opening 0")]
    assert all(any(figure.what == "size y" for figure in one.differences) for one in floors)


def test_openings_have_the_scale_of_their_row() -> None:
    """A wrong length makes all of them larger by the same share, the high one of a bridge by the most."""
    rng = np.random.default_rng(1)
    old = structures_of(surveyed_row())
    new = [
        replace(one, vertices=1.05 * one.vertices + rng.normal(0, 0.0007, 3), covariances=0.01 * one.covariances)
        for one in old
    ]
    both = tuple({"A": {"shelves": openings(structures)}} for structures in (old, new))
    row = compare_maps(site_of(old), site_of(new), both).rows[0]
    assert row.scale_differs
    assert {one.state for one in row.openings} == {"same"}


def test_places_have_the_clear_sizes_of_the_slots() -> None:
    row = site_of(structures_of(surveyed_row())).rows["A"]
    numbers = {own.id: np.full((len(own.vertices), 3), k) for k, own in enumerate(row.structures["shelves"])}
    errors = np.random.default_rng(3).normal(0, 0.002, (len(numbers), 2)) + 0.01
    joint = JointCovariance({"shelves": numbers}, errors @ errors.T)
    site = SiteMap({"A": replace(row, joint=joint)}, {})
    slots = {(slot.bay, slot.level): slot for slot in slots_of(site, "shelves")}
    found = {one.id: one for one in places(row.structures["shelves"], "shelves", joint)}
    for (bay, level), slot in slots.items():
        sizes = found[f"bay {bay} / level {level}"].attributes
        assert sizes["clear_width_m"] == found[f"bay {bay}"].attributes["clear_width_m"] == slot.clear_width
        assert sizes.get("clear_height_m") == slot.clear_height
    own, shared = (places(row.structures["shelves"], "shelves", one)[0].attributes for one in (None, joint))
    assert isinstance(own["clear_width_m"], Measured)
    assert isinstance(shared["clear_width_m"], Measured)
    assert own["clear_width_m"].sigma != shared["clear_width_m"].sigma
    part = [one for one in row.structures["shelves"] if one.id != "upright 2"]
    assert "clear_width_m" not in places(part)[0].attributes


def test_a_section_is_found_with_its_clear_width() -> None:
    site = site_of(structures_of(surveyed_row()))
    (hit,) = find_structures(site, "bay 1", lambda: places_of(site))
    assert re.search(r"; clear width 3\.600 m \+- \d+\.\d mm$", str(hit))
    (level,) = find_structures(site, "level 1 of bay 1", lambda: places_of(site))
    assert re.search(r"; clear width 3\.600 m .*; clear height 0\.800 m \+- \d+\.\d mm$", str(level))


def test_sections_and_levels_are_places_at_the_slots_centres() -> None:
    made = structures_of(surveyed_row())
    found = {one.id: one for one in places(made)}
    slots = {(slot.bay, slot.level): slot for slot in slots_of(site_of(made), "shelves")}
    levels = {(one.attributes["bay"], one.attributes["level"]): one for one in found.values() if one.label == "level"}
    assert set(levels) == set(slots)
    for key, one in levels.items():
        x, y, z = one.vertices.mean(axis=0)
        np.testing.assert_allclose(slots[key].centre, (x, -z, y), atol=1e-12)
    np.testing.assert_allclose(found["bay 3"].vertices[[0, 3]], [[7.6, 0, 0], [11.3, 6.45, 0]])
    assert find_structures(site_of(made), "level 2 of bay 1", lambda: {"A": {"shelves": places(made)}})[
        0
    ].position_m == pytest.approx([1.9, 1.8, 0])
