"""Edges measured in drawn panoramas, against where they were drawn."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from savmap.geometry.lines import Lines
from savmap.types import Floats, Panorama
from savmap.vision import subpixel
from savmap.vision.subpixel import Edges, Subpixel

from .drawn_strips import (
    HEIGHT,
    PANORAMA_PX,
    SPEC,
    STRIPS,
    as_assumed,
    edges_of,
    errors,
    filled,
    measured,
    outward,
    photographed,
    plain_gamma,
)


def test_edges_are_found_to_a_twentieth_of_a_panorama_pixel() -> None:
    lines, found = measured(photographed(filled(STRIPS)), SPEC, edges_of(STRIPS))
    assert found.all()
    for u in (40.0, 160.0, 280.0):
        assert np.abs(errors(lines, STRIPS, u)).max() < 0.05 / PANORAMA_PX


def test_uprights_are_measured_like_beams() -> None:
    turned = replace(SPEC, roll_deg=SPEC.roll_deg - 90, width=SPEC.height, height=SPEC.width, hfov_deg=83.5757)
    lying = edges_of(STRIPS)
    panorama = photographed(lambda u, v: filled(STRIPS)(v, u), turned)
    lines, found = measured(panorama, turned, replace(lying, stands=True))
    assert found.all()
    assert np.abs(errors(lines, STRIPS)).max() < 0.05 / PANORAMA_PX


def test_the_seam_of_the_panorama_does_not_matter() -> None:
    spec = replace(SPEC, yaw_deg=-160.0)
    lines, found = measured(photographed(filled(STRIPS), spec), spec, edges_of(STRIPS))
    assert found.all()
    assert np.abs(errors(lines, STRIPS)).max() < 0.05 / PANORAMA_PX


@pytest.mark.parametrize(
    ("bright", "tone", "most"), [(0.2, as_assumed, 0.05), (0.9, as_assumed, 0.05), (0.2, plain_gamma, 0.1)]
)
def test_bright_things_before_dark_ones_are_not_too_wide(
    bright: float, tone: Callable[[Floats], Floats], most: float
) -> None:
    """In grey values, the steepest place would be 0.2 to 0.4 px outside."""
    strips = [replace(strip, bright=bright) for strip in STRIPS]
    lines, _ = measured(photographed(filled(strips, 0.01), blur=0.9, tone=tone), SPEC, edges_of(strips))
    assert abs(outward(errors(lines, strips)).mean()) < most


@pytest.mark.slow
def test_normalised_errors_of_what_pieces_tell_have_unit_spread() -> None:
    settings = Subpixel(common_sigma=0.0)
    normalised = []
    for seed in range(8):
        strips = [replace(strip, top=strip.top + 0.31 * seed) for strip in STRIPS]
        noisy = photographed(filled(strips, 0.25), noise=14.0, seed=seed)
        lines, found = measured(noisy, SPEC, edges_of(strips), settings)
        normalised.append((errors(lines, strips) / np.sqrt(lines.variance_at(160.0)))[found])
    everything = np.concatenate(normalised)
    assert len(everything) > 60
    assert 0.8 < np.sqrt(np.mean(everything**2)) < 1.25


def test_what_pieces_may_all_be_off_is_never_forgotten() -> None:
    lines, _ = measured(photographed(filled(STRIPS), noise=0.0), SPEC, edges_of(STRIPS))
    assert (np.sqrt(lines.variance_at(160.0)) > 0.08).all()


def test_goods_before_an_edge_do_not_move_it() -> None:
    rng = np.random.default_rng(5)
    goods = [
        (start, start + rng.uniform(10, 30), rng.uniform(-6, 8), rng.uniform(0, 1)) for start in range(25, 290, 55)
    ]

    def occluded(u: Floats, v: Floats) -> Floats:
        seen = filled(STRIPS)(u, v)
        for strip in STRIPS:
            below = strip.below_top(u, v)
            for first, last, depth, bright in goods:
                seen[(u > first) & (u < last) & (below > -12) & (below < depth)] = bright
        return seen

    lines, found = measured(photographed(occluded), SPEC, edges_of(STRIPS))
    assert found.all()
    assert np.abs(errors(lines, STRIPS)).max() < 0.1


@pytest.mark.parametrize("outer", [0.02, 0.9])
def test_the_front_edge_is_the_inner_of_two(outer: float) -> None:
    """The side face above each strip is a little brighter, 3.5 px high, and far from what is behind it."""

    def flanked(u: Floats, v: Floats) -> Floats:
        seen = filled(STRIPS, outer)(u, v)
        for strip in STRIPS:
            below = strip.below_top(u, v)
            seen[(below > -3.5) & (below <= 0)] = 0.7
        return seen

    panorama = photographed(flanked)
    upper = np.repeat([1.0, 0.0], len(STRIPS))
    edges = edges_of(STRIPS, off=2.0 * upper, flank=0.5 * upper)
    lines, found = measured(panorama, SPEC, edges)
    assert found.all()
    assert np.abs(errors(lines, STRIPS)).max() < 0.25
    unaware, _ = measured(panorama, SPEC, replace(edges, flank=0 * upper))
    assert np.abs(errors(unaware, STRIPS))[: len(STRIPS)].min() > 1.0, "the stronger edge is the wrong one"


def test_without_contrast_the_mask_stays_with_an_honest_sigma() -> None:
    strips = [replace(strip, bright=0.1005) for strip in STRIPS]
    edges = edges_of(strips)
    lines, found = measured(photographed(filled(strips)), SPEC, edges)
    assert not found.any()
    assert np.array_equal(lines.at(77.0), edges.lines.at(77.0))
    assert (np.sqrt(lines.variance_at(160.0)) >= 0.4).all()


def test_of_two_lines_as_likely_none_is_taken() -> None:
    """Two equal steps, as far from the mask's edge on either side."""

    def doubled(u: Floats, v: Floats) -> Floats:
        below = STRIPS[2].below_top(u, v)
        return np.where(below < -2, 0.1, np.where(below < 2, 0.24, 0.45))

    _, found = measured(photographed(doubled), SPEC, edges_of(STRIPS[2:3], off=0.0))
    assert not found[0]


