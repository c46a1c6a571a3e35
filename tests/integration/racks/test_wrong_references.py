"""A wrong reference never buys its fit with what was seen of its landmark: it is named, and left out where the rest is clear."""

from dataclasses import replace

import made_up_rack as made
import numpy as np
import pytest

from savmap.errors import SolveError
from savmap.graph import (
    Calibration,
    CameraHeight,
    Problem,
    References,
    Solution,
    Stitching,
    SurveyedPoint,
    camera_priors,
    locate_camera,
    merge,
    solve,
)
from savmap_shelves.constraints import GridSettings, constrain

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def four() -> made.World:
    return made.world(11, sections=4, frames=50, bridge=None)


def problem(
    world: made.World, heights: list[float] | float, given: References, calibration: Calibration | None = None
) -> Problem:
    begin = made.begin(world)
    own = constrain(world.tracks, world.facts, begin, settings=GridSettings(heights))
    return merge(camera_priors(world.facts, begin, given, calibration=calibration), own)


def typed(world: made.World, off: float, wanted: str = "check") -> Problem:
    """The problem with the last bay's height off by some metres."""
    heights = [*world.rack.lowest[:-1], world.rack.lowest[-1] + off]
    return problem(world, heights, replace(made.references(world), on_contradiction=wanted))  # type: ignore[arg-type]


def largest_error(world: made.World, solution: Solution) -> float:
    x, y, _, _ = made.errors(world, solution)
    return float(max(np.abs(x).max(), np.abs(y).max()))


def test_a_height_typed_wrong_is_named_and_left_out(four: made.World) -> None:
    off = 0.5
    solution = solve(typed(four, off))
    [warning] = solution.warnings
    given, true = four.rack.lowest[-1] + off, four.rack.lowest[-1]
    assert warning.code == "reference-conflict"
    assert f"height of the lowest edge of bay 4 is given as {given:.3f} m" in made.said(warning)
    assert float(made.said(warning).split("the rest says ")[1].split()[0]) == pytest.approx(true, abs=0.02)
    assert warning.place is not None
    assert largest_error(four, solution) < 0.02


def test_on_contradiction_refuse_or_leave_out(four: made.World) -> None:
    with pytest.raises(SolveError, match=r"contradict.*bay 4 is given as"):
        solve(typed(four, 0.05, "refuse"))
    solution = solve(typed(four, 0.05, "leave_out"))
    assert solution.warnings == ()
    assert any("bay 4 is given as" in line for line in solution.notes)
    assert solution.unchecked[0].startswith("not checked by a second reference: ")
    assert largest_error(four, solution) < 0.02


def test_what_is_presumed_refuses_no_row(four: made.World) -> None:
    """Feet below the floor, where a camera height or a length is wrong."""
    feet = [made.foot(four, upright, -0.5) for upright in range(5)]
    own = constrain([*four.tracks, *feet], four.facts, made.begin(four), settings=GridSettings())
    given = made.references(four, camera=True, length=True)
    solution = solve(merge(camera_priors(four.facts, made.begin(four), given), own))
    [warning] = solution.warnings
    assert (warning.code, warning.subjects) == ("doubtful-scale", ())
    assert [use.name for use in solution.references if "floor" in use.name] == []
    assert "what was found instead is at -0.50 m" in made.said(warning)
    assert largest_error(four, solution) < 0.02


def test_what_lies_below_all_lowest_beams_is_one_mistake_not_two(four: made.World) -> None:
    """A kerb that is taken for the lowest beam of every bay contradicts the camera's height and a surveyed point at
    once; still the heights are left out, all of them, and the row is mapped."""
    rack, given = four.rack, made.references(four)
    point = SurveyedPoint("bay 2 / beam 2 / lower left", (None, float(rack.beams[1][1, 0]), None), 0.005)
    heights = [height + 0.4 for height in rack.lowest]
    solution = solve(problem(four, heights, replace(given, points=(point,))))
    [*warnings] = solution.warnings
    assert {warning.code for warning in warnings} == {"reference-conflict"}
    assert {name for warning in warnings for name in warning.subjects} == {
        f"height of the lowest edge of bay {bay}" for bay in (1, 2, 3, 4)
    }
    assert largest_error(four, solution) < 0.02


def test_a_presumption_is_never_called_given(four: made.World) -> None:
    """Feet at several heights give no scale, and nothing that was measured is called wrong for that."""
    feet = [made.foot(four, upright, 0.3 * (upright % 2)) for upright in range(5)]
    own = constrain([*four.tracks, *feet], four.facts, made.begin(four), settings=GridSettings())
    with pytest.raises(SolveError, match="scale is not known"):
        solve(merge(camera_priors(four.facts, made.begin(four), made.references(four, length=False)), own))


