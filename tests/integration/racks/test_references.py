"""Gauge and scale: what is missing is named, what contradicts is named."""

from dataclasses import replace
from types import SimpleNamespace

import made_up_rack as made
import numpy as np
import pytest

from savmap.errors import SiteError, SolveError, StructureError
from savmap.graph import CameraHeight, KnownLength, References, SolveOptions, SurveyedPoint, camera_priors, merge
from savmap.graph.initial.observability import assume_missing
from savmap.graph.solver.solution import scale_sigma
from savmap.types import Floats, Trajectory
from savmap_shelves.constraints import GridSettings, constrain


@pytest.fixture(scope="module")
def small() -> made.World:
    return made.world(6, sections=3, frames=40, bridge=None)


@pytest.mark.parametrize(
    ("camera", "length", "heights", "missing"),
    [
        (True, False, False, "known height on the structure"),
        (False, True, False, "place along y"),
        (False, False, False, "scale is not known"),
    ],
)
def test_missing_reference_is_named(small: made.World, camera: bool, length: bool, heights: bool, missing: str) -> None:
    with pytest.raises(SolveError, match=missing) as raised:
        made.solved(small, given=made.references(small, camera, length), heights=heights)
    assert "\n" not in str(raised.value)


def test_an_edge_that_was_seen_at_no_one_place_refutes_nothing(small: made.World) -> None:
    """What is taken for the lower edge of bay 2's lowest beam lies 8 +- 16 cm too low: its height was called wrong, 32 sigma off."""
    rng = np.random.default_rng(0)
    place = {"bay": 2, "beam": 1, "edge": "lower"}
    tracks = [
        replace(track, pixels=track.pixels + rng.normal([0, 8], [0, 16], (len(track.frames), 2)))
        if place.items() <= track.place.items()
        else track
        for track in small.tracks
    ]
    solution = made.solved(replace(small, tracks=tracks))
    assert solution.warnings == ()
    assert not [note for note in solution.notes if "is given as" in note]
    (use,) = (use for use in solution.references if use.name == "height of the lowest edge of bay 2")
    assert use.state == "used"
    assert any("height of the lowest edge of bay 2" in line for line in solution.unchecked)


def test_an_assumed_scale_rests_on_no_end_that_was_not_seen(small: made.World) -> None:
    """A post's upper end, which may be anywhere, was taken for one end of the scene: this then shrank to a tenth."""
    own = constrain(small.tracks, small.facts, made.begin(small), settings=GridSettings())
    problem = merge(camera_priors(small.facts, made.begin(small)), own, partial=True)
    points = np.array([own.initial[name] for name, _ in sorted(own.keys.items(), key=lambda item: item[1])])
    points[points[:, 1].argmax(), 1] += 50.0
    relations = assume_missing(problem, made.begin(small).world_from_rig[:, :3, 3], points).relations
    (assumed,) = (relation for relation in relations if relation.name == "assumed scale")
    assert assumed.axis == "x"
    assert 0.2 < assumed.value / np.ptp(points[:, 0]) <= 1.0


def test_heights_that_differ_by_little_give_no_scale() -> None:
    """Exactly known, their differences would give it to 3.5 %; as the video shows them they do not."""
    world = made.world(3, sections=3, frames=40, bridge=None)
    begin = made.begin(world)
    own = constrain(world.tracks, world.facts, begin, settings=GridSettings(world.rack.lowest))
    with pytest.raises(SolveError, match="add a camera height or a known length"):
        made.solve(merge(camera_priors(world.facts, begin), own))


@pytest.mark.slow
@pytest.mark.parametrize("warped", [False, True])
def test_pixels_that_are_far_off_are_told_as_such(warped: bool) -> None:
    """Camera height and bay heights give the scale, but errors of 40 px, or a wrong projection, hide it."""
    small = made.world(6, sections=3, frames=20, bridge=None)
    rng, centre = np.random.default_rng(5), np.array([made.VIEW.width, made.VIEW.height]) / 2

    def spoilt(pixels: Floats) -> Floats:
        off = pixels - centre
        bent = off * (1 - 0.5 * (off**2).sum(axis=1, keepdims=True) / centre[0] ** 2)
        return centre + bent if warped else pixels + rng.normal(0, 40, pixels.shape)

    world = replace(small, tracks=[replace(track, pixels=spoilt(track.pixels)) for track in small.tracks])
    begin, options = made.begin(world), SolveOptions(judge=False)
    with pytest.raises(SolveError, match=r"pixels are off by \d+\.\d px, \d+\.\d times as far as") as raised:
        made.solve(made.problem(world, begin, made.references(world, length=False)), options)
    assert "scale is not known" not in str(raised.value)
    assert "neither cropped nor stretched" in str(raised.value)
    assert "\n" not in str(raised.value)
    with pytest.raises(SolveError, match="scale is not known; a camera height alone does not give it"):
        made.solve(made.problem(world, begin, made.references(world, length=False), heights=False), options)


def test_one_height_for_all_sections_gives_no_scale(small: made.World) -> None:
    begin = made.begin(small)
    own = constrain(small.tracks, small.facts, begin, settings=GridSettings(0.3))
    with pytest.raises(SolveError, match="add a camera height or a known length"):
        made.solve(merge(camera_priors(small.facts, begin), own))