def test_faint_edge_is_found_although_noise_hides_each_piece() -> None:
    strips = [replace(strip, bright=0.135) for strip in STRIPS]
    lines, found = measured(photographed(filled(strips, 0.1), noise=3.0), SPEC, edges_of(strips, off=0.4))
    assert found.mean() > 0.6
    assert np.abs(errors(lines, strips))[found].max() < 0.3


def test_no_edges_give_none() -> None:
    none = np.zeros(0)
    lines = Lines(*(none for _ in range(8)))
    panorama = Panorama(0, 0.0, np.zeros((HEIGHT, 2 * HEIGHT, 3), np.uint8))
    measured_lines, found = measured(panorama, SPEC, Edges(lines, none, none, none, none, none, True))
    assert len(measured_lines) == len(found) == 0
    assert subpixel.measured(panorama, SPEC, []) == []


def test_groups_of_edges_do_not_disturb_each_other() -> None:
    panorama = photographed(filled(STRIPS))
    alone = [measured(panorama, SPEC, edges_of(strips))[0] for strips in (STRIPS[:2], STRIPS[2:])]
    none = replace(edges_of([]), stands=True)
    together = subpixel.measured(panorama, SPEC, [edges_of(STRIPS[:2]), none, edges_of(STRIPS[2:])])
    for one, (other, found) in zip(alone, together[::2], strict=True):
        assert found.all()
        assert np.allclose(one.at(160.0), other.at(160.0), atol=0.05)


def test_any_picture_gives_finite_lines() -> None:
    noise: NDArray[np.uint8] = np.random.default_rng(2).integers(0, 255, (HEIGHT, 2 * HEIGHT, 3)).astype(np.uint8)
    edges = edges_of(STRIPS)
    short = replace(edges, last=edges.first + np.linspace(0.0, 25.0, len(edges.first)))
    lines, _ = measured(Panorama(0, 0.0, noise), SPEC, short)
    assert all(np.isfinite(value).all() for value in vars(lines).values())
