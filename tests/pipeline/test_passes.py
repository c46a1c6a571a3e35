"""Passes along one face are laid on one another by what is found in each."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from savmap.pipeline.passes import LARGEST_RATIO, laid_on, moved
from savmap.types import Floats, FoundObject, Trajectory

UPRIGHTS = (0.0, 2.7, 4.6, 8.2, 11.0, 13.2)
BEAMS = (0.4, 1.6, 2.9)


def upright(x: float, probability: float = 1.0) -> FoundObject:
    corners = np.array([[x, 0.0, 0.0], [x + 0.1, 0.0, 0.0], [x + 0.1, 4.0, 0.0], [x, 4.0, 0.0]])
    return FoundObject(f"upright at {x}", "upright", corners, probability)


def beam(x: float, end: float, y: float) -> FoundObject:
    corners = np.array([[x, y, 0.0], [end, y, 0.0], [end, y + 0.1, 0.0], [x, y + 0.1, 0.0]])
    return FoundObject(f"beam at {x}, {y}", "beam", corners, 1.0)


def rack(first: int = 0, last: int = len(UPRIGHTS)) -> list[FoundObject]:
    """Some uprights of a row, and the beams between them, each bay's at heights of its own."""
    uprights = UPRIGHTS[first:last]
    bays = enumerate(pairwise(uprights), first)
    return [
        *map(upright, uprights),
        *(beam(x, end, y + 0.2 * (number % 3)) for number, (x, end) in bays for y in BEAMS),
    ]


def seen(objects: list[FoundObject], scale: float, shift: Floats) -> list[FoundObject]:
    """Objects as a pass finds them that has another zero and another scale: x' = scale x + shift lays them back."""
    return [
        FoundObject(f"{number}", item.label, (item.outline - [*shift, 0.0]) / scale, item.probability)
        for number, item in enumerate(objects)
    ]


@pytest.mark.parametrize(
    ("scale", "shift"), [(1.0, (0.0, 0.0)), (1.3, (4.0, -0.5)), (0.7, (-9.0, 0.8)), (2.2, (1.0, 0.1))]
)
def test_a_pass_is_laid_on_another_by_a_similarity(scale: float, shift: tuple[float, float]) -> None:
    """One of the objects is missing in either, and one is seen that is not there."""
    mine, others = rack(), rack()
    del mine[1], mine[8]
    del others[3], others[12]
    others += [upright(6.9), beam(8.2, 11.0, 2.2)]
    laid = laid_on(mine, seen(others, scale, np.array(shift)))
    assert laid is not None
    assert laid.scale == pytest.approx(scale, rel=1e-6)
    assert laid.shift == pytest.approx(np.array(shift), abs=1e-6)


def test_places_are_a_little_off_in_each_pass() -> None:
    rng = np.random.default_rng(3)
    shaken = [replace(item, outline=item.outline + np.append(rng.normal(0.0, 0.01, 2), 0.0)) for item in rack()]
    laid = laid_on(rack(), seen(shaken, 1.3, np.array([4.0, -0.5])))
    assert laid is not None
    assert laid.scale == pytest.approx(1.3, rel=0.02)
    assert laid.shift == pytest.approx(np.array([4.0, -0.5]), abs=0.1)


def test_passes_of_parts_of_a_row_are_laid_where_they_overlap() -> None:
    laid = laid_on(rack(last=5), seen(rack(first=2), 1.3, np.array([4.0, -0.5])))
    assert laid is not None
    assert (laid.scale, *laid.shift) == pytest.approx((1.3, 4.0, -0.5))


def test_uprights_alone_tell_no_rise() -> None:
    laid = laid_on([*map(upright, UPRIGHTS)], seen([*map(upright, UPRIGHTS[1:])], 1.3, np.array([4.0, -0.5])))
    assert laid is not None
    assert (laid.scale, *laid.shift) == pytest.approx((1.3, 4.0, 0.0))


def test_passes_with_too_little_in_common_are_not_laid() -> None:
    """One upright, none, or such as would make one pass many times as far away as the other."""
    assert laid_on(rack(), seen(rack(2, 3), 1.0, np.zeros(2))) is None
    assert laid_on(rack(), []) is None
    assert laid_on([], rack()) is None
    assert laid_on(rack(0, 2), seen(rack(0, 2), 1.1 * LARGEST_RATIO, np.zeros(2))) is None


def test_two_uprights_at_one_place_count_once() -> None:
    """One stands on the other."""
    laid = laid_on(rack(), seen([*rack(), upright(UPRIGHTS[2])], 1.3, np.array([4.0, -0.5])))
    assert laid is not None
    assert (laid.scale, *laid.shift) == pytest.approx((1.3, 4.0, -0.5))


def test_what_may_not_be_there_is_not_laid_on_anything() -> None:
    unsure = [upright(x, 0.4) for x in UPRIGHTS]
    assert laid_on(rack(), unsure) is None
    assert laid_on([*unsure, upright(1.0), upright(2.0)], rack(0, 1)) is None


def test_a_path_moves_as_what_is_seen_from_it() -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = [[1.0, 0.5, 1.5], [2.0, 0.5, 1.5], [3.0, 0.5, 1.6]]
    laid = laid_on(rack(), seen(rack(), 1.3, np.array([4.0, -0.5])))
    assert laid is not None
    path = moved(Trajectory(np.array([7, 8, 9]), poses), laid)
    assert path.frames.tolist() == [7, 8, 9]
    expected = 1.3 * poses[:, :3, 3] + [4.0, -0.5, 0.0]
    assert path.world_from_rig[:, :3, 3] == pytest.approx(expected)
    assert np.array_equal(path.world_from_rig[:, :3, :3], poses[:, :3, :3])
