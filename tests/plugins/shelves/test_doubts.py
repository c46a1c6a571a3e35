"""What of a mapped rack is implausible, and that irregular racks are not."""

from typing import Any

import numpy as np
import pytest

from savmap.types import Floats
from savmap_shelves.doubts import doubts_of
from savmap_shelves.evidence.wide_steps import wide_steps

from .perfect_maps import Row, structures_of, surveyed_row


def regular_row() -> Row:
    """Six bays of 2.7 m, four levels each."""
    levels = [[0.2, 0.3], [1.2, 1.3], [2.2, 2.3], [3.2, 3.3]]
    return {
        "uprights": [[2.7 * k, 2.7 * k + 0.1] for k in range(7)],
        "sections": [{"beams": [list(level) for level in levels]} for _ in range(6)],
    }


@pytest.mark.parametrize("row", [surveyed_row(), regular_row()])
def test_a_right_map_is_plausible(row: Row) -> None:
    assert doubts_of(structures_of(row)) == []


def scaled(row: Row, times: float) -> Row:
    """The row, so many times as large."""
    return {
        "uprights": [[times * x for x in upright] for upright in row["uprights"]],
        "sections": [
            {"beams": [[times * y for y in beam] for beam in section["beams"]]} for section in row["sections"]
        ],
    }


@pytest.mark.parametrize("times", [1 / 0.3048, 0.1])
def test_sizes_that_no_rack_has_are_doubted(times: float) -> None:
    (found,) = doubts_of(structures_of(scaled(regular_row(), times)))
    assert found.line.startswith("no rack has such sizes: ")
    assert found.action == "check that all references are in metres"


@pytest.mark.parametrize("times", [0.5, 2.0])
def test_light_and_heavy_racks_are_plausible(times: float) -> None:
    assert doubts_of(structures_of(scaled(regular_row(), times))) == []


def lacking_uprights(row: Row) -> None:
    del row["uprights"][2:4]
    del row["sections"][2:4]


def with_half_a_bay(row: Row) -> None:
    row["uprights"].insert(3, [5.9, 6.0])
    row["sections"].insert(3, {"beams": row["sections"][2]["beams"]})


def with_a_thick_beam(row: Row) -> None:
    row["sections"][1]["beams"][2] = [2.2, 2.47]


def with_a_thin_beam(row: Row) -> None:
    row["sections"][1]["beams"][2] = [2.26, 2.3]


def with_an_edge_of_something_else(row: Row) -> None:
    row["sections"][1]["beams"][2] = [2.2, 2.33]


def with_a_level_more(row: Row) -> None:
    row["sections"][4]["beams"].insert(2, [1.7, 1.8])


def with_a_level_less(row: Row) -> None:
    del row["sections"][2]["beams"][1]


@pytest.mark.parametrize(
    ("spoil", "says", "about"),
    [
        (
            lacking_uprights,
            "8.10 m apart, others 2.70 m; look for one between: upright 2 and upright 3",
            ("upright 2", "upright 3"),
        ),
        (
            with_half_a_bay,
            "0.50 m apart, others 2.70 m; look whether both are uprights: upright 3 and upright 4",
            ("upright 3", "upright 4"),
        ),
        (
            with_a_thick_beam,
            "27.0 cm high, others 10.0 cm; look whether it is right: bay 2 / beam 3",
            ("bay 2 / beam 3",),
        ),
        (
            with_a_thin_beam,
            "4.0 cm high, others 10.0 cm; look whether it is right: bay 2 / beam 3",
            ("bay 2 / beam 3",),
        ),
        (
            with_an_edge_of_something_else,
            "13.0 cm high, others 10.0 cm; look whether an edge is something else's: bay 2 / beam 3",
            ("bay 2 / beam 3",),
        ),
        (with_a_level_more, "no bay beside has such a beam: 1.75 m", ("bay 5 / beam 3",)),
        (with_a_level_less, "a beam is missing that bays beside have: 1.25 m", ("bay 3 / beam 1",)),
    ],
)
def test_what_is_odd_is_named(spoil: Any, says: str, about: tuple[str, ...]) -> None:
    row = regular_row()
    spoil(row)
    found = doubts_of(structures_of(row))
    assert [doubt.kind for doubt in found] == ["shape"] * len(found)
    assert [doubt.structures for doubt in found if says in doubt.line] == [about]