@pytest.mark.parametrize(
    ("camera", "length", "heights"), [(True, False, True), (False, True, True), (True, True, False)]
)
def test_enough_references(small: made.World, camera: bool, length: bool, heights: bool) -> None:
    solution = made.solved(small, given=made.references(small, camera, length), heights=heights)
    x, y, sigma_x, sigma_y = made.errors(small, solution)
    assert (np.abs(x) < np.maximum(3 * sigma_x, 1e-3)).all()
    assert (np.abs(y) < np.maximum(3 * sigma_y, 1e-3)).all()
    assert np.max(sigma_x) < 0.1
    assert np.max(sigma_y) < 0.05


def test_two_surveyed_points_are_enough(small: made.World) -> None:
    rack = small.rack
    points = tuple(
        SurveyedPoint(f"bay {s} / beam 1 / lower left", (rack.uprights[s - 1, 1], rack.lowest[s - 1], 0.0), 0.002)
        for s in (1, 3)
    )
    x, y, _, _ = made.errors(small, made.solved(small, given=References(points=points), heights=False))
    assert np.abs(x).max() < 0.02
    assert np.abs(y).max() < 0.02


def test_a_gross_error_of_the_length_is_named(small: made.World) -> None:
    """The bays' heights, which differ, tell that the camera's height is right."""
    span = float(small.rack.uprights[-1, 1]) + 2.0
    true = made.references(small)
    given = References(true.camera_heights, (KnownLength("upright 1 / left", "upright 4 / right", span, 0.003),))
    [warning] = made.solved(small, given=given).warnings
    assert f"length upright 1 / left to upright 4 / right is given as {span:.3f} m" in made.said(warning)
    assert "a part of the row may be missing" in made.said(warning)


def test_slight_contradiction_is_doubted(small: made.World) -> None:
    span = float(small.rack.uprights[-1, 1]) + 0.35
    given = References(
        (CameraHeight(3.05, 0.02),), (KnownLength("upright 1 / left", "upright 4 / right", span, 0.003),)
    )
    [warning] = made.solved(small, given=given).warnings
    assert "length upright 1 / left to upright 4 / right" in made.said(warning)


def test_vague_scale_is_told(small: made.World) -> None:
    given = References((CameraHeight(float(small.poses[:, 1, 3].mean()), 0.1),))
    warnings = " ".join(made.solved(small, given=given).notes)
    assert "scale" in warnings


def test_all_references_are_reported(small: made.World) -> None:
    used = {use.name: use for use in made.solved(small).references}
    assert used["camera height"].solved == pytest.approx(used["camera height"].value, abs=0.04)
    assert used["height of the lowest edge of bay 2"].value == pytest.approx(small.rack.lowest[1])
    assert len(used) == 5


def test_unknown_name_suggests_the_nearest(small: made.World) -> None:
    given = References((), (KnownLength("upright 1 / left", "upright 9 / right", 10.0, 0.003),))
    with pytest.raises(
        SiteError, match=r"upright 9 / right.*nearest name is 'upright 4 / right': is all of the row in the video"
    ):
        made.problem(small, made.begin(small), given)


def test_length_between_vertices_of_one_column(small: made.World) -> None:
    names = "bay 1 / beam 1 / lower left", "bay 1 / beam 3 / upper left"
    found = made.problem(small, made.begin(small), References(lengths=(KnownLength(*names, 2.0, 0.01),)))
    assert [relation.axis for relation in found.relations if relation.name.startswith("length")] == ["y"]


def test_length_along_no_axis_is_refused(small: made.World) -> None:
    corner = "bay 1 / beam 1 / lower left"
    for a, b in ((corner, "bay 2 / beam 3 / upper left"), ("upright 1 / left", "bay 1 / beam 2 / upper")):
        given = References(lengths=(KnownLength(a, b, 2.0, 0.01),))
        with pytest.raises(SiteError, match="along no one axis"):
            made.problem(small, made.begin(small), given)


def test_references_must_make_sense(small: made.World) -> None:
    with pytest.raises(SolveError, match="sigma"):
        CameraHeight(3.0, 0.0)
    with pytest.raises(SolveError, match="no such pass"):
        camera_priors(small.facts, made.begin(small), References((CameraHeight(3.0, 0.1, passes=("two",)),)))


def test_nothing_seen_is_said(small: made.World) -> None:
    begin = made.begin(small)
    with pytest.raises(StructureError, match="nothing was tracked"):
        merge(camera_priors(small.facts, begin))
    own = constrain(small.tracks, small.facts, begin)
    elsewhere = Trajectory(begin.frames + 1000, begin.world_from_rig)
    with pytest.raises(StructureError, match="no frame with a known pose"):
        merge(camera_priors(small.facts, begin, fixed=elsewhere), own)


def test_one_badly_known_landmark_does_not_make_the_scale_unknown() -> None:
    along = np.array([0.0, 9.9, 42.6])
    sigma = np.array([1e-4, 0.003, 9.5])
    problem = SimpleNamespace(keys=np.arange(3))
    estimate = SimpleNamespace(points=np.column_stack([along, along, along]))
    covariance = SimpleNamespace(keys=(2, 0, 1), points=np.diag(np.repeat(sigma[[2, 0, 1]] ** 2, 3)))
    assert scale_sigma(problem, estimate, covariance) == pytest.approx(0.003 / 9.9)  # type: ignore[arg-type]
