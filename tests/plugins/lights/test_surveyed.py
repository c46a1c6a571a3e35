"""Lamps of a survey: out of a point, two ends, an outline or a body."""

import numpy as np
import pytest

from savmap.types import Floats, Structure
from savmap_lights.scores import survey_entry

ENDS = np.array([[1.0, 8.2, 1.1], [2.25, 8.21, 1.3]])


def lamp(points: Floats) -> Structure:
    count = len(points)
    return Structure("l", "light", points, np.zeros((count, 3, 3)), ("",) * count, np.zeros((0, 2), np.int64))


def ends_of(points: Floats) -> Floats:
    return np.array(survey_entry([lamp(points)]).values["lights"][0]["ends"])


def body(half_m: float) -> Floats:
    """The corners (8, 3) of a strip around the ends."""
    aside = half_m * np.array([-0.2, 0.0, 1.25]) / np.hypot(0.2, 1.25)
    ring = np.array([ENDS[0] - aside, ENDS[1] - aside, ENDS[1] + aside, ENDS[0] + aside])
    up = np.array([0.0, 0.04, 0.0])
    return np.concatenate([ring - up, ring + up])


@pytest.mark.parametrize("points", [ENDS, body(0.06), body(0.06)[:4] + np.array([0, 0.04, 0]), body(0.06)[::-1]])
def test_a_strip_has_its_ends(points: Floats) -> None:
    found = ends_of(points)
    assert min(np.abs(found - ENDS).max(), np.abs(found[::-1] - ENDS).max()) < 1e-9


@pytest.mark.parametrize(
    "points", [ENDS[:1], ENDS[0] + 0.2 * np.array([[1, 0, 1], [-1, 0, 1], [-1, 0, -1], [1, 0, -1]])]
)
def test_a_compact_lamp_has_one_place(points: Floats) -> None:
    assert ends_of(points) == pytest.approx(np.array([ENDS[0]] * 2))
