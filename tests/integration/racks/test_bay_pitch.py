"""The pitch of the bays as a reference: it gives the scale alone, is reported bay by bay, and is contradicted aloud."""

import made_up_rack as made
import numpy as np
import pytest

from savmap.errors import SiteError
from savmap.graph import References, Solution, camera_priors, merge, solve
from savmap_shelves.constraints import GridSettings, constrain
from savmap_shelves.constraints.constrain import assignments, section_references
from savmap_shelves.constraints.track_grid import TrackGrid
from savmap_shelves.settings import ShelvesSettings


@pytest.fixture(scope="module")
def small() -> made.World:
    return made.world(6, sections=3, frames=40, bridge=None)


def pitches(world: made.World) -> list[float]:
    return np.diff(world.rack.uprights[:, 0]).tolist()


def solved(world: made.World, pitch: list[float], given: References, heights: bool = True) -> Solution:
    start = made.begin(world)
    settings = GridSettings(world.rack.lowest if heights else None, bay_pitch_m=pitch, bay_pitch_sigma_m=0.003)
    return solve(
        merge(camera_priors(world.facts, start, given), constrain(world.tracks, world.facts, start, settings=settings))
    )


def test_pitches_alone_give_the_scale_and_are_reported(small: made.World) -> None:
    """A camera height alone gives the place along y, but no scale (see test_references)."""
    solution = solved(small, pitches(small), made.references(small, camera=True, length=False), heights=False)
    x, y, _, _ = made.errors(small, solution)
    assert np.abs(x).max() < 0.015
    assert np.abs(y).max() < 0.03
    used = {use.name: use for use in solution.references}
    assert used["bay pitch of bay 3"].solved == pytest.approx(pitches(small)[2], abs=0.005)
    assert not solution.notes


def test_a_wrong_pitch_is_named(small: made.World) -> None:
    first, second, third = pitches(small)
    warnings = " ".join(solved(small, [first, second + 0.04, third], made.references(small)).notes)
    assert f"bay pitch of bay 2 is given as {second + 0.04:.3f} m" in warnings


def test_one_value_goes_for_all_sections_of_a_row_seen_in_part() -> None:
    ways = assignments({"height": (0.1, 0.2, 0.3), "pitch": 2.7}, (1, 2), "A")
    assert list(ways) == ["bays 1 to 2 of 3", "bays 2 to 3 of 3"]
    assert list(ways.values()) == [
        {"height": {1: 0.1, 2: 0.2}, "pitch": {1: 2.7, 2: 2.7}},
        {"height": {1: 0.2, 2: 0.3}, "pitch": {1: 2.7, 2: 2.7}},
    ]


@pytest.mark.parametrize("heights", [(0.1, None, 0.3, 0.4), (0.1, 0.3, 0.4)])
def test_a_section_without_beams_counts_where_the_list_says_so(heights: tuple[float | None, ...]) -> None:
    """Bay 2 is a passage: the list has null for it, or leaves it out."""
    [given] = assignments({"height": heights}, (1, 3, 4), "A").values()
    assert given == {"height": {1: 0.1, 3: 0.3, 4: 0.4}}


def test_a_row_with_a_passage_that_was_seen_in_part() -> None:
    ways = assignments({"height": (0.1, None, 0.3, 0.4)}, (1, 3), "A")
    assert ways["bays 1 to 3 of 4"] == {"height": {1: 0.1, 3: 0.3}}
    assert ways["bays 2 to 4 of 4"] == {"height": {3: 0.4}}


def test_a_list_with_fewer_values_than_bays_is_refused() -> None:
    with pytest.raises(SiteError, match="pitch gives 1 values, but 2 bays"):
        assignments({"pitch": (2.7,)}, (1, 2), "A")


def test_lists_of_different_lengths_are_refused() -> None:
    given = {"lowest_beam_bottom_height_m": {"values": [0.1, 0.2]}, "bay_pitch_m": {"value": [2.7, 2.7, 2.7]}}
    with pytest.raises(ValueError, match="have one value a bay, not 2 and 3"):
        ShelvesSettings.model_validate(given)


def test_a_list_that_is_too_short_for_a_row_with_a_passage_is_told_of_null() -> None:
    told = r"gives 2 values, but 4 bays were found, 1 of them without beams \(write `null`"
    with pytest.raises(SiteError, match=told):
        assignments({"height": (0.1, 0.3)}, (1, 3, 4), "A")


def test_the_height_of_a_lowest_edge_that_was_not_seen_is_not_laid_on_the_next(
    caplog: pytest.LogCaptureFixture,
) -> None:
    rows = {(1, 1, "upper"): ("a",), (1, 2, "lower"): ("b",), (2, 1, "lower"): ("c",), (2, 1, "upper"): ("d",)}
    grid = TrackGrid({}, rows)
    [relations] = section_references(grid, {"b": 1, "c": 2}, GridSettings((0.2, 0.3)), "A").values()
    assert [(relation.a, relation.value) for relation in relations] == [(2, 0.3)]
    assert caplog.messages == ["row A: bay 1: the lowest beam's lower edge was not seen; its height is not used"]


def test_bays_that_the_map_counts_otherwise_have_the_number_of_the_list_too() -> None:
    rows = {(section, 1, "lower"): (f"{section}",) for section in (1, 3)}
    grid, keys = TrackGrid({}, rows), {"1": 1, "3": 3}
    first, second = section_references(grid, keys, GridSettings((0.2, 0.9, 0.3, 0.4)), "A").values()
    name = "height of the lowest edge of bay"
    assert [relation.name for relation in first] == [f"{name} 1", f"{name} 3"]
    assert [relation.name for relation in second] == [f"{name} 1 (value 2 of 4)", f"{name} 3 (value 4 of 4)"]
    assert second[0].note_if_outlier.startswith("bay 1 (value 2 of 4): the lowest beam at 0.900 m was not seen")
    [without] = section_references(grid, keys, GridSettings((0.2, 0.3)), "A").values()
    assert [relation.name for relation in without] == [f"{name} 1", f"{name} 3 (value 2 of 2)"]
    [for_all] = section_references(grid, keys, GridSettings(0.2), "A").values()
    assert [relation.name for relation in for_all] == [f"{name} 1", f"{name} 3"]