def test_a_gap_between_two_racks_is_no_odd_bay() -> None:
    """As `with_half_a_bay`, without beams in it: two racks stand end to end."""
    row = regular_row()
    with_half_a_bay(row)
    row["sections"][3 if row["uprights"][4][0] - row["uprights"][3][0] < 1 else 2]["beams"] = []
    assert not [doubt for doubt in doubts_of(structures_of(row)) if "two uprights are close together" in doubt.line]


@pytest.mark.parametrize(("posts", "doubted"), [(0.06, False), (0.1, True)])
def test_a_lighter_rack_in_the_row_has_beams_of_its_own(posts: float, doubted: bool) -> None:
    """Thin beams between posts like the others' are doubted: something else may have been taken for all of them."""
    row = regular_row()
    row["uprights"][5:] = [[x, x + posts] for x, _ in row["uprights"][5:]]
    row["uprights"].insert(5, [row["uprights"][4][1] + 0.4, row["uprights"][4][1] + 0.4 + posts])
    thin = [[low, low + 0.05] for low, _ in row["sections"][5]["beams"]]
    row["sections"][4:] = [{"beams": []}, {"beams": thin}, {"beams": thin}]
    found = [doubt.line for doubt in doubts_of(structures_of(row))]
    assert any("5.0 cm high" in what for what in found) == doubted


def uneven_row() -> Row:
    """Five bays whose levels stand at other heights in each, an equal step apart."""
    row: Row = {"uprights": [[2.7 * k, 2.7 * k + 0.1] for k in range(6)], "sections": []}
    for k in range(5):
        levels = 0.2 + (0.8 + 0.13 * k) * np.arange(6)
        row["sections"].append({"beams": [[level, level + 0.1] for level in levels.tolist()]})
    return row


@pytest.mark.parametrize(("others", "doubted"), [(0.0, True), (0.9, False)], ids=["much the same", "other heights"])
def test_room_for_one_more_beam_below_the_others_highest_is_doubted(others: float, doubted: bool) -> None:
    row: Row = {"uprights": [[2.7 * k, 2.7 * k + 0.1] for k in range(4)], "sections": []}
    for foot, step, count in ((0.2, 1.0, 6), (0.3, 1.2, 4), (0.25, 1.25 - others / 4, 5)):
        levels = (foot + step * np.arange(count)).tolist()
        row["sections"].append({"beams": [[level, level + 0.1] for level in levels]})
    found = [doubt for doubt in doubts_of(structures_of(row)) if "a highest beam may be missing" in doubt.line]
    assert [doubt.structures for doubt in found] == ([("bay 2 / beam 4",)] if doubted else [])


@pytest.mark.parametrize("section", [0, 2, 4])
def test_a_step_twice_as_high_as_the_others_of_its_section_may_hide_a_beam(section: int) -> None:
    row = uneven_row()
    assert doubts_of(structures_of(row)) == []
    del row["sections"][section]["beams"][2]
    (doubt,) = doubts_of(structures_of(row))
    assert "a beam may be missing between others" in doubt.line
    assert doubt.structures == (f"bay {section + 1} / beam 2", f"bay {section + 1} / beam 3")
    # So is a passage, which the next bay has too.
    level = 0.2 + (0.8 + 0.13 * section) * 2
    beside = row["sections"][section - 1 if section else 1]["beams"]
    beside[:] = [beam for beam in beside if abs(beam[0] - level) > 1.0]
    assert not [doubt for doubt in doubts_of(structures_of(row)) if f"bay {section + 1} / beam 2" in doubt.structures]


@pytest.mark.parametrize("section", [0, 2, 4])
def test_a_lowest_beam_that_something_hides_in_all_frames_is_missed(section: int) -> None:
    """A parked truck hid one, and the row was trusted: what was never measured has nothing to be doubted by."""
    row = uneven_row()
    del row["sections"][section]["beams"][0]
    (doubt,) = doubts_of(structures_of(row))
    assert "a lowest beam may be hidden" in doubt.line
    assert doubt.structures == (f"bay {section + 1} / beam 1",)
    assert doubts_of(structures_of(row), lowest_known=True) == []


