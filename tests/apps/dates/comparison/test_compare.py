"""What changed between two maps of a made-up place: found where it is, and nothing where nothing is."""

import json
from dataclasses import replace

import mapped_place as place
import numpy as np
import pytest

from savmap.apps.dates.comparison.changes import accepted, chance_shares, with_states
from savmap.apps.dates.comparison.compare import compare_maps
from savmap.apps.dates.comparison.records import CHANGES, Comparison, Difference, ElementChange, RowMotion
from savmap.apps.dates.comparison.texts import as_json, comparison_lines, comparison_text, motion_text, unsaid_text
from savmap.types import Measured, SiteMap, Structure

BAYS = place.irregular()


def states(comparison: Comparison) -> dict[str, str]:
    return {one.name: one.state for one in comparison.rows[0].elements if one.state != "same"}


def change(comparison: Comparison, name: str) -> ElementChange:
    return next(one for one in comparison.rows[0].elements if one.name == name)


def bars_of(site: SiteMap) -> list[Structure]:
    return [one for one in site.rows["A"].structures["racks"] if one.label == "bar"]


@pytest.mark.slow
def test_two_maps_of_one_state_differ_in_nothing() -> None:
    told = count = 0
    for seed in range(20):
        row = compare_maps(place.mapped(BAYS, seed), place.mapped(BAYS, 100 + seed)).rows[0]
        told += sum(one.state != "same" for one in row.elements)
        count += len(row.elements)
    assert count == 20 * 57
    assert told <= 0.005 * count


@pytest.mark.parametrize("by_mm", [-50, -15, 15, 50])
def test_a_moved_bar_is_told_by_how_much_and_where(by_mm: int) -> None:
    found = compare_maps(place.mapped(BAYS, 1), place.mapped(place.moved_bar(BAYS, 3, 2, by_mm / 1000), 2))
    assert states(found) == {"bay 4 / bar 3": "moved"}
    bar = change(found, "bay 4 / bar 3").significant[0]
    assert bar.what == "y"
    assert bar.difference_m == pytest.approx(by_mm / 1000, abs=0.005)
    assert bar.sigma_m is not None
    assert 0.0005 < bar.sigma_m < 0.004


def test_maps_sigmas_that_say_little_hide_no_change() -> None:
    found = compare_maps(place.mapped(BAYS, 1), place.mapped(place.moved_bar(BAYS, 3, 4, 0.02), 2))
    bar = place.mapped(BAYS, 1).rows["A"].structures["racks"][-1]
    assert np.sqrt(bar.covariances[:, 1, 1]).max() > 0.015
    assert states(found) == {"bay 4 / bar 5": "moved"}


def test_a_bay_added_at_the_left_moves_nothing() -> None:
    more = (place.Bay(2.4, (0.5, 1.9, 3.3), ""), *BAYS)
    found = compare_maps(place.mapped(BAYS, 1, (-0.15, 1.0)), place.mapped(more, 2))
    motion = found.rows[0].motion
    assert motion is not None
    assert motion.shift_m == pytest.approx([2.5, 0, 0], abs=0.05)
    assert not motion.ambiguous
    added = {"post 1": "new", "bay 1 / bar 1": "new", "bay 1 / bar 2": "new", "bay 1 / bar 3": "new"}
    assert states(found) == added


def test_a_bay_missing_at_the_left_is_missing() -> None:
    found = compare_maps(place.mapped(BAYS, 1), place.mapped(BAYS[1:], 2, (-0.15, 1.0)))
    assert {name for name, state in states(found).items() if state == "missing"} == {
        "post 1",
        "plate 1",
        *(f"bay 1 / bar {k}" for k in range(1, 6)),
    }
    assert set(states(found).values()) == {"missing"}


def test_alike_bays_do_not_slip_by_one() -> None:
    alike = tuple(place.Bay(2.7, (0.5, 1.7, 2.9, 4.1)) for _ in range(8))
    found = compare_maps(place.mapped(alike, 1), place.mapped(alike, 2))
    assert states(found) == {}
    assert found.rows[0].motion is not None
    assert not found.rows[0].motion.ambiguous


def test_two_shifts_that_fit_alike_are_told() -> None:
    alike = tuple(place.Bay(2.7, (0.5, 1.7, 2.9, 4.1)) for _ in range(9))
    old = place.mapped(alike[1:], 1, (-0.2, 1.2))
    found = compare_maps(old, place.mapped(alike, 2, (-0.2, 1.2)))
    motion = found.rows[0].motion
    assert motion is not None
    assert [round(abs(one), 1) for one in motion.alternatives_m] == [2.8]
    assert any("ambiguous" in line for line in comparison_lines(found))