def test_of_two_that_give_the_scale_nobody_can_say() -> None:
    """With equal heights nothing but the camera's height and the length tell the scale."""
    world = made.world(6, sections=3, frames=40, bridge=None)
    true = made.references(world)
    own = replace(world.rack, beams=tuple(beams - beams[0, 0] + 0.3 for beams in world.rack.beams))
    level = made.seen_from(own, world.poses, np.random.default_rng(1))
    given = replace(true, camera_heights=(CameraHeight(true.camera_heights[0].value_m + 0.15, 0.02),))
    [warning] = solve(problem(level, 0.3, given)).warnings
    assert "camera height" in made.said(warning)
    assert "length upright 1 / left to upright 4 / right" in made.said(warning)
    assert "try `calibration: {lens_distance: true}`" in made.said(warning)
    asked = solve(problem(level, 0.3, given, Calibration(Stitching())))
    assert asked.warnings
    assert not any("calibration" in made.said(warning) for warning in asked.warnings)
    far = replace(true, camera_heights=(CameraHeight(true.camera_heights[0].value_m + 0.9, 0.02),))
    with pytest.raises(
        SolveError, match=r"contradict.*length upright 1.*camera height|contradict.*camera height.*length upright 1"
    ):
        solve(problem(level, 0.3, far))


def test_a_length_in_feet_is_told_and_does_not_bend_the_path_by_which_others_are_tracked(four: made.World) -> None:
    """Lamps were looked for by a path three times as long: one was mapped 24 m long, four were missing."""
    lengths = tuple(replace(one, value_m=one.value_m / 0.3048) for one in made.references(four).lengths)
    given = replace(made.references(four), lengths=lengths)
    in_feet = problem(four, list(four.rack.lowest), given)
    (warning,) = solve(in_feet).warnings
    assert f"feet are {made.references(four).lengths[0].value_m:.3f} m" in made.said(warning)
    located = locate_camera(in_feet)
    off = located.path.world_from_rig[:, :3, 3] - four.poses[located.path.frames, :3, 3]
    assert np.abs(off).max() < 0.3


def test_one_camera_height_alone_is_never_refuted(four: made.World) -> None:
    """All heights above the floor are equal, and no length is given: a wrong height scales the map, which no picture shows."""
    level = replace(four.rack, beams=tuple(beams - beams[0, 0] + 0.3 for beams in four.rack.beams))
    world = made.seen_from(level, four.poses, np.random.default_rng(5))
    solution = solve(problem(world, 0.3, References((CameraHeight(2.0, 0.02),))))
    assert solution.warnings == ()
    assert not [line for line in solution.notes if "is given as" in line]
    hidden = "camera height (any error would stay hidden). To check it: a length"
    assert solution.unchecked[0] == f"not checked by a second reference: {hidden}"


def test_heights_that_nothing_contradicts_are_noted(four: made.World) -> None:
    """Without the camera's height, all of them may have been measured from a wrong floor."""
    lengths = made.references(four).lengths
    line = solve(problem(four, list(four.rack.lowest), References((), lengths))).unchecked[0]
    hidden = "all given heights together (any error would stay hidden). To check them: the camera's height"
    assert line == f"not checked by a second reference: {hidden}"


def test_one_height_for_all_may_be_missing(four: made.World) -> None:
    """A bay without the lowest beam is no warning where one height was given for all of them, but it is where its own was."""
    own = replace(four.rack, beams=tuple(beams - beams[0, 0] + 0.25 for beams in four.rack.beams))
    world = made.seen_from(own, four.poses, np.random.default_rng(2))
    bare = replace(world, tracks=[t for t in world.tracks if (t.place.get("bay"), t.place.get("beam")) != (3, 1)])
    common, each = (solve(problem(bare, heights, made.references(world))) for heights in (0.25, [0.25] * 4))
    assert common.warnings == ()
    assert [warning.code for warning in each.warnings] == ["reference-conflict"]


def test_one_height_for_all_where_a_bridge_has_none_so_low() -> None:
    """Equal heights agree best where the scene has no extent: that is no explanation. One more of them is wrong here."""
    bridged = made.world(12, sections=4, frames=50, bridge=2)
    beams = list(bridged.rack.beams)
    for section, lowest in ((0, 0.25), (1, 0.125), (3, 0.25)):
        beams[section] = beams[section] - beams[section][0, 0] + lowest
    rack = replace(bridged.rack, beams=tuple(beams))
    world = made.seen_from(rack, bridged.poses, np.random.default_rng(2))
    solution = solve(problem(world, 0.25, made.references(world)))
    [warning] = solution.warnings
    assert "height of the lowest edge of bay 2 is given as" in made.said(warning)
    assert any("bay 3: the lowest beam at" in note for note in solution.notes)
    assert largest_error(world, solution) < 0.05


def test_lowest_beams_that_goods_hide_in_half_of_the_sections_are_told() -> None:
    """The next ones up were seen. Another height is wrong beside them: of eight references only four are right."""
    hidden = (0.9, 0.0, 0.7, -0.05, 0.0, 1.2)
    world = made.world(11, sections=6, frames=60, bridge=None)
    heights = [seen - below for seen, below in zip(world.rack.lowest, hidden, strict=True)]
    solution = solve(problem(world, heights, made.references(world)))
    notes = [line for line in solution.notes if "was not seen; its height is not used" in line]
    assert [line.split(":")[0] for line in notes] == ["bay 1", "bay 3", "bay 6"]
    assert any("bay 4" in line for line in solution.notes)
    assert solution.warnings
    assert largest_error(world, solution) < 0.03


def test_where_too_little_is_left_hidden_beams_are_no_excuse(four: made.World) -> None:
    """A camera's height and two heights: either of them may be wrong."""
    heights = [four.rack.lowest[0] - 0.9, None, four.rack.lowest[2], None]
    given = made.references(four, length=False)
    with pytest.raises(SolveError, match="camera height"):
        solve(problem(four, heights, given))  # type: ignore[arg-type]
