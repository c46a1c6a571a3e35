"""References and relations of plugins that come after those that locate the camera."""

import numpy as np
import pytest

from savmap.errors import SiteError, SolveError, StructureError
from savmap.graph import References, Solution, camera_priors, locate_camera, merge, solve
from savmap.pipeline import row as rows
from savmap.pipeline.records import LocatedRow, RowMeasurements, RowRequest, TrackedRow
from savmap.pipeline.row import constrain, track
from savmap.plugin.hookspecs import hookimpl
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.types import Track, Trajectory
from savmap.types.progress import SilentMonitor
from savmap.vision.markers import MarkerTracks

from ..graph import made_up_wall as made

SEEN = RowMeasurements(
    made.FACTS,
    {"wall": [], "stripes": [], "last": []},
    {},
    frozenset({"wall"}),
    (),
    MarkerTracks({}, {}),
)


def solved(rooms: list[LoadedPlugin], references: References, start_scale: float = 1.3) -> Solution:
    """By the engine's steps, from a start whose scale is wrong."""
    return solve(constrain(tracked(rooms, references, start_scale), SilentMonitor()).problem)


def tracked(rooms: list[LoadedPlugin], references: References, start_scale: float = 1.3) -> TrackedRow:
    start = made.path(start_scale)
    frames = camera_priors(made.FACTS, start, references)
    return track(LocatedRow(RowRequest("A", (), rooms, references), SEEN, start, frames), SilentMonitor())


def errors_m(solution: Solution) -> float:
    found = solution.landmarks_of("stripes")
    return float(
        max(np.abs(found[name].position - true).max() for name, true in zip(made.NAMES, made.CORNERS, strict=True))
    )


def test_a_length_between_a_later_plugins_landmarks() -> None:
    solution = solved(made.rooms(), made.references(made.LENGTH))
    assert errors_m(solution) < 0.01
    assert [use.name for use in solution.references] == ["camera height", "length stripe corner 1 to stripe corner 7"]


def test_a_later_plugin_gives_the_scale() -> None:
    assert errors_m(solved(made.rooms(known=True), made.references())) < 0.01


def test_scale_that_no_plugin_gives_is_refused() -> None:
    with pytest.raises(SolveError, match="row A: the map's scale is not known; a camera height alone does not give it"):
        solved(made.rooms(), made.references())


def test_a_reference_to_what_was_not_found_is_left_out_and_named() -> None:
    length = made.renamed(made.LENGTH, "stripe corner 70")
    row = tracked(made.rooms(known=True), made.references(length))
    line = "row A: reference to 'stripe corner 70', but no such thing was found in the video"
    assert [(item.code, item.details[0][: len(line)]) for item in row.measurements.warnings] == [
        ("reference-conflict", line)
    ]
    solution = solve(constrain(row, SilentMonitor()).problem)
    assert errors_m(solution) < 0.01


def test_it_is_the_error_where_nothing_else_gives_the_scale() -> None:
    length = made.renamed(made.LENGTH, "stripe corner 70")
    row = constrain(tracked(made.rooms(), made.references(length)), SilentMonitor())
    with pytest.raises(SiteError, match="reference to 'stripe corner 70', but no such thing was found in the video"):
        rows._solved(row, SolveError("the scale is not known"))


def test_locating_takes_missing_scale_from_the_start() -> None:
    (wall, *_), start = made.rooms(), made.path(1.3)
    part = wall.constrain(tracks=wall.instance.tracks(), facts=made.FACTS, start=start)
    frames = camera_priors(made.FACTS, start, made.references(made.LENGTH))
    located = locate_camera(merge(frames, part, partial=True))
    assert located.assumed == ("scale",)
    np.testing.assert_allclose(located.path.world_from_rig[:, :3, 3], start.world_from_rig[:, :3, 3], atol=0.02)
    nothing_known = locate_camera(merge(camera_priors(made.FACTS, start), part, partial=True), sigmas=True)
    assert nothing_known.assumed == ("scale", "place along y")
    assert nothing_known.path.sigma_m is not None


def test_locating_assumes_nothing_where_all_is_known() -> None:
    (wall, stripes), start = made.rooms(known=True), made.path()
    parts = [room.constrain(tracks=room.instance.tracks(), facts=made.FACTS, start=start) for room in (wall, stripes)]
    frames = camera_priors(made.FACTS, start, made.references(made.LENGTH))
    partial, whole = (locate_camera(merge(frames, *parts, partial=early)) for early in (True, False))
    assert partial.assumed == ()
    assert np.array_equal(partial.path.world_from_rig, whole.path.world_from_rig)


def test_a_third_plugin_gets_the_scale_of_the_second() -> None:
    paths: list[Trajectory] = []

    class Last(made.Wall):
        name = "last"

        @hookimpl
        def track(self, start: Trajectory) -> list[Track]:
            paths.append(start)
            raise StructureError("nothing is seen")

    rooms = [*made.rooms(known=True), loaded_plugin("last", Last, made.Config())]
    assert errors_m(solved(rooms, made.references())) < 0.01
    np.testing.assert_allclose(paths[0].world_from_rig[:, :3, 3], made.path().world_from_rig[:, :3, 3], atol=0.02)