def test_a_text_settles_which_shift_is_right() -> None:
    alike = tuple(place.Bay(2.7, (0.5, 1.7, 2.9, 4.1), f"B{k}" if k in (3, 6) else "") for k in range(9))
    found = compare_maps(place.mapped(alike[1:], 1, (-0.2, 1.2)), place.mapped(alike, 2, (-0.2, 1.2)))
    motion = found.rows[0].motion
    assert motion is not None
    assert not motion.ambiguous
    assert motion.shift_m[0] == pytest.approx(2.8, abs=0.05)


def test_frames_half_a_turn_apart_are_brought_together() -> None:
    new = place.half_turned(place.mapped(place.moved_bar(BAYS, 3, 2, 0.05), 2))
    found = compare_maps(place.mapped(BAYS, 1), new)
    motion = found.rows[0].motion
    assert motion is not None
    assert motion.heading_deg == pytest.approx(180, abs=0.5)
    assert states(found) == {"bay 4 / bar 3": "moved"}


def test_another_text_at_a_place_is_a_change() -> None:
    replaced = (*BAYS[:2], replace(BAYS[2], text="B77"), *BAYS[3:])
    found = compare_maps(place.mapped(BAYS, 1), place.mapped(replaced, 2))
    assert states(found) == {"plate 3": "changed"}
    text = change(found, "plate 3").significant[0]
    assert (text.what, text.old, text.new) == ("text", "A03", "B77")


def test_one_letter_of_a_doubtful_reading_is_none() -> None:
    misread = (*BAYS[:2], replace(BAYS[2], text="A08"), *BAYS[3:])
    assert states(compare_maps(place.mapped(BAYS, 1), place.mapped(misread, 2))) == {}


def test_what_the_camera_did_not_pass_is_not_seen() -> None:
    found = compare_maps(place.mapped(BAYS, 1), place.mapped(BAYS, 2, (0.0, 0.5)), level=0.01)
    told = states(found)
    assert set(told.values()) == {"not seen"}
    assert "bay 8 / bar 1" in told
    assert "bay 2 / bar 1" not in told
    assert not found.changed


def test_a_plugin_that_was_not_asked_has_seen_nothing() -> None:
    new = place.mapped(BAYS, 2)
    row = replace(new.rows["A"], structures={"racks": new.rows["A"].structures["racks"]})
    told = states(compare_maps(place.mapped(BAYS, 1), replace(new, rows={"A": row})))
    assert told == {f"plate {k}": "not seen" for k in range(1, 9)}


def test_rows_of_one_map_alone_are_missing_or_new() -> None:
    old, new = place.mapped(BAYS, 1, name="A"), place.mapped(BAYS, 2, name="B")
    found = compare_maps(old, new)
    assert (found.missing, found.new, found.rows) == (("A",), ("B",), ())
    assert found.changed
    assert found.renamed == (("A", "B"),)
    assert "row B looks like row A had looked: if it is that row, give it the same name in both site files" in list(
        comparison_lines(found)
    )
    elsewhere = place.mapped(tuple(place.Bay(1.1, (0.7, 1.1, 1.5)) for _ in range(4)), 2, name="B")
    assert compare_maps(old, elsewhere).renamed == ()
    lost = compare_maps(old, replace(new, failed={"A": "too dark"}))
    assert (lost.missing, lost.new, lost.failed) == ((), ("B",), ("A",))
    assert "row A: cannot be compared, for one of the runs could not map it" in list(comparison_lines(lost))
    assert unsaid_text(found) == "no row in common, and rows are known by their names"
    assert unsaid_text(lost) == "nothing is known of row A"


def test_rows_with_nothing_in_common_are_not_compared() -> None:
    other = tuple(place.Bay(1.1, (0.7, 1.1, 1.5)) for _ in range(2))
    found = compare_maps(place.mapped(BAYS, 1), place.mapped(other, 2))
    assert found.rows[0].motion is None
    assert found.rows[0].elements == ()
    assert not found.changed
    assert not found.compared
    assert found.unknown == ("A",)
    assert unsaid_text(found) == "nothing in common was found in row A"
    assert any("nothing in common" in line for line in comparison_lines(found))


def test_a_map_is_as_it_is() -> None:
    site = place.mapped(BAYS, 1)
    found = compare_maps(site, site)
    assert states(found) == {}
    assert not found.changed
    assert unsaid_text(found) == ""


