"""Biases that masks' edges have in common: found with a known width, allowed for in sigmas where they are not estimated."""

from dataclasses import replace

import made_up_rack as made
import numpy as np
import pytest

from savmap.graph import KnownLength, SolveOptions, camera_priors, merge, solve
from savmap.types import Track
from savmap_shelves.constraints import GridSettings, constrain
from savmap_shelves.constraints.constrain import NO_BIAS, BiasSettings, mask_biases

BIAS_PX = 0.8


@pytest.fixture(scope="module")
def wide() -> made.World:
    """A rack all of whose masks are 0.8 px too wide on every side."""
    world = made.world(5, sections=2, frames=40, bridge=None, noise_px=0.3)
    start = made.begin(world)
    settings = BiasSettings(1.0, 0.0, 0.0)
    moves = mask_biases(world.tracks, world.facts.views, start, settings)
    assert moves is not None
    moved = moves.moved(np.array([BIAS_PX]))
    ends = np.cumsum([len(track.frames) for track in world.tracks])
    parts = np.split(moved, ends[:-1])
    tracks: list[Track] = [replace(t, pixels=t.pixels + part) for t, part in zip(world.tracks, parts, strict=True)]
    return replace(world, tracks=tracks)


def mapped(world: made.World, settings: GridSettings, options: SolveOptions | None = None) -> tuple[float, float, dict]:
    """Mean errors of the beams' heights and their sigmas, m, and the report. Two profiles' widths are known."""
    given = made.references(world)
    widths = [
        KnownLength("upright 2 / left", "upright 2 / right", 0.0986, 0.001),
        KnownLength("bay 1 / beam 2 / lower", "bay 1 / beam 2 / upper", 0.1, 0.001),
    ]
    given = replace(given, lengths=(*given.lengths, *widths))
    start = made.begin(world)
    grid = constrain(world.tracks, world.facts, start, settings=settings)
    solution = solve(merge(camera_priors(world.facts, start, given), grid), options)
    errors, sigmas = [], []
    for section, beams in enumerate(world.rack.beams, 1):
        for beam in range(2 if section == 1 else 0, len(beams)):
            names = [f"bay {section} / beam {beam + 1} / {edge} left" for edge in ("lower", "upper")]
            low, high = (solution.landmarks_of("shelves")[name].position[1] for name in names)
            errors.append(high - low - np.ptp(beams[beam]))
            sigmas.append(solution.difference_sigma("shelves", *names, axis=1))
    return float(np.mean(errors)), float(np.mean(sigmas)), dict(solution.report)


def test_a_known_width_shows_the_bias(wide: made.World) -> None:
    estimated = GridSettings(wide.rack.lowest, bias=BiasSettings(1.0, 0.25, 0.0, "estimated"))
    error, sigma, report = mapped(wide, estimated)
    assert float(report["bias 1, px"]) + float(report["bias 3, px"]) == pytest.approx(
        BIAS_PX, abs=0.15
    )  # their standard deviations are 0.2
    assert abs(error) < 0.002
    assert sigma < 0.003


def test_believed_masks_make_widths_too_large(wide: made.World) -> None:
    believed, sigma, report = mapped(wide, GridSettings(wide.rack.lowest, bias=NO_BIAS))
    assert believed > 0.02
    assert believed > 2 * sigma
    assert "bias 1, px" not in report


@pytest.mark.slow
def test_sigmas_allow_for_a_bias_that_is_not_estimated(wide: made.World) -> None:
    plain, considered = (
        mapped(wide, GridSettings(wide.rack.lowest, bias=bias), options=SolveOptions(judge=False))
        for bias in (NO_BIAS, BiasSettings(0.5, 0.25, 0.25))
    )
    assert considered[0] == pytest.approx(plain[0], abs=2e-4)
    assert considered[1] > 2 * plain[1]
    assert abs(considered[0]) < 3 * considered[1]
