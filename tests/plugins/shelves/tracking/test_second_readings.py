"""Second readings of beams' edges: accepted where all frames put them where the row's profile has them, and nowhere else."""

import numpy as np
import pytest
from savmap_shelves.evidence.second_readings import AcceptedReadings, accepted_readings

from savmap.types import Floats, Ints

FRAMES, HEIGHT = 20, 0.1
BOTTOMS = (0.0, 1.0, 2.0, 3.0, 4.0)
ODD = 2


def sighted(upper_of_odd: Floats) -> tuple[Ints, Floats]:
    """The levels and heights of sightings of five beams in twenty frames, of which one's upper edge is read elsewhere."""
    which = np.tile(np.arange(len(BOTTOMS)), FRAMES)
    first = np.array([[BOTTOMS[k], BOTTOMS[k] + HEIGHT] for k in which])
    first[which == ODD, 1] = BOTTOMS[ODD] + upper_of_odd
    return which, first


def accepted_of(upper_of_odd: Floats, second: Floats) -> AcceptedReadings:
    """The accepted readings where the odd beam's upper edge has second readings (20,) above its lower one."""
    which, first = sighted(upper_of_odd)
    again = np.full(first.shape, np.nan)
    again[which == ODD, 1] = BOTTOMS[ODD] + second
    return accepted_readings(np.zeros(len(BOTTOMS), np.int64), which, first, again)


def test_an_edge_that_goods_hide_is_read_between_them() -> None:
    second = np.full(FRAMES, np.nan)
    second[:6] = HEIGHT + np.array([0.0, 0.001, -0.001, 0.0005, 0.0, -0.0005])
    found = accepted_of(np.full(FRAMES, 0.07), second)
    assert found.edges.tolist() == [[False, k == ODD] for k in range(len(BOTTOMS))]
    assert found.second[:, 1].sum() == 6
    assert not found.second[:, 0].any()
    assert not found.first.any()


def test_frames_that_read_the_edge_itself_are_kept() -> None:
    upper = np.where(np.arange(FRAMES) < 8, HEIGHT, 0.085)
    second = np.where(np.arange(FRAMES) >= 12, HEIGHT + 0.0005, np.nan)
    found = accepted_of(upper, second)
    assert found.edges[ODD, 1]
    assert found.first[:, 1].sum() == 8
    assert found.second[:, 1].sum() == 8


def test_readings_of_several_minds_are_not_believed() -> None:
    second = HEIGHT + 0.03 * np.linspace(-1, 1, FRAMES)
    assert not accepted_of(np.full(FRAMES, 0.07), second).edges.any()


@pytest.mark.parametrize(("lower", "accepted"), [(-0.08, True), (0.0, False)])
def test_readings_that_were_looked_for_from_a_wrong_edge_are_no_other_minds(lower: float, accepted: bool) -> None:
    which, first = sighted(np.full(FRAMES, 0.05))
    odd = np.flatnonzero(which == ODD)
    again = np.full(first.shape, np.nan)
    again[odd[:4], 1] = BOTTOMS[ODD] + HEIGHT
    again[odd[4:7], 1] = BOTTOMS[ODD] - 0.08 + HEIGHT
    first[odd[4:7], 0] = BOTTOMS[ODD] + lower
    assert accepted_readings(np.zeros(len(BOTTOMS), np.int64), which, first, again).edges[ODD, 1] == accepted


def test_what_moves_a_whole_frame_does_not_part_readings() -> None:
    which, first = sighted(np.full(FRAMES, 0.05))
    again = np.full(first.shape, np.nan)
    again[which == ODD, 1] = BOTTOMS[ODD] + HEIGHT
    drift = 0.1 * HEIGHT * np.linspace(-1.0, 1.0, FRAMES).repeat(len(BOTTOMS))[:, None]
    found = accepted_readings(np.zeros(len(BOTTOMS), np.int64), which, first + drift, again + drift)
    assert found.edges[ODD, 1]
    assert found.second[:, 1].sum() == FRAMES