def test_rows_of_nothing_are_compared_with_nothing() -> None:
    full = place.mapped(BAYS, 1)
    for structures in ({}, {"racks": ()}, {"racks": full.rows["A"].structures["racks"][:1]}):
        few = replace(full, rows={"A": replace(full.rows["A"], structures=structures)})
        for old, new in ((full, few), (few, full), (few, few)):
            assert compare_maps(old, new).rows[0].motion is None


def test_openings_are_compared_by_their_sizes_alone() -> None:
    old, new = place.mapped(BAYS, 1), place.mapped(place.moved_bar(BAYS, 3, 2, 0.05), 2)
    before, after = ({"A": {"racks": bars_of(site)}} for site in (old, new))
    assert [one.state for one in compare_maps(old, new, (before, after)).rows[0].openings] == ["same"] * 40


def edited(site: SiteMap, by_m: float, names: set[str]) -> SiteMap:
    """The very same map, in which some bars are higher."""
    racks = tuple(
        replace(one, vertices=one.vertices + by_m * np.array([0.0, one.id in names, 0.0]))
        for one in site.rows["A"].structures["racks"]
    )
    row = site.rows["A"]
    return replace(site, rows={"A": replace(row, structures={**row.structures, "racks": racks})})


@pytest.mark.parametrize("bars", [[3], [1, 2, 3, 4, 5]])
def test_what_was_moved_by_hand_in_a_copy_is_told(bars: list[int]) -> None:
    """All other elements are exactly where they were: that is no figure that all have in common."""
    site = place.mapped(BAYS, 1)
    names = {f"bay 4 / bar {bar}" for bar in bars}
    assert states(compare_maps(site, edited(site, 0.2, names))) == dict.fromkeys(names, "moved")


def test_json_says_all_and_lines_say_what_changed() -> None:
    found = compare_maps(place.mapped(BAYS, 1), place.mapped(place.moved_bar(BAYS, 3, 2, 0.05), 2))
    entry = json.loads(comparison_text(found))
    assert entry == as_json(found)
    moved = [one for one in entry["rows"][0]["elements"] if one["state"] in CHANGES]
    assert [one["new"] for one in moved] == ["bay 4 / bar 3"]
    assert [one["what"] for one in moved[0]["differences"] if one["significant"]] == ["y"]
    lines = list(comparison_lines(found))
    assert lines[0].startswith("row A: old frame moved by x ")
    assert lines[1].startswith("  scale of the new map against the old one's: x ")
    assert "bay 4 / bar 3  y +" in lines[2]
    assert lines[3] == "  1 moved, 56 same"


def leaning(site: SiteMap, leans: dict[str, float], by_m: dict[str, float] | None = None) -> SiteMap:
    """The map with leans of posts, mm in 1 m, and some posts pushed along the row."""
    row = site.rows["A"]
    racks = tuple(
        replace(
            part,
            attributes={**part.attributes, "lean_permille": Measured(leans.get(part.id, 0.5), 0.3)},
            vertices=part.vertices + np.array([(by_m or {}).get(part.id, 0.0), 0, 0]),
        )
        if part.label == "post"
        else part
        for part in row.structures["racks"]
    )
    return replace(site, rows={"A": replace(row, structures={**row.structures, "racks": racks})})


def test_posts_that_lean_or_stand_otherwise_were_hit() -> None:
    old, new = place.mapped(BAYS, 1), place.mapped(place.moved_bar(BAYS, 3, 2, 0.05), 2)
    found = compare_maps(leaning(old, {}), leaning(new, {"post 3": 6.0}, {"post 6": 0.03}))
    hits = {one.name: one.hit for one in found.rows[0].elements if one.hit is not None}
    assert hits.keys() == {"post 3", "post 6"}, "a bar that moved is no post"
    assert min(hits.values()) > 0.99
    assert [figure.what for figure in change(found, "post 3").significant] == ["lean_permille"]
    lines = "\n".join(comparison_lines(found))
    assert "stands or leans otherwise than before (100.0 % sure): lean +5.5 mm in 1 m (+- 0.4" in lines
    assert "\n  post: 2 of 9 stand or lean otherwise than before" in lines
    same = "\n".join(comparison_lines(compare_maps(old, place.mapped(BAYS, 2))))
    assert "\n  post: 0 of 9 stand or lean otherwise than before; how far they lean is not in both maps" in same
    entry = next(one for one in as_json(found)["rows"][0]["elements"] if one["new"] == "post 3")
    assert entry["hit"] > 0.99
    assert next(one for one in entry["differences"] if one["what"] == "lean_permille")["difference_permille"] == 5.5


