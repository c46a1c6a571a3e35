"""The lamp model on made-up evidence: strips, compact lamps, hidden shares, purlins, joints, lamps cut by the border."""

import numpy as np
import pytest

from savmap.types import Bools, Floats, PlaneEvidence, PlanePatch
from savmap_lights.lamp_model import LampReader, Line, agreement, evenly_spaced, lengths
from savmap_lights.likelihood import fitted

CELL, ROWS, COLUMNS = 1 / 300, 120, 1200
BAND = (50, 62)


class Ceiling:
    """Mean scores and brightness of a ceiling, 0.02 m a cell."""

    def __init__(self) -> None:
        self.mean, self.bright = np.full((ROWS, COLUMNS), 0.003), np.full((ROWS, COLUMNS), 90.0)
        self.shown: Bools = np.ones((ROWS, COLUMNS), np.bool_)

    def lamp(
        self, first: int, last: int, score: float = 0.95, bright: float = 250.0, band: tuple[int, int] = BAND
    ) -> None:
        part = slice(*band), slice(first, last)
        self.mean[part], self.bright[part] = score, bright

    def lines(self) -> list[Line]:
        reader = LampReader(self.mean, self.bright, self.shown, CELL, 0.02, fitted())
        return [reader.read(line) for line in reader.lines()]


def extents(line: Line) -> Floats:
    """Of its lamps, in cells."""
    return np.array([[lamp.low, lamp.high] for lamp in line.lamps]) / 0.02


def test_strips_are_found_exactly() -> None:
    ceiling = Ceiling()
    places = [(100 + 200 * k, 170 + 200 * k) for k in range(5)]
    for place in places:
        ceiling.lamp(*place)
    (line,) = ceiling.lines()
    assert extents(line) == pytest.approx(np.array(places), abs=0.6)
    assert [line.low, line.high] == pytest.approx([1.0, 1.24], abs=0.03)
    assert min(lamp.probability for lamp in line.lamps) > 0.95
    assert not line.possible


def test_compact_lamps_need_no_long_line() -> None:
    ceiling = Ceiling()
    for first in (150, 600, 1050):
        ceiling.lamp(first, first + 12)
    (line,) = ceiling.lines()
    assert extents(line)[:, 0] == pytest.approx([150, 600, 1050], abs=0.6)


def test_a_part_that_is_hidden_does_not_cut_a_lamp() -> None:
    ceiling = Ceiling()
    for first in (100, 400, 700):
        ceiling.lamp(first, first + 100)
    ceiling.lamp(440, 446, score=0.2, bright=120)
    (line,) = ceiling.lines()
    assert extents(line)[1] == pytest.approx([400, 500], abs=0.6)


def test_a_lamp_that_the_border_cuts_is_left_out() -> None:
    ceiling = Ceiling()
    for first in (0, 300, 600, 1120):
        ceiling.lamp(first, first + 80)
    (line,) = ceiling.lines()
    assert len(line.lamps) == 2


def test_what_does_not_shine_is_no_lamp() -> None:
    ceiling = Ceiling()
    for first in (100, 500, 900):
        ceiling.lamp(first, first + 70)
    for first in (120, 520, 880):
        ceiling.lamp(first, first + 150, 0.6, 215, (20, 25))
    lines = sorted(ceiling.lines(), key=lambda line: line.low)
    assert max(lamp.probability for lamp in lines[0].lamps) < 0.01
    assert min(lamp.probability for lamp in lines[-1].lamps) > 0.95


def test_joints_at_even_distances_cut_a_line_of_light() -> None:
    ceiling = Ceiling()
    ceiling.lamp(30, 1170)
    for joint in range(100, 1170, 100):
        ceiling.lamp(joint - 1, joint + 2, 0.93, 244)
    (line,) = ceiling.lines()
    assert extents(line)[1:-1, 0] == pytest.approx(np.arange(102, 1102, 100), abs=6)
    assert extents(line)[1:-1, 1] == pytest.approx(np.arange(199, 1199, 100), abs=6)


def test_dips_at_odd_distances_are_no_joints() -> None:
    ceiling = Ceiling()
    ceiling.lamp(30, 1170)
    for dip in (120, 171, 388, 612, 700, 951):
        ceiling.lamp(dip - 1, dip + 2, 0.93, 244)
    (line,) = ceiling.lines()
    assert extents(line) == pytest.approx(np.array([[30, 1170]]), abs=0.6)


def test_evenly_spaced_places_may_lack_one() -> None:
    dark, lit = np.zeros(1000, np.bool_), np.ones(1000, np.bool_)
    for place in (50, 170, 290, 410, 650, 770, 890):
        dark[place - 2 : place + 3] = True
    assert np.array(evenly_spaced(dark, lit, 20)) == pytest.approx(np.arange(50, 1000, 120), abs=3)
    assert not evenly_spaced(np.roll(lit, 1) & (np.arange(1000) % 97 == 5) & (np.arange(1000) < 200), lit, 20)


def test_an_empty_ceiling_has_no_lamps() -> None:
    assert not any(line.lamps for line in Ceiling().lines())


def test_lengths_grow_by_a_ratio() -> None:
    tried = lengths(500)
    assert tried[0] == 2
    assert tried[-1] <= 500
    assert (np.diff(tried) >= 1).all()


def test_frames_agree_where_the_mean_is_sure_and_sharp() -> None:
    patch = PlanePatch("ceiling", np.zeros(3), np.eye(3)[0], np.eye(3)[2], np.array([2.0, 0.2]), 0.02)
    ones = np.ones(patch.shape, np.float32)
    sure, vague = np.zeros((2, 1, *patch.shape), np.float32)
    sure[..., 40:60], vague[..., 30:70] = 1.0, 0.5
    black = np.zeros((*patch.shape, 3), np.uint8)
    both = [PlaneEvidence(patch, ("light",), mean, ones, black, 10 * ones) for mean in (sure, vague)]
    assert agreement(both[0], "light") > 3 * agreement(both[1], "light")
    single = PlaneEvidence(patch, ("light",), sure, ones, black, ones)
    assert agreement(single, "light") == 0.0
