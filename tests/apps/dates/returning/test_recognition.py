"""Where along which mapped row a pass is: right, or refused with what it could be."""

from dataclasses import replace

import mapped_place as place
import numpy as np
import pytest

from savmap.apps.dates.returning.recognition import SURE, likely_places, recognised
from savmap.errors import StructureError
from savmap.types import RowMap

BAYS = place.irregular()
OTHERS = tuple(replace(bay, heights=tuple(np.array(bay.heights)[[0, 2, 4]] - 0.1), text="") for bay in BAYS[::-1])
ALIKE = tuple(place.Bay(2.7, (0.5, 1.7, 2.9, 4.1)) for _ in range(8))
ROWS = {"A": place.mapped(BAYS, 1).rows["A"], "B": place.mapped(OTHERS, 2, name="B").rows["B"]}


def a_pass(bays: tuple[place.Bay, ...], seed: int = 7, scale: float = 0.37) -> RowMap:
    """A pass along bays, numbered from 1, in any scale."""
    return replace(place.scaled(place.mapped(bays, seed), scale).rows["A"], name="1")


def without_plates(row: RowMap) -> RowMap:
    return replace(row, structures={"racks": row.structures["racks"]})


@pytest.mark.parametrize(("first", "last"), [(2, 5), (0, 8), (5, 8)])
@pytest.mark.parametrize("scale", [0.37, 1.0, 2.2])
def test_a_part_of_a_row_is_recognised_in_any_scale(first: int, last: int, scale: float) -> None:
    seen = without_plates(a_pass(BAYS[first:last], scale=scale))
    found = recognised(seen, ROWS)
    assert found.row == "A"
    assert found.scale == pytest.approx(1 / scale, rel=0.005)
    assert found.shift_m == pytest.approx([2.8 * first, 0.0], abs=0.03)
    posts = {(ours, theirs) for _, ours, theirs in found.pairs if ours.startswith("post")}
    assert posts == {(f"post {k}", f"post {k + first}") for k in range(1, last - first + 2)}
    assert found.ends == f"A: post {first + 1} to post {last + 1}"


def test_moved_and_missing_bars_do_not_break_it() -> None:
    bays = place.moved_bar(BAYS[2:6], 1, 2, 0.12)
    bays = (replace(bays[0], heights=bays[0].heights[1:]), *bays[1:])
    found = recognised(without_plates(a_pass(bays)), ROWS)
    assert found.row == "A"
    assert found.shift_m[0] == pytest.approx(5.6, abs=0.03)


def test_bays_that_look_alike_are_refused_with_the_candidates() -> None:
    rows = {"A": place.mapped(ALIKE, 1).rows["A"]}
    seen = a_pass(ALIKE[:3])
    with pytest.raises(
        StructureError, match="looks alike at several places of the earlier map: row A: post"
    ) as refusal:
        recognised(seen, rows)
    assert "name the row with --row" in str(refusal.value)
    assert "\n" not in str(refusal.value)
    probabilities = [probability for _, probability in likely_places(seen, rows)]
    assert sum(probability > 1e-3 for probability in probabilities) >= 6
    assert max(probabilities) <= SURE
    assert sum(probabilities) == pytest.approx(1.0, abs=1e-3)


def test_a_text_tells_bays_that_look_alike() -> None:
    bays = tuple(replace(bay, text=f"B{k}") for k, bay in enumerate(ALIKE))
    found = recognised(a_pass(bays[3:6]), {"A": place.mapped(bays, 1).rows["A"]})
    assert found.shift_m[0] == pytest.approx(3 * 2.8, abs=0.03)


def test_a_bay_that_is_unlike_the_others_tells_them() -> None:
    bays = (*ALIKE[:4], place.Bay(2.2, (0.9, 2.0, 3.4)), *ALIKE[4:])
    found = recognised(a_pass(bays[2:6]), {"A": place.mapped(bays, 1).rows["A"]})
    assert found.shift_m[0] == pytest.approx(2 * 2.8, abs=0.03)


def test_a_row_may_go_on_beyond_its_map() -> None:
    rows = {"A": place.mapped(BAYS[:6], 1, (-0.05, 1.05)).rows["A"]}
    found = recognised(without_plates(a_pass(BAYS[3:])), rows)
    assert found.shift_m[0] == pytest.approx(3 * 2.8, abs=0.03)
    rows = {"A": place.mapped(ALIKE[:5], 1).rows["A"]}  # the camera went no further: nobody knows where the row ends
    with pytest.raises(StructureError, match="looks alike at several places"):
        recognised(a_pass(ALIKE[2:7]), rows)


def test_a_row_whose_ends_the_camera_went_past_is_whole() -> None:
    rows = {"A": place.mapped(ALIKE, 1, (-0.05, 1.05)).rows["A"]}
    found = recognised(a_pass(ALIKE), rows)
    assert found.shift_m[0] == pytest.approx(0.0, abs=0.03)


def test_another_place_is_of_no_row() -> None:
    with pytest.raises(StructureError, match="does not look like any row of the earlier map"):
        recognised(without_plates(a_pass(BAYS[2:6])), {"B": ROWS["B"], "C": place.mapped(ALIKE, 3).rows["A"]})
    with pytest.raises(StructureError, match="does not look like row B; check that it is of the same place"):
        recognised(without_plates(a_pass(BAYS[2:6])), {"B": ROWS["B"]})


def test_a_pass_that_shows_nothing_is_of_no_row() -> None:
    seen = replace(a_pass(BAYS[:2]), structures={"racks": ()})
    assert likely_places(seen, ROWS) == []