def test_a_lean_that_only_one_map_has_says_nothing() -> None:
    found = compare_maps(place.mapped(BAYS, 1), leaning(place.mapped(BAYS, 2), {"post 3": 6.0}))
    assert all(one.hit is None for one in found.rows[0].elements)


def test_json_holds_no_raw_control_character() -> None:
    hostile = "A03\N{RIGHT-TO-LEFT OVERRIDE}\x9b31m"
    bays = (*BAYS[:2], replace(BAYS[2], text=hostile), *BAYS[3:])
    text = comparison_text(compare_maps(place.mapped(bays, 1), place.mapped(bays, 2)))
    assert "\u202e" not in text
    assert "\x9b" not in text
    assert hostile in [one["text"] for one in json.loads(text)["rows"][0]["elements"]]


def test_sigma_of_the_shift_is_that_of_the_origin() -> None:
    spread = np.diag([0.001, 0.001, 0.002, 0.1]) ** 2
    motion = RowMotion(np.array([-8.0, 0, 0.5]), 0.0, spread, np.zeros(3), np.array([2.0, 0, 0.5]), 9)
    rng = np.random.default_rng(1)
    drawn = rng.multivariate_normal(np.zeros(4), spread, 20000)
    turns = np.deg2rad(drawn[:, 3])
    z = motion.middle_m[2] + drawn[:, 2] + 10 * np.sin(turns)
    assert np.sqrt(motion.shift_covariance[2, 2]) == pytest.approx(z.std(), rel=0.03)
    assert "z +0.500 m (+- 18 mm)" in motion_text(motion)


def test_points_are_carried_as_the_elements_are() -> None:
    old, new = place.mapped(BAYS, 1), place.mapped(BAYS, 2)
    motion = compare_maps(old, new).rows[0].motion
    assert motion is not None
    before, after = (site.rows["A"].structures["racks"] for site in (old, new))
    off = [motion.points(a.vertices) - b.vertices for a, b in zip(before, after, strict=True) if a.label == "bar"]
    assert np.abs(np.array(off)[:, :, :2]).max() < 0.01


def test_benjamini_and_hochberg() -> None:
    assert accepted([0.01, 0.04, 0.03, 0.2], 0.05) == 0.01
    assert accepted([0.01, 0.02, 0.03, 0.2], 0.05) == 0.03
    assert accepted([0.2], 0.05) == -1.0
    assert accepted([], 0.05) == -1.0


def test_share_of_chance_is_the_level_from_which_on_a_figure_counts() -> None:
    ordered, shares = chance_shares([0.01, 0.04, 0.03, 0.2])
    assert ordered.tolist() == [0.01, 0.03, 0.04, 0.2, 1.0]
    assert shares[:4].tolist() == pytest.approx([0.04, 0.16 / 3, 0.16 / 3, 0.2])


def element(number: int, p: float, edges: tuple[float, ...], difference_m: float = 0.003) -> ElementChange:
    figure = Difference("y", 0.0, difference_m, p, difference_m, 0.001, edges=edges)
    name = f"bar {number}"
    return ElementChange("racks", "bar", "same", name, name, "", np.zeros(3), (figure,), p)


def test_equal_differences_of_other_edges_are_tests_of_their_own() -> None:
    row = [element(0, 0.02, (0.0, 0.1, 0.0, 0.1)), *(element(k, 0.9, (k, k + 0.1, k, k + 0.1)) for k in range(1, 10))]
    assert {one.state for one in with_states([row], 0.1)[0]} == {"same"}


def test_figures_of_the_same_edges_are_one_test() -> None:
    edges = 1.0, 3.7, 1.01, 3.7
    row = [element(k, p, edges) for k, p in enumerate((0.02, 0.02, 0.9, 0.9))]
    row += [element(4, 0.9, (1.0, 3.7, 1.01, 3.8))]
    assert [one.state for one in with_states([row], 0.05)[0]] == ["moved", "moved", "same", "same", "same"]


def test_independent_differences_are_all_counted() -> None:
    found = compare_maps(place.mapped(BAYS, 1), place.mapped(BAYS, 2)).rows[0]
    heights = [one.edges for bar in found.elements for one in bar.differences if one.what == "y"]
    assert len({tuple(np.round(edges, 5)) for edges in heights}) == len(heights) > 40