@pytest.mark.parametrize(
    ("spread", "common", "accepted"), [(0.02, True, True), (0.0005, True, False), (0.02, False, False)]
)
def test_edges_that_are_at_any_height_are_no_profile_of_a_section(spread: float, common: bool, accepted: bool) -> None:
    section = np.repeat([0, 1], [len(BOTTOMS), 4])
    which = np.tile(np.arange(len(section)), FRAMES)
    bottoms = np.array([*BOTTOMS, 0.0, 1.0, 2.0, 3.0])
    odd, off = section[which] == 1, np.linspace(-spread, spread, FRAMES).repeat(len(section))
    if common:
        odd &= which < len(section) - 1
    first = np.stack([bottoms[which], bottoms[which] + np.where(odd, 2 * HEIGHT + off, HEIGHT)], axis=-1)
    second = np.full(first.shape, np.nan)
    second[odd, 1] = bottoms[which][odd] + HEIGHT
    found = accepted_readings(section, which, first, second).edges
    assert found[len(BOTTOMS) : len(BOTTOMS) + 3, 1].tolist() == [accepted] * 3


def test_two_readings_are_too_few() -> None:
    second = np.full(FRAMES, np.nan)
    second[:2] = HEIGHT
    assert not accepted_of(np.full(FRAMES, 0.07), second).edges.any()


def test_a_row_of_many_profiles_has_no_usual_height() -> None:
    which, first = sighted(np.full(FRAMES, 0.07))
    first[:, 1] += 0.03 * which
    second = np.full(first.shape, np.nan)
    second[which == ODD, 1] = BOTTOMS[ODD] + HEIGHT + 0.06
    assert not accepted_readings(np.zeros(len(BOTTOMS), np.int64), which, first, second).edges.any()


def test_a_section_keeps_a_profile_of_its_own() -> None:
    section = np.repeat([0, 1], [len(BOTTOMS), 3])
    which = np.tile(np.arange(len(section)), FRAMES)
    bottoms = np.array([*BOTTOMS, 0.0, 1.0, 2.0])
    first = np.stack([bottoms[which], bottoms[which] + np.where(section[which] == 1, 0.07, HEIGHT)], axis=-1)
    second = np.full(first.shape, np.nan)
    second[which == len(BOTTOMS), 1] = HEIGHT
    assert not accepted_readings(section, which, first, second).edges.any()


@pytest.mark.parametrize(("firsts", "enough"), [(2, True), (1, False)])
def test_first_readings_count_beside_two_second_ones(firsts: int, enough: bool) -> None:
    """Where most frames put the edge far off, those that read it itself speak for the second readings."""
    upper = np.where(np.arange(FRAMES) < firsts, 1.03 * HEIGHT, 1.7 * HEIGHT)
    second = np.where(np.arange(FRAMES) >= FRAMES - 2, HEIGHT, np.nan)
    found = accepted_of(upper, second)
    assert found.edges[ODD, 1] == enough
    assert found.first.sum() == (firsts if enough else 0)
    assert found.second.sum() == (2 if enough else 0)


def below(frames: int, height: float = HEIGHT, scattered: float = 0.0) -> AcceptedReadings:
    """The accepted readings where a tote that stands on a beam was taken for it, and so many frames saw the beam's lower edge, and by a second
    reading its upper one, `height` above."""
    which, first = sighted(np.full(FRAMES, 2 * HEIGHT))
    again = np.full(first.shape, np.nan)
    seeing = np.flatnonzero(which == ODD)[:frames]
    at = BOTTOMS[ODD] - HEIGHT + scattered * np.linspace(-1, 1, frames)
    first[seeing, 0], again[seeing, 1] = at, at + height
    return accepted_readings(np.zeros(len(BOTTOMS), np.int64), which, first, again)


def test_a_beam_is_found_below_what_was_taken_for_it() -> None:
    found = below(6)
    assert found.edges.tolist() == [[k == ODD, k == ODD] for k in range(len(BOTTOMS))]
    assert found.first.sum(axis=0).tolist() == [6, 0]
    assert found.second.sum(axis=0).tolist() == [0, 6]


@pytest.mark.parametrize(
    "found",
    [
        pytest.param(below(3), id="three frames"),
        pytest.param(below(6, 1.1 * HEIGHT), id="of no profile of the row"),
        pytest.param(below(6, scattered=0.5), id="at any height"),
    ],
)
def test_what_is_below_is_not_believed_without_reason(found: AcceptedReadings) -> None:
    assert not found.edges.any()
