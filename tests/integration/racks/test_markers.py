"""A marker of known size in the joint solve: it gives the scale alone, is reported, and is told when it was not seen."""

from collections.abc import Mapping

import made_up_rack as made
import numpy as np
import pytest

from savmap.errors import SolveError
from savmap.geometry import pinhole
from savmap.graph import KnownMarker, References, Solution, camera_priors, marker_constraints, merge, solve
from savmap.graph.factors.shapes import DIAGONALS, SIDES, _parallelogram, _parallelogram_slopes
from savmap.types import Floats, Track, ViewSpec
from savmap_shelves.constraints import GridSettings, constrain

NAME = "tag36h11 7"
SPEC = ViewSpec("marker", 0.0, -20.0, 0.0, 140.0, 6000, 4000)
MARKER = KnownMarker("tag36h11", 7, 0.2, 0.0005)


@pytest.fixture(scope="module")
def small() -> made.World:
    return made.world(6, sections=3, frames=40, bridge=None)


def square(size: float) -> Floats:
    """Corners (4, 3) of a marker that stands askew beside the rack."""
    turn = pinhole.rig_from_view(35.0, 12.0, 20.0)
    return np.array([5.0, 1.2, 0.3]) + size / 2 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) @ turn.T


def corner_tracks(world: made.World, size: float = 0.2, noise_px: float = 0.3) -> Mapping[str, list[Track]]:
    rng = np.random.default_rng(3)
    tracks = []
    for number, corner in enumerate(square(size), 1):
        local = np.array([pose[:3, :3].T @ (corner - pose[:3, 3]) for pose in world.poses]) @ SPEC.rig_from_view
        pixels = pinhole.project(local, SPEC.camera)
        seen = np.flatnonzero(np.abs(world.poses[:, 0, 3] - 5.0) < 2.0)
        tracks.append(
            Track(
                f"marker {NAME} / corner {number}",
                "marker",
                {"corner": number},
                seen,
                (SPEC.name,) * len(seen),
                pixels[seen] + rng.normal(0, noise_px, (len(seen), 2)),
                np.tile(noise_px**2 * np.eye(2), (len(seen), 1, 1)),
            )
        )
    return {NAME: tracks}


def solved(
    world: made.World, tracks: Mapping[str, list[Track]], given: References, height: float | None = None
) -> Solution:
    start = made.begin(world)
    given = References(given.camera_heights, given.lengths, markers=(MARKER,))
    markers, _ = marker_constraints(tracks, {SPEC.name: SPEC}, given.markers, start)
    rack = constrain(world.tracks, world.facts, start, settings=GridSettings(height or world.rack.lowest))
    return solve(merge(camera_priors(world.facts, start, given), rack, *((markers,) if markers else ())))


def test_a_marker_alone_gives_the_scale(small: made.World) -> None:
    solution = solved(small, corner_tracks(small), References())
    x, y, sigma_x, _ = made.errors(small, solution)
    assert np.abs(x).max() < 0.03
    assert np.abs(y).max() < 0.02
    assert np.abs(x[1:] / sigma_x[1:]).max() < 3.5
    corners = np.array(
        [solution.landmarks_of("survey markers")[track.name].position for track in corner_tracks(small)[NAME]]
    )
    assert np.abs(corners - square(0.2)).max() < 0.02
    assert np.abs(_parallelogram(corners, (DIAGONALS, SIDES))).max() < 0.001


def test_its_side_is_among_the_references(small: made.World) -> None:
    solution = solved(small, corner_tracks(small), made.references(small))
    use = {one.name: one for one in solution.references}[f"side of marker {NAME}"]
    assert (use.value, use.sigma) == (0.2, 0.0005)
    assert use.solved == pytest.approx(0.2, abs=0.0005)
    assert not solution.notes


def test_a_size_that_contradicts_the_rest_is_named(small: made.World) -> None:
    solution = solved(small, corner_tracks(small, size=0.206), made.references(small))
    assert f"measure it again, in metres: side of marker {NAME}," in " ".join(solution.notes)


def test_a_marker_that_was_not_seen_is_named(small: made.World) -> None:
    _, missed = marker_constraints({}, {}, (MARKER,), made.begin(small))
    assert missed == (NAME,)
    with pytest.raises(SolveError, match=f"scale is not known; marker {NAME} was not seen"):
        solved(small, {}, References(), height=0.3)


def test_a_marker_seen_from_one_place_is_not_used(small: made.World) -> None:
    standing = {NAME: [_first(track, 4) for track in corner_tracks(small)[NAME]]}
    found, missed = marker_constraints(standing, {SPEC.name: SPEC}, (MARKER,), made.begin(small, speed=0.01))
    assert missed == (NAME,)
    assert found is None


def _first(track: Track, count: int) -> Track:
    return Track(
        track.name,
        track.label,
        track.place,
        track.frames[:count],
        track.views[:count],
        np.tile(track.pixels[:1], (count, 1)),
        track.covariances[:count],
    )


def test_slopes_are_those_of_the_errors() -> None:
    points = square(0.2) + np.random.default_rng(0).normal(0, 0.01, (4, 3))
    slopes = _parallelogram_slopes(points, (DIAGONALS, SIDES))
    for corner in range(4):
        for axis in range(3):
            step = np.zeros((4, 3))
            step[corner, axis] = 1e-6
            numeric = (
                _parallelogram(points + step, (DIAGONALS, SIDES)) - _parallelogram(points - step, (DIAGONALS, SIDES))
            ) / 2e-6
            assert np.allclose(slopes[:, corner, axis], numeric, atol=1e-6)
