"""Edges drawn into panoramas at known places, as a camera with blur, noise and a tone curve shows them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from savmap.geometry import pinhole, sphere
from savmap.geometry.lines import Lines
from savmap.stages import subpixel
from savmap.stages.profiles import RADIANCE
from savmap.stages.subpixel import Bools, Edges, Subpixel
from savmap.types import Floats, Panorama, ViewSpec

HEIGHT = 512
SPEC = ViewSpec("face", yaw_deg=20.0, pitch_deg=4.0, roll_deg=-2.0, hfov_deg=100.0, width=320, height=240)
PANORAMA_PX = 0.7  # of a view pixel, about
Scene = Callable[[Floats, Floats], Floats]


@dataclass(frozen=True)
class Strip:
    """A level strip in the view: its upper edge v = top + slope (u - 160), its thickness, and its brightness."""

    top: float
    slope: float = 0.0
    thickness: float = 14.0
    bright: float = 0.5

    def below_top(self, u: Floats, v: Floats) -> Floats:
        """How far points lie below the upper edge."""
        below: Floats = v - self.top - self.slope * (u - 160)
        return below


STRIPS = [
    Strip(30.3, 0.01),
    Strip(65.8, -0.02),
    Strip(101.1, 0.03),
    Strip(140.45, 0.002),
    Strip(177.7),
    Strip(211.2, -0.04),
]


def filled(strips: Sequence[Strip], background: float = 0.1) -> Scene:
    def brightness(u: Floats, v: Floats) -> Floats:
        seen = np.full(u.shape, background)
        for strip in strips:
            below = strip.below_top(u, v)
            seen[(below > 0) & (below < strip.thickness)] = strip.bright
        return seen

    return brightness


def as_assumed(radiance: Floats) -> Floats:
    grey: Floats = np.interp(radiance, RADIANCE, np.arange(256))
    return grey


def plain_gamma(radiance: Floats) -> Floats:
    grey: Floats = 255 * np.clip(radiance, 0, 1) ** (1 / 2.2)
    return grey


def photographed(
    scene: Scene,
    spec: ViewSpec = SPEC,
    blur: float = 0.6,
    noise: float = 1.5,
    seed: int = 0,
    tone: Callable[[Floats], Floats] = as_assumed,
) -> Panorama:
    """Light is mixed over pixels (9 rays each) and blurred by the lens; then come the tone curve, noise and rounding."""
    radiance = np.zeros((HEIGHT, 2 * HEIGHT))
    v, u = np.mgrid[HEIGHT // 4 : 3 * HEIGHT // 4, 0 : 2 * HEIGHT].astype(np.float64)
    offsets = [(a / 3, b / 3) for a in (-1, 0, 1) for b in (-1, 0, 1)]
    for a, b in offsets:
        rays = sphere.rays_from_panorama_pixels(np.stack([u + a, v + b], axis=-1), HEIGHT) @ spec.rig_from_view
        ahead = rays[..., 2] > 0.3
        pixels = pinhole.project(rays[ahead], spec.camera)
        radiance[HEIGHT // 4 : 3 * HEIGHT // 4][ahead] += scene(pixels[:, 0], pixels[:, 1]) / len(offsets)
    wrapped = cv2.GaussianBlur(np.hstack([radiance, radiance[:, :32]]), (0, 0), blur)
    radiance = np.hstack([wrapped[:, -32:], wrapped[:, 32:-32]])
    grey = tone(radiance) + np.random.default_rng(seed).normal(0, noise, radiance.shape)
    return Panorama(0, 0.0, np.repeat(np.clip(np.round(grey), 0, 255).astype(np.uint8)[..., None], 3, axis=2))


def edges_of(strips: Sequence[Strip], off: Floats | float = 0.8, flank: Floats | float = 0.0) -> Edges:
    """Upper, then lower edges as masks have them: `off` pixels too far outside."""
    count = 2 * len(strips)
    inside = np.repeat([1.0, -1.0], len(strips))
    slopes = np.tile([strip.slope for strip in strips], 2)
    zeros = np.zeros(count)
    lines = Lines(
        zeros + 160,
        slopes,
        truth_of(strips) - inside * off,
        zeros + 1e-6,
        zeros + 0.01,
        zeros + 20,
        zeros + 300,
        zeros + 280,
    )
    thickness = np.tile([strip.thickness for strip in strips], 2)
    return Edges(lines, zeros + 20, zeros + 300, inside, thickness, zeros + flank, stands=False)


def measured(panorama: Panorama, spec: ViewSpec, edges: Edges, settings: Subpixel | None = None) -> tuple[Lines, Bools]:
    return subpixel.measured(panorama, spec, [edges], settings)[0]


def truth_of(strips: Sequence[Strip]) -> Floats:
    """Rows of the upper, then the lower edges at u = 160."""
    return np.array([strip.top for strip in strips] + [strip.top + strip.thickness for strip in strips])


def errors(lines: Lines, strips: Sequence[Strip], u: float = 160.0) -> Floats:
    slopes = np.tile([strip.slope for strip in strips], 2)
    wrong: Floats = lines.at(u) - truth_of(strips) - slopes * (u - 160)
    return wrong


def outward(wrong: Floats) -> Floats:
    half = len(wrong) // 2
    return np.concatenate([-wrong[:half], wrong[half:]])


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


@pytest.mark.parametrize("yaw", [180.0, -160.0])
def test_the_seam_of_the_panorama_does_not_matter(yaw: float) -> None:
    spec = replace(SPEC, yaw_deg=yaw)
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


def test_a_faint_edge_is_found_where_noise_hides_it_in_every_piece() -> None:
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