@pytest.mark.parametrize(
    ("room", "told"), [(0.02, True), (-0.03, True), (0.3, False)], ids=["near", "overlapping", "apart"]
)
def test_a_beam_right_above_another_may_be_none(room: float, told: bool) -> None:
    """What stood on a beam was taken for another, and the row was trusted."""
    row = uneven_row()
    low, high = row["sections"][1]["beams"][1]
    row["sections"][1]["beams"].insert(2, [high + room, high + room + high - low])
    near = [doubt.structures for doubt in doubts_of(structures_of(row)) if "two beams adjoin" in doubt.line]
    assert near == ([("bay 2 / beam 2", "bay 2 / beam 3")] if told else [])


def test_a_passage_hides_no_beam() -> None:
    row = uneven_row()
    row["sections"][2]["beams"][:2] = []
    assert doubts_of(structures_of(row)) == []


def test_steps_that_differ_anyway_hide_nothing() -> None:
    row = uneven_row()
    for beam in row["sections"][2]["beams"][4:]:
        beam[:] = [beam[0] + 0.6, beam[1] + 0.6]
    del row["sections"][2]["beams"][1]
    assert doubts_of(structures_of(row)) == []


def test_a_section_of_thicker_beams_is_no_error() -> None:
    row = regular_row()
    for beam in row["sections"][3]["beams"]:
        beam[1] += 0.05
    assert doubts_of(structures_of(row)) == []


def test_nothing_mapped_is_not_doubted() -> None:
    assert doubts_of([]) == []


def aslant_row(camera: float, depth: float, distance: float, height: float = 0.1) -> Row:
    """Three bays whose beams' undersides or tops, `depth` m deep, are taken for their faces, seen from a camera at a height and distance."""
    levels = [[0.35, 1.5, 2.6, 3.7], [0.33, 1.4, 2.7, 3.8], [0.36, 1.6, 2.5, 3.6]]

    def seen(bottom: float) -> list[float]:
        low, high = bottom, bottom + height
        return [low - max(low - camera, 0) * depth / distance, high + max(camera - high, 0) * depth / distance]

    return {
        "uprights": [[2.8 * k, 2.8 * k + 0.1] for k in range(4)],
        "sections": [{"beams": [seen(bottom) for bottom in own]} for own in levels],
    }


def test_beams_that_grow_away_from_the_cameras_height_are_doubted() -> None:
    found = [
        doubt for doubt in doubts_of(structures_of(aslant_row(1.9, 0.05, 2.2))) if "beams seem higher" in doubt.line
    ]
    (doubt,) = found
    assert doubt.details[0].endswith("from 1.9 m above the floor: 9.9 cm there, bay 2 / beam 4 14.3 cm")
    assert "bay 2 / beam 4" in doubt.structures
    assert "bay 3 / beam 2" not in doubt.structures


@pytest.mark.parametrize("depth", [0.0, 0.004])
def test_beams_of_one_height_are_not_doubted(depth: float) -> None:
    assert not [d for d in doubts_of(structures_of(aslant_row(1.9, depth, 2.2))) if "beams seem higher" in d.line]


def test_heavier_lowest_beams_are_not_taken_for_sides() -> None:
    row = regular_row()
    for section in row["sections"]:
        section["beams"][0][1] += 0.04
    assert not [doubt for doubt in doubts_of(structures_of(row)) if "beams seem higher" in doubt.line]


EVEN = np.array([0.1, 1.1, 2.1, 3.1, 4.1, 5.1])
ONE_HIDDEN = np.delete(EVEN, 1)
PASSAGE = np.array([3.1, 4.1, 5.1])


@pytest.mark.parametrize(
    ("sections", "found"),
    [
        ([EVEN, ONE_HIDDEN, EVEN], [(1, 0, 1.0)]),
        ([EVEN, PASSAGE, ONE_HIDDEN], [(2, 0, 1.0)]),
        ([PASSAGE, ONE_HIDDEN, PASSAGE], []),
        ([ONE_HIDDEN, PASSAGE, ONE_HIDDEN], []),
    ],
    ids=["beside", "beyond a passage", "nothing to compare with", "every bay has it"],
)
def test_a_step_too_wide_for_its_section_may_hide_a_beam(
    sections: list[Floats], found: list[tuple[int, int, float]]
) -> None:
    assert [(number, lower, pytest.approx(usual)) for number, lower, usual in wide_steps(sections)] == found
