"""A row that its camera sees in part, and that nothing gives a scale or a place, has a unit and a zero of its own."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.errors import SolveError
from savmap.graph import (
    Constraints,
    Problem,
    camera_priors,
    fixed_coordinate,
    image_measurements,
    known_length,
    merge,
    solve,
)

from .made_up_wall import FACTS, KEYS, WALL, path, track


def problem(sees_in_part: bool, unit: bool = True) -> Problem:
    """The wall's points, the first of which is the row's begin; two of them are a metre apart in truth."""
    facts = replace(FACTS, sees_in_part=sees_in_part)
    tracks = [track(f"post {number}", point, "post") for number, point in enumerate(WALL)]
    keys = dict(KEYS)
    relations = [fixed_coordinate("z", key) for key in keys.values()]
    relations.append(fixed_coordinate("x", keys["post 0"]))
    length = replace(known_length("x", keys["post 3"], keys["post 6"], 1.0, 0.001, "one bay"), is_given=False)
    part = Constraints(
        "wall",
        keys,
        image_measurements(tracks, keys, facts.views),
        tuple(relations),
        dict(zip(keys, WALL, strict=True)),
        unit=(length,) if unit else (),
    )
    return merge(camera_priors(facts, path(1.7)), part)


def test_it_is_mapped_in_its_own_units_and_says_so() -> None:
    solution = solve(problem(True))
    points = {name: landmark.position for name, landmark in solution.landmarks_of("wall").items()}
    np.testing.assert_allclose(points["post 12"] - points["post 0"], [4.0, 0.0, 0.0], atol=0.02)
    assert min(point[1] for point in points.values()) == pytest.approx(0.0, abs=0.01)
    lines = [line for warning in solution.warnings for line in warning.details]
    assert [warning.code for warning in solution.warnings].count("doubtful-scale") == 2
    assert any("in units of its own" in line for line in lines)
    assert any("place along y" in line for line in lines)


def test_without_a_unit_it_is_as_long_as_was_taken_at_first() -> None:
    solution = solve(problem(True, unit=False))
    points = solution.landmarks_of("wall")
    assert points["post 12"].position[0] == pytest.approx(4.0 * 1.7, rel=0.2)


def test_whole_panoramas_need_references() -> None:
    with pytest.raises(SolveError, match="the map's scale is not known"):
        solve(problem(False))
