"""A bay's lowest beam that was not seen: its height is not laid on the next beam up, as long as most bays agree."""

from dataclasses import replace

import made_up_rack as made
import numpy as np
import pytest

from savmap.errors import SiteError, SolveError
from savmap.graph import Problem, camera_priors, merge, solve
from savmap_shelves.constraints import GridSettings, constrain

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def four() -> made.World:
    return made.world(11, sections=4, frames=50, bridge=None)


def blind(world: made.World, sections: set[int], camera: bool = True, length: bool = True) -> Problem:
    """The problem where the lowest beams of some bays were not seen, while their heights are given."""
    tracks = [track for track in world.tracks if not (track.place.get("bay") in sections and track.place["beam"] == 1)]
    begin = made.begin(world)
    own = constrain(tracks, world.facts, begin, settings=GridSettings(world.rack.lowest))
    return merge(camera_priors(world.facts, begin, made.references(world, camera, length)), own)


def test_a_missed_lowest_beam_is_told_and_does_no_harm(four: made.World) -> None:
    section = 3
    solution = solve(blind(four, {section}, length=False))
    told = [line for line in solution.notes if line.startswith(f"bay {section}: the lowest beam at ")]
    assert len(told) == 1
    assert "its height is not used" in told[0]
    found = four.rack.beams[section - 1][1, 0]
    assert float(told[0].split("is at ")[1].split()[0]) == pytest.approx(found, abs=0.05)
    (use,) = (use for use in solution.references if use.name == f"height of the lowest edge of bay {section}")
    assert (use.state, use.sigma_used) == ("left out", None)
    assert use.solved == pytest.approx(found, abs=0.05)
    _, y, _, _ = made.errors(four, solution)
    assert np.abs(y).max() < 0.02


def test_where_most_sections_disagree_all_are_left_out_and_named(four: made.World) -> None:
    solution = solve(blind(four, {1, 2, 3}))
    assert {warning.code for warning in solution.warnings} == {"reference-conflict"}
    assert {use.state for use in solution.references if use.name.startswith("height of")} == {"left out"}
    _, y, _, _ = made.errors(four, solution)
    assert np.abs(y).max() < 0.05


def test_heights_that_agree_are_all_used(four: made.World) -> None:
    solution = made.solved(four)
    assert solution.warnings == ()
    assert not [line for line in solution.notes if "not seen" in line]
    assert sum(use.name.startswith("height of") for use in solution.references) == 4


def test_on_a_known_path_too(four: made.World) -> None:
    known = made.solved(four).trajectory
    problem = blind(four, {2})
    solution = solve(replace(problem, camera=replace(problem.camera, fixed=known)))
    assert any(line.startswith("bay 2: the lowest beam at ") for line in solution.notes)


def part(world: made.World, heights: list[float]) -> Problem:
    """The problem where heights are given for more bays than were found, and no length."""
    begin = made.begin(world)
    own = constrain(world.tracks, world.facts, begin, settings=GridSettings(heights))
    return merge(camera_priors(world.facts, begin, made.references(world, length=False)), own)


def test_of_more_heights_than_sections_those_that_fit_are_used(four: made.World) -> None:
    before = 1
    spare = [0.55, 0.9]
    heights = [*spare[:before], *four.rack.lowest, *spare[before:]]
    solution = solve(part(four, heights))
    used = [use.value for use in solution.references if use.name.startswith("height of")]
    assert used == list(four.rack.lowest)
    assert f"only a part of the row was found: bays {before + 1} to {before + 4} of 6" in solution.notes[0]
    _, y, _, _ = made.errors(four, solution)
    assert np.abs(y).max() < 0.02


def test_equal_heights_fit_whatever_part_was_found(four: made.World) -> None:
    own = replace(four.rack, beams=tuple(beams - beams[0, 0] + 0.3 for beams in four.rack.beams))
    level = made.seen_from(own, four.poses, np.random.default_rng(4))
    solution = solve(part(level, [0.3] * 5))
    assert "bays 1 to 4 of 5 or bays 2 to 5 of 5" in solution.notes[0]


def test_heights_that_fit_in_several_ways_are_refused(four: made.World) -> None:
    with pytest.raises(SolveError, match="not clear whether"):
        solve(part(four, [0.3, 0.3001, 0.3, 0.3001, 0.3]))


def test_fewer_heights_than_sections(four: made.World) -> None:
    with pytest.raises(SiteError, match="3 values, but 4 bays"):
        part(four, list(four.rack.lowest)[:3])
