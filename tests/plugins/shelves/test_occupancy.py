"""What is in slots, by made-up depths: goods, nothing, or nobody knows; and the truth of simulated ones."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from perfect_maps import structures_of, surveyed_row

from savmap.plugin.manager import open_plugin
from savmap.types import FaceDepths, Measured, Structure
from savmap_shelves.inspection.occupancy import LEAST_HEIGHT_M, fitted, occupancies_of, occupancy_of, over_edge
from savmap_shelves.lab.slots import example_of, fit, true_slots

CELL, DEPTHS = 0.025, np.array([-0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 0.9, 1.2])
EYE_M, AWAY_M = 1.0, 2.0
LEFT, RIGHT, DECK, CEILING = 0.1, 2.6, 0.5, 1.6
SEEN, NOISE = 0.9, 0.1
Goods = tuple[float, float, float, float]
"""From where to where along the row, the top, and the front's depth, m."""


def slot(high: float = CEILING) -> Structure:
    corners = np.array([[LEFT, DECK, 0.0], [RIGHT, DECK, 0], [RIGHT, high, 0], [LEFT, high, 0]])
    sizes = {"clear_width_m": Measured(RIGHT - LEFT, 0.002), "clear_height_m": Measured(high - DECK, 0.002)}
    attributes: dict[str, Any] = {"bay": 1, "level": 1, **sizes}
    ring = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    return Structure("bay 1 / level 1", "level", corners, np.zeros((4, 3, 3)), tuple("abcd"), ring, attributes)


def depths_of(*goods: Goods, seen: bool = True) -> FaceDepths:
    """What a camera in front of each cell shows: goods where they are, else what is behind the rack."""
    rows, columns = int(2.0 / CELL), int(2.8 / CELL)
    x, y = (np.arange(columns) + 0.5) * CELL, (np.arange(rows)[::-1] + 0.5) * CELL
    scores = np.full((len(DEPTHS), rows, columns), NOISE, np.float32)
    scores[-1] = SEEN
    for left, right, top, front in goods:
        number = int(np.abs(DEPTHS - front).argmin())
        heights = y + (y - EYE_M) * front / AWAY_M
        shown = ((heights > DECK) & (heights < top))[:, None] & (x > left) & (x < right)
        scores[:, shown] = NOISE
        scores[number, shown] = SEEN
    cameras = np.stack(np.broadcast_arrays(x[None], np.full((rows, 1), EYE_M), np.array([[AWAY_M]])), axis=-1)
    return FaceDepths(
        np.zeros(3), np.eye(3)[0], np.eye(3)[1], CELL, DEPTHS, scores, cameras if seen else np.nan * cameras
    )


def test_goods_are_found_with_the_space_that_they_leave() -> None:
    occupancy = occupancy_of(slot(), depths_of((0.3, 1.1, 1.2, 0.1)), fitted())
    assert occupancy is not None
    assert (occupancy.state, occupancy.probability > 0.99) == ("occupied", True)
    assert occupancy.free_width is not None
    assert occupancy.free_width.value == pytest.approx(RIGHT - 1.1, abs=0.1)
    assert occupancy.free_height is not None
    assert abs(occupancy.free_height.value - 0.4) < 3 * occupancy.free_height.sigma < 0.5
    assert occupancy.over_edge < 0.05


def test_a_slot_that_is_seen_through_is_empty() -> None:
    occupancy = occupancy_of(slot(), depths_of(), fitted())
    assert occupancy is not None
    assert occupancy.state == "empty"
    assert occupancy.free_width == Measured(RIGHT - LEFT, 0.002)
    assert occupancy.free_height == Measured(CEILING - DECK, 0.002)


def test_what_no_frame_shows_is_unknown() -> None:
    occupancy = occupancy_of(slot(), depths_of(seen=False), fitted())
    assert occupancy is not None
    assert (occupancy.state, occupancy.free_width, occupancy.free_height) == ("unknown", None, None)


def test_goods_before_the_face_are_over_the_edge() -> None:
    (finding,) = over_edge(occupancies_of([slot()], depths_of((0.3, 1.1, 1.2, -0.1))))
    assert (finding.code, finding.grade, finding.subjects) == ("goods-over-edge", "amber", ("bay 1 / level 1",))
    (green,) = over_edge(occupancies_of([slot()], depths_of((0.3, 1.1, 1.2, 0.2))))
    assert (green.grade, green.action) == ("green", "")


def test_low_openings_are_no_slots() -> None:
    assert occupancies_of([slot(DECK + LEAST_HEIGHT_M - 0.01)], depths_of()) == []


def test_inspection_has_a_table_of_slots() -> None:
    plugin = open_plugin("shelves", {})
    parts = structures_of(surveyed_row())
    places = {"shelves": plugin.places(parts, None)}
    limits = plugin.limits({}, "limits")
    tables: Mapping[str, Any] = {
        table.name: table for table in plugin.inspect(parts, places, None, limits, None, {}, depths_of()).tables
    }
    columns = tables["slots"].columns
    assert columns[:4] == ("bay", "level", "state", "probability_occupied")
    assert {line[2] for line in tables["slots"].lines} <= {"empty", "occupied", "unknown"}
    assert "slots" in plugin.inspect(parts, places, None, limits, None, {}, None).unchecked[-1]


def box(left: float, right: float, top: float, front: float) -> list[list[float]]:
    return [[left, DECK, -front - 0.5], [right, top, -front]]


def test_true_slots_hold_what_stands_in_them() -> None:
    goods = np.array([box(0.3, 1.1, 1.2, 0.1), box(1.3, 1.6, 0.8, -0.05), box(3.0, 3.5, 1.2, 0.1)])
    (true,) = true_slots([slot()], goods)
    assert (len(true.goods), true.is_occupied, true.is_over_edge) == (2, True, True)
    assert true.free_width_m == pytest.approx(RIGHT - 1.6)
    assert true.top_m == pytest.approx(0.7)
    (empty,) = true_slots([slot()], np.zeros((0, 2, 3)))
    assert (empty.is_occupied, empty.free_width_m) == (False, pytest.approx(RIGHT - LEFT))


def test_parameters_are_counted_where_goods_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    (full,) = true_slots([slot()], np.array([box(0.3, 1.1, 1.2, 0.1)]))
    (empty,) = true_slots([slot()], np.zeros((0, 2, 3)))
    examples = [example_of(full, depths_of((0.3, 1.1, 1.2, 0.1))), example_of(empty, depths_of())]
    assert all(examples)
    counted = [example for example in examples if example is not None]
    front, edge, clear = counted[0].counts
    assert front.argmax() == front.size - 1, "agreement there, none behind"
    assert edge[-1, -1] == edge[-1, 0] > 0, "the cells on either side of it"
    assert clear.argmax() == front.size - front.shape[1]
    assert counted[1].counts[:2].sum() == 0
    monkeypatch.setattr("savmap_shelves.lab.slots.EVALUATIONS", 6)
    assert fit(counted).front[-1, -1] > 2
