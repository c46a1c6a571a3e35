"""Variance components: what one class of measurements, or one edge, has of errors is not paid for by the others."""

from dataclasses import replace

import made_up_rack as made
import numpy as np
import pytest

from savmap.errors import SolveError
from savmap.graph import Solution, camera_priors, merge, solve
from savmap.types import Floats, Track
from savmap_shelves.constraints import GridSettings, constrain
from savmap_shelves.constraints.constrain import BiasSettings
from savmap_shelves.constraints.sharing import APART, share_edges


@pytest.fixture(scope="module")
def rack() -> made.World:
    return made.world(3, sections=2, frames=40, bridge=None)


def noisier(world: made.World, label: str, noise_px: float) -> made.World:
    """The same with more noise, across their edges, on all tracks of a class, which does not say so."""
    rng = np.random.default_rng(5)

    def shaken(track: Track) -> Track:
        axes = np.linalg.eigh(track.covariances)[1][:, :, 0]
        return replace(track, pixels=track.pixels + noise_px * rng.normal(size=(len(axes), 1)) * axes)

    return replace(world, tracks=[shaken(track) if track.label == label else track for track in world.tracks])


def sigma(solution: Solution, name: str, axis: int) -> float:
    return float(np.sqrt(solution.landmarks_of("shelves")[name].covariance[axis, axis]))


def thickness_sigma(solution: Solution, beam: str = "bay 1 / beam 2") -> float:
    return solution.difference_sigma("shelves", f"{beam} / lower left", f"{beam} / upper left", 1)


def width_sigma(solution: Solution) -> float:
    return solution.difference_sigma("shelves", "upright 2 / left / top", "upright 2 / right / top", 0)


def mapped(world: made.World, bias: BiasSettings) -> Solution:
    settings = GridSettings(world.rack.lowest, bias=bias)
    own = constrain(world.tracks, world.facts, made.begin(world), settings=settings)
    return solve(merge(camera_priors(world.facts, made.begin(world), made.references(world)), own))


@pytest.mark.slow
def test_a_bad_class_pays_for_itself(rack: made.World) -> None:
    good, bad = made.solved(rack), made.solved(noisier(rack, "upright", 4.0))
    assert width_sigma(bad) > 3 * width_sigma(good)
    assert thickness_sigma(bad) < 1.3 * thickness_sigma(good)
    uprights, beams = (float(bad.report[f"variance_inflation, {label}"]) for label in ("upright", "beam"))
    assert uprights > 10 * beams


def test_a_class_that_does_not_fit_at_all_is_doubted(rack: made.World) -> None:
    [warning] = made.solved(noisier(rack, "upright", 12.0)).warnings
    assert warning.code == "bad-panorama"
    assert "`upright`" in made.said(warning)
    assert not made.solved(noisier(rack, "upright", 1.0)).warnings


@pytest.mark.slow
def test_measurements_that_say_nothing_are_no_map(rack: made.World) -> None:
    """Off by 1.7 million times their sigmas, uprights of stretched footage were a map to check, which no command could read."""
    scrambled = [
        replace(track, covariances=track.covariances * 1e-6) if track.label == "upright" else track
        for track in noisier(rack, "upright", 12.0).tracks
    ]
    with pytest.raises(SolveError, match=r"measured of `upright` does not fit together.*whole panoramas"):
        made.solved(replace(rack, tracks=scrambled))


def test_pictures_do_not_loosen_references(rack: made.World) -> None:
    last = f"upright {len(rack.rack.uprights)} / right / top"
    bad = made.solved(noisier(noisier(rack, "upright", 4.0), "beam", 4.0))
    assert sigma(bad, last, 0) < 0.0035


def test_an_edge_of_two_minds_is_not_sure(rack: made.World) -> None:
    """A third of what was measured of one edge lies elsewhere, all in the same place: either may be the edge."""

    def torn(track: Track) -> Track:
        away = np.arange(len(track.frames)) % 3 == 0
        return replace(track, pixels=track.pixels + 9.0 * away[:, None] * np.array([0.0, 1.0]))

    doubtful = "bay 1 / beam 2 / upper"
    tracks = [torn(track) if track.name.startswith(doubtful) else track for track in rack.tracks]
    plain, found = made.solved(rack), made.solved(replace(rack, tracks=tracks))
    assert thickness_sigma(found) > 4 * thickness_sigma(plain)
    others = [thickness_sigma(solution, "bay 2 / beam 2") for solution in (found, plain)]
    assert others[0] < 1.3 * others[1]


@pytest.mark.slow
def test_relative_biases_grow_with_the_residuals(rack: made.World) -> None:
    plain, bad = rack, noisier(rack, "beam", 4.0)
    relative, fixed = BiasSettings(0.0, 0.0, 3.0, relative=True), BiasSettings(0.0, 0.0, 3.0)
    grown = [thickness_sigma(mapped(world, relative)) for world in (plain, bad)]
    assert grown[1] > 3 * grown[0]
    held = [thickness_sigma(mapped(world, fixed)) for world in (plain, bad)]
    assert held[1] < 1.5 * held[0]


def test_corners_alone_do_not_place_beams(rack: made.World) -> None:
    """A corner lies on the upright's line, wherever the beam stands: where that line was not measured in one view, but in others."""
    corner = next(track for track in rack.tracks if track.name == "bay 1 / beam 2 / lower left")
    ends = [track for track in rack.tracks if track.name.startswith("upright 1 / right")]
    late = [replace(end, frames=end.frames + 1000) for end in ends]
    start = made.begin(rack)
    shared = {
        end: share_edges([corner, *others], rack.facts.views, start)[0][0]
        for end, others in (("seen", late), ("never", []))
    }
    grown = {end: _across(track, corner) for end, track in shared.items()}
    assert grown["seen"].min() > APART / 100
    assert grown["never"].max() < 2


def _across(track: Track, before: Track) -> Floats:
    """How much the largest variance grew (n,)."""
    largest = [np.linalg.eigvalsh(one.covariances)[:, -1] for one in (track, before)]
    return np.asarray(largest[0] / largest[1])
